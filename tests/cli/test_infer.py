"""`creative-nao infer` as a user meets it."""

import json

import numpy as np
import pytest

from creative_nao import load_memory
from creative_nao.cli import main
from creative_nao.demonstrations import save_trajectory


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """A movement of half/0 in a file, and its PB."""
    memory, pb = load_memory("half/0"), np.array([0.3, 0.1])
    path = tmp_path_factory.mktemp("infer") / "moved.csv"
    return save_trajectory(path, memory.generate(pb[None])[0], memory.dt_s), pb


def test_the_pb_of_a_generated_file_comes_back(generated, capsys):
    path, pb = generated
    assert main(["infer", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)

    np.testing.assert_allclose(found["pb"], pb, atol=2 / 199)
    assert found["error"] < 0.01
    assert found["recorded"]["nearest"] == found["regenerated"]["nearest"] in load_memory("half/0").demonstrations.names
    assert np.shape(found["trajectory"]) == (50, 8)
    assert found["initial_state"] is None


def test_it_says_so_in_three_lines(generated, capsys):
    assert main(["infer", str(generated[0])]) == 0
    first, second, third = capsys.readouterr().out.splitlines()

    assert first.startswith("moved.csv in memory half/0: PB (+0.3000, +0.1000), DTW 0.00, 0.000 rad rms")
    assert "recorded     nearest to " in second
    assert "regenerated  nearest to " in third


def test_a_basic_action_is_nearest_to_itself(capsys, tmp_path, demonstrations):
    path = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[3], demonstrations.dt_s)
    assert main(["infer", str(path), "--memory", "closed/0", "--initial-state", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)

    assert found["recorded"]["nearest"] == found["regenerated"]["nearest"] == "right_hook"
    assert found["error"] < 10
    assert len(found["initial_state"]) == 70
    assert found["trajectory"][0] == demonstrations.trajectories[3][0].tolist()


@pytest.mark.parametrize(("ending", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_the_picture_is_written(generated, tmp_path, capsys, ending, begins):
    out = tmp_path / f"joints.{ending}"
    assert main(["infer", str(generated[0]), "--n-restarts", "6", "--out", str(out)]) == 0

    assert f"written: {out}" in capsys.readouterr().out
    assert out.read_bytes().startswith(begins)
    assert [file.name for file in tmp_path.iterdir()] == [out.name]


def test_a_memory_of_other_joints_and_pb_units_can_be_drawn(waves, tmp_path, capsys):
    from creative_nao.model import NetworkSettings, TrainingSettings, train_network

    settings = NetworkSettings(layer_sizes=(6, 3), time_constants=(2, 4), n_pb=1)
    memory = train_network(waves, TrainingSettings(n_epochs=20), settings)
    file = save_trajectory(tmp_path / "wave.csv", waves.trajectories[0], waves.dt_s, waves.joints)
    out = tmp_path / "wave.png"

    assert main(["infer", str(file), "--memory", str(memory.save(tmp_path / "m")), "--out", str(out)]) == 0
    assert "PB (" in capsys.readouterr().out
    assert out.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.csv"], "no movement at nothing.csv"),
        (["nothing.csv", "--memory", "hlf/0"], "no memory `hlf/0` (did you mean `half/0`?)"),
        (["nothing.csv", "--out", "x.doc"], "--out should end in .png, .svg, .pdf, but is x.doc"),
        ([], "see creative-nao infer --help"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_code_2(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    assert main(["infer", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert list(tmp_path.iterdir()) == []
