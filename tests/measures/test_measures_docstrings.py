import doctest
import importlib

import pytest


@pytest.mark.parametrize("name", ["dtw", "score"])
def test_the_examples_say_what_happens(name):
    result = doctest.testmod(importlib.import_module(f"creative_nao.measures.{name}"))
    assert result.attempted > 0
    assert result.failed == 0
