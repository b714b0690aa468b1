"""What the package promises is there."""

import pytest

import creative_nao.robot as robot


@pytest.mark.parametrize("name", robot.__all__)
def test_every_public_name_loads_and_is_documented(name):
    assert name in dir(robot)
    assert getattr(robot, name) is not None
    assert name in (robot.__doc__ or "")


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"^No creative_nao\.robot attribute Nonsense$"):
        robot.Nonsense  # noqa: B018
