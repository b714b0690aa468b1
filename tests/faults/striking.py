"""Run a command, strike it at a seeded moment, go on, and see what is left."""

import json
import os
import re
import subprocess
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from struck_commands import COMMANDS, RUN_FOLDER
from whole_files import contents, remains

STRUCK = Path(__file__).parent / "struck"
SIGNALS = ("kill -9", "SIGINT", "SIGTERM")
DISKS = ("full disk", "read-only folder", "folder removed")
CLOCKS = ("clock jumps back", "clock jumps ahead")
TWO = "two at once"
FAULTS = (*SIGNALS, *DISKS, *CLOCKS, TWO)
CASES = [
    (name, fault, number) for name in COMMANDS for fault in FAULTS for number in range(2 if fault in SIGNALS else 1)
]
"""Each command under each fault; signals at two moments: within a touch, and a moment later."""
EXPLORER_CASES = [("explore", fault, 0) for fault in FAULTS]
LONGEST_S = 900


@dataclass(frozen=True)
class Ended:
    """How a process ended, and what it touched in its run folder: who, what and which file."""

    code: int
    said: str
    touches: tuple[tuple[str, str, str], ...] = field(default=(), repr=False)
    struck: bool = False

    def kept(self, ending):
        """Return how often a file whose name ends so was put in its place."""
        return sum(what == "os.rename" and name.endswith(ending) for _, what, name in self.touches)

    @property
    def n_touches(self):
        return sum(who == "runner" for who, _, _ in self.touches)


def case_name(name, fault, number):
    """Return how a case is called in the record."""
    return f"{name} | {fault} | {number}"


def start(command, folder, *, fault="none", moment=-1, delay_s=0.0, more=(), name="run"):
    """Start a command in a working folder with a fault to come."""
    folder.mkdir(exist_ok=True)
    command.prepare(folder)
    log, mark = folder / f"{name}.touches", folder / f"{name}.struck"
    plan = {
        "folder": str(folder / RUN_FOLDER), "fault": fault, "moment": moment, "delay_s": delay_s,
        "log": str(log), "mark": str(mark),
    }  # fmt: skip
    path = os.pathsep.join([str(STRUCK), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "STRIKE": json.dumps(plan), "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    environment["CREATIVE_NAO_CACHE"] = str(folder / command.cache)
    for name in ("PYTEST_CURRENT_TEST",):
        environment.pop(name, None)
    process = subprocess.Popen(
        [*command.start, *command.words, *more], cwd=folder, env=environment, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    return process, log, mark


def end(started):
    """Wait for a started command."""
    process, log, mark = started
    _, said = process.communicate(timeout=LONGEST_S)
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    touches = tuple(tuple(line.split(" ", 2)) for line in lines)
    return Ended(process.returncode, said, touches, mark.exists())


def run(command, folder, **options):
    """Run a command to its end."""
    return end(start(command, folder, **options))


def draw(name, fault, number, n_touches):
    """Return the seeded moment of a case: at which touch, and how long after it [s]."""
    rng = np.random.default_rng([zlib.crc32(f"{name}/{fault}".encode()), number])
    moment = int(rng.integers(1, n_touches + 1))
    delay_s = round(float(rng.uniform(0.05, 0.4)), 2) if fault in SIGNALS and number % 2 else 0.0
    return moment, delay_s


def last_line(said):
    """Return the one line that a stopped command says, without places of this machine; the rest must be progress."""
    assert "Traceback" not in said, said
    told = [line for line in said.splitlines() if not re.search(r"\d+/\d+,|jobs done|s left", line)]
    assert len(told) <= 1, said
    return told[0] if told else ""


def check_code(fault, code):
    """The exit code tells what happened: success, a full or vanished place, stopped, killed."""
    if fault == "kill -9":
        assert code == -9
    elif fault in SIGNALS:
        assert code in (0, 130)  # 0 when everything was done already
    elif fault in DISKS:
        assert code in (0, 2)  # 0 when nothing more had to be written
    else:
        assert code == 0


def go_on(command, folder, ended):
    """Finish what was struck, as its user would."""
    out = folder / RUN_FOLDER
    more = command.resume(out)
    if ended.code == 0 and all((out / name).exists() for name in command.files):
        return Ended(0, "")  # it had finished
    return run(command, folder, more=more, name="resumed")


def check_equal(command, folder, whole):
    """Nothing is left half-written, and every result equals that of a run that nothing disturbed, bit for bit."""
    out = folder / RUN_FOLDER
    assert remains(out) == []
    found = contents(out)
    assert set(command.files) <= set(found), sorted(found)
    assert set(found) <= set(whole), sorted(set(found) - set(whole))
    for name in found:
        assert found[name] == whole[name], name
