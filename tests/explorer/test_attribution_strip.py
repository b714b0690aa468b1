"""The strip under the curves: which basic action a movement resembles when."""

import dataclasses
import re

import numpy as np
import pytest

from creative_nao.explorer import MemoryService
from creative_nao.explorer.markup import strip_html
from creative_nao.explorer.memory_service import attribute, sentence
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def service():
    return MemoryService(load_memory("half/0"))


def joined(service):
    """A left jab that goes on as a right uppercut."""
    jab, uppercut = (service.memory.demonstrations.trajectories[place] for place in (0, 5))
    return service.evaluate(np.zeros((1, 2)), np.concatenate([jab[:25], uppercut[25:]]))


def test_a_movement_joined_of_two_is_read_as_the_two(service):
    recall = joined(service)
    assert (
        sentence(attribute(recall, service), service.names) == "Resembles A left jab to 3.7 s, then F right uppercut."
    )
    assert attribute(recall, service).distances.shape == (50, 6)


def test_the_strip_has_the_letters_colours_and_places_of_the_stretches(service):
    page = strip_html(joined(service), service)
    assert re.findall(r">([A-Z])</b>", page) == ["A", "F"]
    assert re.findall(r"left:([\d.]+)%;width:([\d.]+)%", page) == [("0.00", "50.00"), ("50.00", "50.00")]
    assert "rgba(0,79,229,1.00)" in page  # the jab's blue, at full strength: it is the demonstration itself
    assert 'aria-hidden="true"' in page
    assert "Resembles A left jab to 3.7 s" in page.split('class="cn-legend cn-resembles"')[1]


def test_a_name_cannot_become_markup(service):
    demonstrations = service.memory.demonstrations
    named = dataclasses.replace(demonstrations, names=("<b>bold", *demonstrations.names[1:]))
    page = strip_html(joined(service), MemoryService(dataclasses.replace(service.memory, demonstrations=named)))
    assert "<b>bold" not in page
    assert page.count("&lt;b&gt;bold") == 2


@pytest.mark.slow
def test_the_page_shows_the_strip_in_step_with_the_robot(visit, server, service):
    learned = service.memory.pb[2]
    tab = visit(f"{server.url}?x={learned[0]}&y={learned[1]}")
    tab.wait_for_robot()
    recall = service.recall(learned[None])
    assert tab.page.locator(".cn-resembles").inner_text() == sentence(attribute(recall, service), service.names)
    tab.page.evaluate("window.robotPlayer.playing = false; window.robotPlayer.seek(window.robotPlayer.duration / 4)")
    share = """() => {
        const box = (name) => document.querySelector(name).getBoundingClientRect();
        const [cursor, strip] = [box(".cn-strip-cursor"), box(".cn-strip")];
        return Math.abs((cursor.x + cursor.width / 2 - strip.x) / strip.width - 0.25) < 0.01;
    }"""
    tab.page.wait_for_function(share)
