"""Policy gradients over a learned map: what a movement is credited with, and that a short training runs."""

import numpy as np
import policy_gradient_over_map as study
import pytest

from creative_nao.agents.learned_map.truth import kept_truth, truth_file
from creative_nao.errors import SettingsError
from creative_nao.model import load_memory


def test_a_movement_is_credited_with_later_ones():
    earned = np.array([[1.0, 2.0, 4.0, 8.0]])
    assert study.later(earned, 30).tolist() == [[14.0, 12.0, 8.0, 0.0]]
    assert study.later(earned, 1).tolist() == [[2.0, 4.0, 8.0, 0.0]]
    assert not study.later(earned, 0).any()


def test_a_return_is_compared_with_other_episodes_of_the_memory():
    returns = np.zeros((study.GROUP**2, 2))
    returns[0, 0] = 7.0
    found = study.beyond_others(returns)
    assert found[0, 0] == 7.0
    assert found[1 : study.GROUP, 0].tolist() == [-1.0] * (study.GROUP - 1)
    assert not found[study.GROUP :].any()
    assert not found[:, 1].any()


@pytest.mark.slow
def test_it_trains_and_is_judged_again(tmp_path, capsys):
    for kind, memory in (("seen", "half/0"), ("new", "half/10")):
        kept_truth(load_memory(memory), truth_file(tmp_path / kind, memory), memory)
    settings = study.GradientSettings(
        "learned_map/BoxingMental-v1", tmp_path / "seen", tmp_path / "new", updates=2, copies=1
    )
    found = study.run(settings)
    assert found == study.run(settings)
    assert all(5.0 < one < 30.0 for one in found)
    assert "after: " in capsys.readouterr().out


def test_no_updates_are_refused(tmp_path):
    with pytest.raises(SettingsError, match="`updates` should be at least 1"):
        study.run(study.GradientSettings("learned_map/BoxingMental-v1", tmp_path, tmp_path, updates=0))
