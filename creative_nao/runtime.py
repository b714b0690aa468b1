"""What every result carries: command, settings and versions that made it. The cores and children of this process."""

from __future__ import annotations

import datetime
import hashlib
import importlib.metadata
import json
import logging
import os
import platform
import shlex
import sys
import threading
import time
from pathlib import Path
from typing import Any

from creative_nao.errors import SettingsError
from creative_nao.storage import read_bytes

MAX_HASHED_BYTES = 256_000_000
NOTICE_S = 0.6
"""How long compilation is not worth a word [s]."""
PACKAGES = ("creative-nao", "numpy", "torch", "numba", "mujoco", "dm-control", "gymnasium", "stable-baselines3")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that can change a result; absent ones are left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def command_line() -> str:
    """Return the running command as one could type it again, with the program's folder left out."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def record(*, settings: dict[str, Any], command: str | None = None) -> dict[str, Any]:
    """Return the provenance of a result: command, settings, versions, platform and the time in UTC."""
    return {
        "command": command_line() if command is None else command,
        "settings": json.loads(json.dumps(settings)),  # tuples become lists here already, as they do in a file
        "versions": versions(),
        "platform": f"{platform.system()} {platform.machine()}",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def sha256(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a plain file as hexadecimal digits.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it has more than `MAX_HASHED_BYTES` or cannot be read.
    """
    return hashlib.sha256(read_bytes(Path(path), "file to be hashed", MAX_HASHED_BYTES)).hexdigest()


def usable_cores() -> int:
    """Return the cores that this process may use: fewer than the machine has where it is held to some of them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def python_command(module: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Return the command of a child interpreter that runs `main(arguments)` of a module of this very package.

    Nothing is imported from the current folder (``-P``), where a stranger's `numpy.py` may lie, and from the folder of
    this package only what is found nowhere else.
    """
    folder = str(Path(__file__).parents[1])
    begin = f"import sys; sys.path.insert(0, {folder!r}); import creative_nao; sys.path.append(sys.path.pop(0)); "
    code = f"{begin}from {module} import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-P", "-c", code, *map(str, arguments)]


def python_environment(**more: str) -> dict[str, str]:
    """Return the environment of a child interpreter, with `more`; an empty part of PYTHONPATH is the current folder."""
    parts = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, parts)), **more}


def search_current_folder() -> None:
    """Let modules that the user named be found in the current folder too, after all others."""
    if (here := os.getcwd()) not in sys.path and "" not in sys.path:
        sys.path.append(here)


def announce_compilation() -> None:
    """Have a process say it within a second, once, when it compiles machine code: the first use can take a minute.

    It is a warning of the logger `creative_nao`, which goes to stderr unless a program has set up logging.

    Raises:
        SettingsError: If numba is told not to compile; not all of this code can be interpreted.
    """
    from numba.core import config, event

    if config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]
        raise SettingsError("NUMBA_DISABLE_JIT is set, but movements are computed by compiled code only; unset it")

    class Listener(event.Listener):
        n_running, begun_s, said = 0, 0.0, False

        def on_start(self, event: object) -> None:
            self.n_running += 1
            if not self.begun_s:
                self.begun_s = time.monotonic()
                timer = threading.Timer(NOTICE_S, self.say)
                timer.daemon = True
                timer.start()
            elif time.monotonic() - self.begun_s > NOTICE_S:
                self.say()

        def on_end(self, event: object) -> None:
            self.n_running -= 1

        def say(self) -> None:
            if self.n_running and not self.said:
                self.said = True
                logging.getLogger("creative_nao").warning(
                    "creative-nao compiles code for this processor, which can take a minute; later runs find it ready"
                )

    event.register("numba:compile", Listener())
