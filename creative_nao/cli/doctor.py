"""`creative-nao doctor`: what this machine has, and what would help where something is missing."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao.cli.terminal import print_result
from creative_nao.errors import MissingDependencyError
from creative_nao.robot import opengl
from creative_nao.runtime import usable_cores, versions

_GIB = 2**30


@dataclass(frozen=True)
class DoctorSettings:
    """Say which versions are installed, what the machine has and how frames can be drawn."""

    json: bool = False
    """Print it as JSON."""


def run(settings: DoctorSettings) -> int:
    """Print the findings; exit code 0 whatever is missing, since the software renderer draws everywhere."""
    found = examine()
    print_result(found, _lines(found), as_json=settings.json)
    return 0


def examine() -> dict[str, Any]:
    """Return everything there is to know, as plain JSON values."""
    back_ends = {name: opengl.probe(name) for name in opengl.ON}
    in_software = opengl.asked in opengl.OFF or all(back_ends.values())
    return {
        "versions": versions(),
        "platform": sys.platform,
        "cores": usable_cores(),
        "memory_gib": _memory_gib(),
        "display": os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY") or None,
        "mujoco_gl": opengl.asked or None,
        "back_ends": {
            name: {"works": not reason, "reason": reason or None, "apt": opengl.PACKAGES[name]}
            for name, reason in back_ends.items()
        },
        "rendering": opengl.working_backend(),
        "software_renderer": in_software,
        "dm_control": _dm_control(),
        "numba_cache": _numba_cache(),
        "torch_threads": _torch_threads(),
        "video": importlib.util.find_spec("imageio_ffmpeg") is not None,
    }


def _memory_gib() -> dict[str, float | None]:
    """Return the machine's memory and what is free of it [GiB]; None where the system does not tell."""
    try:
        page = os.sysconf("SC_PAGE_SIZE") / _GIB
        total, free = page * os.sysconf("SC_PHYS_PAGES"), page * os.sysconf("SC_AVPHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return {"total": None, "available": None}
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        told = dict(line.split(":", 1) for line in lines if ":" in line)
        free = int(told["MemAvailable"].split()[0]) * 1024 / _GIB  # caches count as available, unlike above
    except (OSError, KeyError, ValueError):
        pass
    return {"total": round(total, 1), "available": round(free, 1)}


def _dm_control() -> dict[str, Any]:
    """Return whether `creative_nao.envs.load` works, and why not: without dm-control all else does."""
    try:
        importlib.import_module("creative_nao.envs.boxing_task")
    except Exception as error:  # a doctor finishes, whatever another library says
        known = isinstance(error, MissingDependencyError)
        return {"works": False, "reason": str(error) if known else f"{type(error).__name__}: {error}"}
    return {"works": True, "reason": None}


def _numba_cache() -> dict[str, Any]:
    """Return where numba keeps compiled functions: the first folder it can write to, in numba's own order."""
    beside = Path(__file__).parents[1] / "measures" / "__pycache__"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    asked = os.environ.get("NUMBA_CACHE_DIR")
    folders = [Path(asked)] if asked else [beside, home]
    usable = [folder for folder in folders if _writable(folder)]
    folder = (usable or folders)[0]
    return {"folder": str(folder), "writable": bool(usable), "shared": _others_write(folder)}


def _others_write(folder: Path) -> bool:
    """Tell whether other users may write there, or own it: numba's cache is pickles, which run what they hold."""
    here = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    try:
        found = here.stat()
    except OSError:
        return False
    foreign = hasattr(os, "getuid") and found.st_uid not in (os.getuid(), 0)
    return foreign or (os.name == "posix" and bool(found.st_mode & 0o022))


def _writable(folder: Path) -> bool:
    """Try to write: permissions alone tell nothing about a file system that is mounted for reading."""
    here = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    try:
        with tempfile.TemporaryFile(dir=here):
            return True
    except OSError:
        return False


def _torch_threads() -> int | None:
    try:
        return int(importlib.import_module("torch").get_num_threads())
    except ImportError:
        return None


def _lines(found: dict[str, Any]) -> list[str]:
    memory, cache, task = found["memory_gib"], found["numba_cache"], found["dm_control"]
    rows = {**found["versions"], "cores": found["cores"]}
    if memory["total"] is not None:
        rows["memory"] = f"{memory['available']:.1f} of {memory['total']:.1f} GiB available"
    rows["display"] = found["display"] or "none"
    rows["dm_control task"] = "works" if task["works"] else f"no: {task['reason']}"
    for name, state in found["back_ends"].items():
        advice = f"no: {state['reason']}; apt-get install {state['apt']}"
        rows[f"rendering: {name}"] = "works" if state["works"] else advice
    used = "used" if found["software_renderer"] else "works, not used"
    rows["rendering: software"] = f"{used} (MUJOCO_GL={found['mujoco_gl'] or 'not set'})"
    rows["MP4 films"] = "yes" if found["video"] else "no: pip install imageio-ffmpeg (GIF needs nothing)"
    advice = "" if cache["writable"] else ", cannot be written: every process compiles anew; set NUMBA_CACHE_DIR"
    shared = "; compiled code is loaded from there: nobody else may write to it" if cache["shared"] else ""
    rows["numba cache"] = f"{cache['folder']}{advice}{shared}"
    rows["torch threads"] = found["torch_threads"] or "torch is missing"
    return [f"{name:<20} {value}" for name, value in rows.items()]
