"""Windows of the map: which PB point lies under a pixel, and where zooming leads."""

import numpy as np
import pytest

from creative_nao import maps
from creative_nao.explorer.state import PageAddress, page_address
from creative_nao.explorer.view import SIZE, SMALLEST, View, cell_of
from creative_nao.maps import nearest_cell, pb_grid
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def pb_map():
    return maps.pb_map(load_memory("half/0"), 20)


@pytest.mark.parametrize("view", [View.whole(200), View(0.1, -0.4, 0.25), View(-1.0, 0.998, SMALLEST)])
def test_pixels_and_pb_points_are_each_others_reverse(view):
    for x, y in ((150, 450), (300, 299), (480, 12)):
        back = view.to_pixel(view.to_pb(x, y))
        assert back == pytest.approx((x, y), abs=0.51)  # half a pixel is what rounding to `digits` may cost
    assert View.whole(200).to_pb(0, 0) == (-1.0, 1.0)


def test_the_whole_view_shows_every_cell_of_the_grid(pb_map):
    rows, columns = View.whole(20).cells(pb_map)
    assert rows[0] == 19
    assert columns[0] == 0
    assert [np.unique(one, return_counts=True)[1].tolist() for one in (rows, columns)] == [[SIZE // 20] * 20] * 2
    assert View.of(pb_map).left == pytest.approx(View.whole(20).left)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    assert [cell_of(pb_map, pb) for pb in points] == nearest_cell(points, 20).tolist()


def test_the_cells_of_a_window_lie_within_it():
    view = View(0.2, -0.1, 0.1)
    pb = view.grid(50)
    assert all(view.shows(point) for point in pb)
    assert pb[1, 0] - pb[0, 0] == pytest.approx(0.002)
    assert View(-1.0, -1.0, 2.0).grid(50).shape == pb_grid(50).shape


def test_zooming_keeps_the_point_under_the_pointer_and_stops_at_both_ends():
    view = View.whole(200)
    around = (0.37, -0.22)
    before = view.to_pixel(around)
    for _ in range(3):
        view = view.zoomed(2.0, around)
        assert view.to_pixel(around) == pytest.approx(before, abs=2)  # the whole map is wider by a cell
    assert view.width == pytest.approx(0.25)
    assert view.zoomed(1e9, around).width == SMALLEST
    assert view.zoomed(0.01, around) is None
    corner = View.whole(200).zoomed(4.0, (1.0, 1.0))
    assert (corner.left + corner.width, corner.bottom + corner.width) == (1.0, 1.0)


def test_a_window_follows_a_point_that_leaves_it():
    view = View(0.0, 0.0, 0.2)
    assert view.following((0.1, 0.2)) is view
    assert view.following((0.5, -0.99)).shows((0.5, -0.99))
    assert view.following((0.5, -0.99)).width == 0.2


def test_an_address_gives_the_place_back():
    place = PageAddress(np.array([[0.1234567, -0.5]]), "open/0", View(0.1, -0.25, 0.5), "speed")
    assert place.address() == "/?x=0.123457&y=-0.5&beside=open/0&view=0.1,-0.25,0.5&colour=speed"
    again = page_address("0.123457", "-0.5", "", "open/0", "0.1,-0.25,0.5", "speed")
    assert (again.view, again.colour, again.beside) == (place.view, "speed", "open/0")
    assert PageAddress(np.array([[0, 0], [1, -1]])).address() == "/?path=0,0_1,-1"


@pytest.mark.parametrize("view", ["", "1,2", "nan,0,1", "0,0,0", "0,0,9", "a,b,c", "0,0,1,1", "inf,0,0.5", "0,0,-1"])
def test_a_window_that_cannot_be_read_is_the_whole_map(view):
    assert page_address(view=view, colour="nonsense").view is None
    assert page_address(colour="nonsense").colour == "nearest"
    assert page_address(view="5,-5,0.5").view == View(0.5, -1.0, 0.5)
