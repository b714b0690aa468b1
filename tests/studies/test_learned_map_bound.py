"""The bound of the learned map: both folders are played, and compared with uniform sampling."""

import pytest
from learned_map_bound import BoundSettings, run

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
    assert capsys.readouterr().out.count("\n") == 6


def test_nothing_to_play_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="`most` and `copies` should be at least 1, but are 0 and 2"):
        run(BoundSettings((), tmp_path, tmp_path, most=0))
