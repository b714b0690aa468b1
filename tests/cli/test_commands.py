"""The command line as a user meets it."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import creative_nao
from creative_nao import load_memory
from creative_nao.cli import main
from creative_nao.cli.dispatch import COMMANDS
from creative_nao.cli.memories import score_memory
from creative_nao.demonstrations import load_demonstrations, save_trajectory
from creative_nao.maps import PBMap
from creative_nao.model import shipped_memories, shipped_scores


def said(capsys):
    """Return the one line on stderr."""
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error.strip()


def test_bare_prints_help(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in COMMANDS)


def test_the_version_is_the_package_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"creative-nao {creative_nao.__version__}\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_tells_its_options_with_defaults(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert f"usage: creative-nao {name}" in text
    for option in re.findall(r"^. (--[a-z-]+)", text, re.MULTILINE):
        assert option == "--help" or "default" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["evalute", "quick"], "no command `evalute` (did you mean `evaluate`?)"),
        (["evaluate", "quik"], "(did you mean `quick`?)"),
        (["agent", "trian"], "no command `agent trian` (did you mean `train`?)"),
        (["evaluate", "verify"], "creative-nao: evaluate verify: "),
        (["evaluate", "quick", "--retrain"], "--retrain"),
        (["map", "hlf/0"], "no memory `hlf/0` (did you mean `half/0`?)"),
        (["map", "half/0", "--resolution", "many"], "invalid literal for int() with base 10: 'many'"),
        (["map", "half/0", "--resolution", "1"], "`resolution` should be at least 2, but is 1"),
        (["map", "half/0", "--out", "map.txt"], "--out should end in .npz or .safetensors, but is map.txt"),
        (["train", "--out", "m", "--closed-loop-ratio", "2"], "`closed_loop_ratio` should be at most 1, but is 2.0"),
        (["train", "--out", "m", "--engine", "gpu"], "invalid choice 'gpu'"),
        (["train", "--out", "m", "--condition", "auto", "--closed-loop-ratio", "1"], "say the same thing"),
        (["train", "--out", "m", "--sed", "1"], "--sed"),
        (["train", "--out", "m", "--demonstrations", "nowhere"], "nowhere"),
        (["score", "nothing.csv"], "nothing.csv"),
        (["infer", "nothing.csv"], "nothing.csv"),
        (["infer"], "creative-nao: infer: "),
    ],
)
def test_a_mistake_gets_one_line_and_exit_code_2(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    assert main(words) == 2
    assert message in said(capsys)
    assert list(tmp_path.iterdir()) == []  # nothing half-written stays


def test_a_csv_in_degrees_is_brought_to_radians_and_said(capsys, tmp_path, demonstrations):
    path = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[0], demonstrations.dt_s)
    header, *lines = path.read_text().splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    degrees = [",".join(str(v if i == 0 else np.degrees(v)) for i, v in enumerate(row)) for row in rows]
    path.write_text("\n".join([header, *degrees]) + "\n")

    assert main(["score", str(path)]) == 0
    first, note = capsys.readouterr().out.splitlines()[:2]
    assert first.startswith(f"{path}: learned, DTW 0.0")
    assert "degrees" in note


def test_a_torn_memory_says_which_part(capsys, tmp_path, tiny_memory):
    path = tiny_memory.save(tmp_path / "m.safetensors")
    path.write_bytes(path.read_bytes()[:-1000])

    assert main(["map", str(path), "--out", str(tmp_path / "x.npz")]) == 2
    assert re.search(r"m\.safetensors: the array `.+` is torn", said(capsys))
    assert not (tmp_path / "x.npz").exists()


def test_map_writes_the_map_and_its_picture(capsys, tmp_path):
    out = tmp_path / "map.npz"
    assert main(["map", "half/0", "--resolution", "20", "--out", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)

    chart = PBMap.load(out)
    assert chart.resolution == 20
    assert figures["appropriate_pct"] == pytest.approx(100 * chart.appropriate.mean())
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_score_knows_a_basic_action(capsys, tmp_path, demonstrations):
    path = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[2], demonstrations.dt_s)

    assert main(["score", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (row,) = found["files"]
    assert found["set"] is None
    assert (row["outcome"], row["nearest"]) == ("learned", demonstrations.names[2])
    assert row["distance"] < 0.01


def test_several_movements_of_any_format_are_measured_as_a_set(capsys, tmp_path, demonstrations):
    paths = [
        save_trajectory(tmp_path / f"{k}.csv", demonstrations.trajectories[k], demonstrations.dt_s) for k in (0, 2)
    ]
    assert main(["export", "--csv", str(paths[0]), "--out", str(tmp_path / "a.motion")]) == 0
    capsys.readouterr()

    assert main(["score", str(tmp_path / "a.motion"), str(paths[1]), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["nearest"] for row in found["files"]] == ["left_jab", "left_hook"]
    assert found["set"]["n_appropriate"] == 2
    assert found["set"]["diversity"] == pytest.approx(35.17, abs=0.05)
    assert 1.9 < found["set"]["vendi_score"] <= 2


def test_memories_lists_what_ships(capsys):
    assert main(["memories", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}

    assert list(rows) == list(shipped_memories())
    assert rows["half/0"]["split"] == "train"
    assert rows["half/0"]["worst_reproduction_dtw"] < 10.0


NIGHTLY = pytest.mark.slow


@pytest.mark.parametrize("name", [*(pytest.param(name, marks=NIGHTLY) for name in ("open/15", "closed/0")), "half/7"])
def test_the_shipped_scores_are_those_of_the_shipped_memories(name):
    """A memory of each condition is scored again, whole map and all; the scores of each are there."""
    shipped = shipped_scores()

    assert list(shipped) == list(shipped_memories())
    assert score_memory(name) == pytest.approx(shipped[name], rel=1e-9)


def test_train_writes_a_memory_that_says_how_it_was_made(capsys, tmp_path):
    out = tmp_path / "m.safetensors"
    assert main(["train", "--n-epochs", "20", "--seed", "5", "--out", str(out), "--json"]) == 0
    memory = load_memory(out)

    assert memory.training.seed == 5
    assert memory.record["command"] == (
        "creative-nao train --closed-loop-ratio 0.5 --n-epochs 20 --seed 5 --out m.safetensors"
    )
    assert set(json.loads(capsys.readouterr().out)["reproduction_dtw"]) == set(load_demonstrations().names)
    assert [file.name for file in tmp_path.iterdir()] == ["m.safetensors"]


def test_train_ends_with_a_verdict_on_what_comes_back(capsys, tmp_path):
    words = ["train", "--condition", "auto", "half", "--n-epochs", "20", "--out", str(tmp_path / "many")]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "auto: 0 of 1 networks give every basic action back" in out
    assert "ratio 0.5: 0 of 1 networks give every basic action back" in out
    assert "half-0: 0 of 6 basic actions come back within DTW 10 in closed loop; not: left_jab (" in out
    assert "Try the condition auto" in out
    record = load_memory(str(tmp_path / "many" / "auto-0.safetensors")).record
    assert record["command"] == "creative-nao train --condition auto half --n-epochs 20 --seed 0 --out many"
    assert [one["n_epochs"] for one in record["attempts"]] == [20]


@pytest.mark.parametrize(
    "kill", [signal.SIGINT, *(pytest.param(kill, marks=NIGHTLY) for kill in (signal.SIGTERM, signal.SIGKILL))]
)
def test_a_killed_training_goes_on_with_the_same_bits(kill, tmp_path):
    """Ctrl-C leaves a checkpoint and exit code 130; kill -9 loses what came after the last one."""
    words = ["train", "--n-epochs", "1500", "--checkpoint-interval", "200"]
    words += ["--network.layer-sizes", "8", "4", "--network.time-constants", "2", "5"]
    command = [sys.executable, "-m", "creative_nao", *words]
    out, checkpoint = tmp_path / "m", tmp_path / "m.checkpoint"
    run = subprocess.Popen([*command, "--out", str(out)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not checkpoint.exists() and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    os.kill(run.pid, kill)
    code = run.wait(60)

    assert code == (-signal.SIGKILL if kill == signal.SIGKILL else 130)
    assert not out.exists()
    assert main([*words, "--out", str(out), "--resume"]) == 0
    assert main([*words, "--out", str(tmp_path / "whole")]) == 0
    resumed, whole = load_memory(out), load_memory(tmp_path / "whole")
    assert all(np.array_equal(resumed.parameters[name], whole.parameters[name]) for name in whole.parameters)
    assert np.array_equal(resumed.loss_history, whole.loss_history)
    assert not checkpoint.exists()


def test_several_networks_go_into_a_folder_with_their_success(capsys, tmp_path):
    out = tmp_path / "bank"
    words = ["train", "--n-epochs", "30", "--closed-loop-ratio", "0", "0.5", "--seed", "1", "2", "--out", str(out)]
    assert main([*words, "--network.layer-sizes", "6", "--network.time-constants", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)

    assert {file.name for file in out.iterdir()} == {
        "open-1.safetensors", "open-2.safetensors", "half-1.safetensors", "half-2.safetensors", "training.json",
    }  # fmt: skip
    assert [row["name"] for row in told] == ["open-1", "half-1", "open-2", "half-2"]
    assert json.loads((out / "training.json").read_text())["networks"] == told
    alone = tmp_path / "alone"
    short = ["--network.layer-sizes", "6", "--network.time-constants", "2", "--out", str(alone)]
    assert main(["train", "--n-epochs", "30", "--closed-loop-ratio", "0", "--seed", "2", *short]) == 0
    one, other = load_memory(alone), load_memory(out / "open-2.safetensors")
    assert all(np.array_equal(one.parameters[name], other.parameters[name]) for name in one.parameters)


def test_a_network_that_diverges_is_recorded_and_the_others_go_on(capsys, tmp_path):
    """The rate is so large that the weights leave the numbers within a few epochs."""
    words = ["train", "--n-epochs", "30", "--learning-rate", "1e30", "--seed", "1", "2", "--out", str(tmp_path / "b")]
    assert main([*words, "--network.layer-sizes", "6", "--network.time-constants", "2"]) == 0
    networks = json.loads((tmp_path / "b" / "training.json").read_text())["networks"]

    assert all("no longer finite at epoch" in row["failure"] for row in networks)
    assert "failed: the loss is no longer finite" in capsys.readouterr().out
    assert main([*words[:5], "--out", str(tmp_path / "one")]) == 2
    assert "no longer finite at epoch" in said(capsys)


def test_an_old_checkpoint_is_not_overwritten(capsys, tmp_path):
    (tmp_path / "m.checkpoint").write_bytes(b"precious")

    assert main(["train", "--n-epochs", "5", "--out", str(tmp_path / "m")]) == 2
    assert "go on from it with --resume, or remove it" in said(capsys)
    assert (tmp_path / "m.checkpoint").read_bytes() == b"precious"


def test_doctor_says_what_is_there(capsys):
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)

    assert found["versions"]["creative-nao"] == creative_nao.__version__
    assert found["rendering"] in ("egl", "osmesa", "disable")
