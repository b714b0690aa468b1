"""`creative-nao export` as a user meets it."""

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from creative_nao import exchange
from creative_nao.cli import main
from creative_nao.demonstrations import load_trajectory, save_trajectory
from creative_nao.joints import LIMITS_RAD


@pytest.fixture
def memory(tiny_memory, tmp_path_factory):
    return str(tiny_memory.save(tmp_path_factory.mktemp("memory") / "tiny.safetensors"))


def said(capsys):
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error.strip()


def test_a_pb_value_becomes_a_file_that_says_where_it_comes_from(memory, tiny_memory, tmp_path, capsys):
    out = tmp_path / "new.npz"
    assert main(["export", memory, "--pb", "0.3", "-0.1", "--unsafe", "keep", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = exchange.read(out)

    assert np.array_equal(found.motion.angles, tiny_memory.generate(np.array([[0.3, -0.1]]))[0])
    assert (told["n_steps"], told["dt_s"], told["out"]) == (50, 0.15, str(out))
    assert found.motion.metadata["pb"] == [0.3, -0.1]
    assert found.motion.metadata["memory"] == memory
    assert found.motion.metadata["source"] == told["source"] == f"memory {memory} at PB [0.3, -0.1]"
    assert {"command", "versions"} <= set(found.motion.metadata)


def test_the_length_of_a_generated_movement_can_be_chosen(memory, tmp_path, capsys):
    words = ["export", memory, "--pb", "0", "0", "--n-steps", "80", "--unsafe", "clip", "--json"]
    assert main([*words, "--out", str(tmp_path / "a.yaml")]) == 0
    assert json.loads(capsys.readouterr().out)["n_steps"] == 80


def test_a_basic_action_becomes_a_program_that_runs(tmp_path, capsys, demonstrations):
    out = tmp_path / "jab.py"
    assert main(["export", "half/0", "--action", "left_jab", "--out", str(out)]) == 0

    assert "the first posture is reached after" in capsys.readouterr().out
    done = subprocess.run([sys.executable, str(out)], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("dry run")
    assert "basic action left_jab of memory half/0" in done.stdout
    np.testing.assert_allclose(exchange.read(out).motion.angles, demonstrations.trajectory("left_jab"), atol=1e-12)


@pytest.mark.parametrize("option", ["--csv", "--from"])
def test_a_recording_goes_through_every_format_and_back(option, tmp_path, demonstrations):
    source = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[3], demonstrations.dt_s)
    for name in ("a.motion", "b.yaml", "c.json", "d.py", "e.npz", "back.csv"):
        flag = option if source.suffix == ".csv" else "--from"
        assert main(["export", flag, str(source), "--out", str(tmp_path / name)]) == 0
        source = tmp_path / name

    assert np.array_equal(load_trajectory(source), demonstrations.trajectories[3])


def test_a_recording_in_degrees_is_recognised_and_said(tmp_path, demonstrations, capsys):
    path = tmp_path / "a.json"
    degrees = np.degrees(demonstrations.trajectories[0])
    times = [0.15 * step for step in range(50)]
    path.write_text(json.dumps({"names": demonstrations.joints, "times": times, "angles": degrees.T.tolist()}))

    assert main(["export", "--from", str(path), "--out", str(tmp_path / "a.csv")]) == 0
    assert "angles converted from degrees" in capsys.readouterr().out
    np.testing.assert_allclose(load_trajectory(tmp_path / "a.csv"), demonstrations.trajectories[0], atol=1e-12)


@pytest.fixture
def wild(tmp_path, demonstrations):
    """The left jab with one joint out of its range and one too fast."""
    angles = demonstrations.trajectories[0].copy()
    angles[10:13, 3] = LIMITS_RAD["RElbowRoll"][1] + 0.01
    angles[30, 4] -= 1.5
    return save_trajectory(tmp_path / "wild.csv", angles, demonstrations.dt_s)


def test_unsafe_motion_is_refused_with_one_line(wild, tmp_path, capsys):
    assert main(["export", "--csv", str(wild), "--format", "naoqi", "--out", str(tmp_path / "a.py")]) == 2
    line = said(capsys)

    assert "unsafe movement: RElbowRoll at 1.50 to 1.80 s is up to 0.0100 rad beyond its range" in line
    assert "--unsafe clip" in line
    assert not (tmp_path / "a.py").exists()


def test_clip_says_what_where_when_and_by_how_much(wild, tmp_path, capsys):
    out = tmp_path / "a.py"
    assert main(["export", "--csv", str(wild), "--out", str(out), "--unsafe", "clip", "--json"]) == 0
    clipped, slowed = json.loads(capsys.readouterr().out)["changes"]

    assert clipped.startswith("clipped: RElbowRoll at 1.50 to 1.80 s is up to 0.0100 rad beyond")
    assert slowed.startswith("slowed: LShoulderPitch would move at")
    motion = exchange.read(out).motion
    assert exchange.inspect(motion) == []
    assert motion.dt_s > 0.15


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give one of --pb, --action, --csv and --from, but there is none of them"),
        (["--pb", "0", "0", "--action", "left_jab"], "but there is --pb and --action"),
        (["--pb", "0.1"], "`pb` should have shape (n, 2), but has (1, 1)"),
        (["--pb", "2", "0"], "`pb` should lie in [-1, 1]"),
        (["--action", "left_jap"], "(did you mean `left_jab`?)"),
        (["--action", "left_jab", "--n-steps", "3"], "--n-steps is for --pb"),
        (["--action", "left_jab", "--dt-s", "0.1"], "--dt-s is for --csv and --from"),
        (["--csv", "none.csv"], "no movement at none.csv"),
        (["--action", "left_jab", "--format", "gif"], "a film of the format gif should end in .gif"),
        (["--action", "left_jab", "--format", "ros"], "of the format ros should end in .yaml"),
        (["--action", "left_jab", "--format", "ross"], "invalid choice"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_code_2(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    assert main(["export", *words, "--out", "a.csv"]) == 2
    assert message in said(capsys)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_ending_lists_the_known_ones(capsys, tmp_path):
    assert main(["export", "--action", "left_jab", "--out", str(tmp_path / "a.fbx")]) == 2
    assert "known endings are .csv (csv), .npz (npz), .py (naoqi)" in said(capsys)


@pytest.mark.parametrize("imagined", [True, False])
def test_a_film_shows_the_movement(imagined, tmp_path, capsys, demonstrations):
    path = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[1][:12], demonstrations.dt_s)
    out = tmp_path / "film.gif"
    words = ["export", "--csv", str(path), "--out", str(out), "--width", "96", "--height", "72", "--json"]
    assert main([*words, *(["--imagined"] if imagined else [])]) == 0
    told = json.loads(capsys.readouterr().out)

    assert told["notes"][0 if imagined else -2].startswith("imagined" if imagined else "performed") or imagined
    with Image.open(out) as film:
        assert (film.size, film.n_frames) == ((96, 72), 34)
        assert film.info["duration"] == 50
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(15)
        assert (np.abs(np.asarray(film.convert("RGB")) - first) > 40).any(axis=2).sum() > 20
    assert json.loads((tmp_path / "film.gif.record.json").read_text())["source"] == "recording a.csv"


def test_an_mp4_without_its_package_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)

    assert main(["export", "--action", "left_jab", "--out", str(tmp_path / "a.mp4")]) == 2
    assert "an MP4 needs imageio-ffmpeg (the extra `video`): run `pip install imageio-ffmpeg`" in said(capsys)
    assert not list(tmp_path.iterdir())


def test_an_mp4_is_written(tmp_path, capsys, demonstrations):
    pytest.importorskip("imageio_ffmpeg")
    path = save_trajectory(tmp_path / "a.csv", demonstrations.trajectories[1][:5], demonstrations.dt_s)
    words = ["export", "--csv", str(path), "--width", "96", "--imagined"]

    assert main([*words, "--height", "72", "--out", str(tmp_path / "a.mp4")]) == 0
    assert (tmp_path / "a.mp4").read_bytes()[4:8] == b"ftyp"
    capsys.readouterr()
    assert main([*words, "--height", "71", "--out", str(tmp_path / "b.mp4")]) == 2
    assert "should be even, but are 96 and 71" in said(capsys)
