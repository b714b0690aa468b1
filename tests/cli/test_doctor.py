"""The doctor tells the truth about this machine, and never fails."""

import json
import os
import subprocess
import sys

import pytest

from creative_nao.cli import doctor, main
from creative_nao.robot import can_draw, opengl


@pytest.fixture(scope="module")
def found():
    return doctor.examine()


def test_it_tells_what_is_there(found):
    assert found["versions"]["python"] == sys.version.split()[0]
    assert 1 <= found["cores"] <= os.cpu_count()
    assert 0 < found["memory_gib"]["available"] <= found["memory_gib"]["total"]
    assert found["torch_threads"] >= 1
    assert list(found["back_ends"]) == ["egl", "osmesa", "glfw"]
    assert found["numba_cache"]["writable"]


def test_a_back_end_that_works_here_is_said_to_work(found):
    assert found["software_renderer"] is not can_draw() or os.environ.get("MUJOCO_GL") in opengl.OFF
    if found["rendering"] != "disable":
        assert found["back_ends"][found["rendering"]]["works"]


def test_each_state_is_said_with_the_packages_that_help(found, capsys, monkeypatch):
    broken = found | {"back_ends": {n: {"works": False, "reason": "why", "apt": p} for n, p in opengl.PACKAGES.items()}}
    monkeypatch.setattr(doctor, "examine", lambda: broken | {"software_renderer": True, "video": False})
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out

    assert "rendering: egl       no: why; apt-get install libegl1 libgl1-mesa-dri libopengl0" in text
    assert "rendering: osmesa    no: why; apt-get install libosmesa6" in text
    assert "rendering: software  used" in text
    assert "MP4 films            no: pip install imageio-ffmpeg" in text


def test_it_works_where_nothing_else_does(tmp_path):
    """No GL asked for, a cache folder that cannot be made."""
    (tmp_path / "file").write_text("")
    environment = os.environ | {"MUJOCO_GL": "disable", "NUMBA_CACHE_DIR": str(tmp_path / "file" / "cache")}
    command = [sys.executable, "-m", "creative_nao", "doctor", "--json"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)

    assert found["software_renderer"] is True
    assert found["numba_cache"] == {"folder": str(tmp_path / "file" / "cache"), "writable": False, "shared": False}


@pytest.mark.skipif(os.name != "posix", reason="modes of POSIX")
def test_a_cache_that_others_can_write_is_told(tmp_path, monkeypatch, found, capsys):
    """What numba finds there it unpickles."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    tmp_path.chmod(0o777)
    cache = doctor._numba_cache()
    assert cache["shared"]
    monkeypatch.setattr(doctor, "examine", lambda: found | {"numba_cache": cache})
    assert main(["doctor"]) == 0
    assert "nobody else may write to it" in capsys.readouterr().out
    tmp_path.chmod(0o700)
    assert not doctor._numba_cache()["shared"]


def test_a_back_end_that_breaks_is_told_with_its_reason(monkeypatch):
    monkeypatch.setattr(opengl, "_missing", lambda backend: "")
    assert "vulkan" in opengl.probe("vulkan")  # dm_control or mujoco, whichever notices first
    assert opengl.probe("egl", timeout_s=0.001) == "no answer within 0.001 s"


@pytest.mark.parametrize(
    ("backend", "reason"),
    [("egl", "libEGL is missing"), ("osmesa", "libOSMesa is missing"), ("glfw", "no display; xvfb-run gives")],
)
def test_what_is_missing_is_said_in_words(backend, reason, monkeypatch):
    monkeypatch.setattr(opengl, "_loads", lambda library: False)
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)

    assert opengl.probe(backend).startswith(reason)
