import doctest
import importlib

import pytest


@pytest.mark.parametrize("name", ["dataset", "files", "keyframes"])
def test_the_examples_say_what_happens(name):
    result = doctest.testmod(importlib.import_module(f"creative_nao.demonstrations.{name}"))
    assert result.attempted > 0
    assert result.failed == 0
