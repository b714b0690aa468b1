import doctest
import importlib

import pytest

NAMES = ("dtw", "outcome", "diversity", "coverage", "attribution")


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_say_what_happens(name):
    result = doctest.testmod(importlib.import_module(f"creative_nao.measures.{name}"))
    assert result.attempted > 0
    assert result.failed == 0
