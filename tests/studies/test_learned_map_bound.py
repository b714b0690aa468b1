"""The bound of the learned map: both folders are played, and compared with uniform sampling."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from learned_map_bound import BoundSettings, RaisedProbability, correlations, run

from creative_nao.agents import load_agent
from creative_nao.agents.learned_map.network import expected
from creative_nao.agents.learned_map.truth import kept_truth, truth_file
from creative_nao.errors import SettingsError
from creative_nao.model import load_memory


@pytest.mark.slow
def test_both_folders_are_played(tmp_path, capsys):
    for kind, memory in (("seen", "half/0"), ("new", "half/10")):
        kept_truth(load_memory(memory), truth_file(tmp_path / kind, memory), memory)
    name = "learned_map/BoxingMental-v1"
    found = run(BoundSettings((name,), tmp_path / "seen", tmp_path / "new", copies=1))
    assert found[name].keys() == {"trained on", "others"}
    assert all(1.0 < ratio < 2.0 for ratio in found[name].values())
    told = capsys.readouterr().out
    assert told.count("\n") == 8
    assert told.count("by their distance in PB space: 0.06: 0.") == 2


def test_nothing_to_play_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="`most` and `copies` should be at least 1, but are 0 and 2"):
        run(BoundSettings((), tmp_path, tmp_path, most=0))


def test_a_negative_power_is_refused(tmp_path):
    with pytest.raises(SettingsError, match=r"`power` should be at least 0, but is -1.0"):
        run(BoundSettings((), tmp_path, tmp_path, power=-1.0))


def test_points_of_one_colour_on_a_chessboard_correlate():
    colour = np.indices((32, 32)).sum(axis=0).reshape(-1, 1) % 2
    board: Any = SimpleNamespace(appropriate=np.ones(1024, bool), distances=colour + np.array([1.0, 5.0]))
    assert correlations([board]) == pytest.approx([-1.0, 1.0, -1.0, 1.0, 1.0, 1.0])


def test_the_probability_is_raised():
    policy: Any = load_agent("learned_map/BoxingMental-v1").policy  # pyright: ignore[reportAttributeAccessIssue]
    pb = torch.rand(1, 5, 2, generator=torch.Generator().manual_seed(0)) * 2.0 - 1.0
    known = policy.encode(torch.zeros(1, 6, 2), torch.zeros(1, 0, policy.columns[-1].stop), torch.zeros(1, 0))
    with torch.inference_mode():
        probability, distance, spread = expected(policy.decode(known, pb))
        again = expected(RaisedProbability(policy, 1.0).decode(known, pb))
        other = expected(RaisedProbability(policy, 0.5).decode(known, pb))
    torch.testing.assert_close(again, (probability, distance, spread))
    torch.testing.assert_close(other, (probability.sqrt(), distance, spread))
