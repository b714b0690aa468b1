"""A movement as a program for the robot: plain Python 2.7 or 3, no package needed but the robot's own.

The program calls `ALMotion.angleInterpolation` through `naoqi` or `qi`; where neither is installed it prints what it
would do. Everything that comes from outside enters it as a Python literal in ASCII, so that no name or note can become
code.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

from creative_nao import atomic
from creative_nao.demonstrations.resampling import resample
from creative_nao.exchange.motion import APPROACH_SPEED_RAD_S, Motion

MAX_KEYS_PER_S = 50
"""The robot's motion process takes a new target every 20 ms; more keys would be lost."""

_SHORTEST_S = 1.0 / MAX_KEYS_PER_S

_HEAD = '''#!/usr/bin/env python
# -*- coding: ascii -*-
"""Let a NAO perform a recorded movement of its arms, or print what it would do.

    python {file} --ip 192.168.1.12 --slower 3     first, slowly
    python {file} --ip 192.168.1.12

The robot must stand or sit safely and have room for its arms. Stiffness of the arm joints is raised for the movement
and set back afterwards. Without --ip, or where neither naoqi nor qi is installed, this is a dry run.
Needs Python 2.7 or 3.
"""
from __future__ import print_function

import argparse
import json
import sys

# Angles are absolute [rad], times in seconds from the start of the call. The first key leaves the time to reach the
# first posture from anywhere at {approach} rad/s at most.
'''

_TAIL = '''

def connect(ip, port):
    """Return the robot's motion service, or None where no library to reach a robot is installed."""
    try:
        from naoqi import ALProxy
    except ImportError:
        try:
            import qi
        except ImportError:
            return None
        session = qi.Session()
        session.connect("tcp://%s:%d" % (ip, port))
        return session.service("ALMotion")
    return ALProxy("ALMotion", ip, port)


def dry_run(when, stiffness):
    """Print what the robot would be asked."""
    print("dry run: nothing is sent to a robot")
    print("source: %s" % json.dumps(metadata.get("source", "unknown")))  # ASCII, whatever the console
    print("stiffness %.2f, %d joints, %.2f s, first posture after %.2f s" % (
        stiffness, len(names), when[0][-1], when[0][0]))
    for name, one_times, one_keys in zip(names, when, keys):
        steps = zip(one_keys[1:], one_keys[:-1], one_times[1:], one_times[:-1])
        fastest = max([abs(b - a) / (t - s) for b, a, t, s in steps] or [0.0])
        print("%-16s %4d keys, %7.3f to %7.3f rad, up to %5.2f rad/s" % (
            name, len(one_keys), min(one_keys), max(one_keys), fastest))


def main():
    parser = argparse.ArgumentParser(description="Perform a recorded movement on a NAO.")
    parser.add_argument("--ip", default="", help="address of the robot; without it this is a dry run")
    parser.add_argument("--port", type=int, default=9559, help="port of the robot (default: 9559)")
    parser.add_argument("--stiffness", type=float, default=0.8, help="0 to 1, of the arm joints (default: 0.8)")
    parser.add_argument("--slower", type=float, default=1.0, help="how many times slower, at least 1 (default: 1)")
    parser.add_argument("--dry-run", action="store_true", help="print what would be done")
    options = parser.parse_args()
    if not 0.0 < options.stiffness <= 1.0:
        parser.error("--stiffness should be above 0 and at most 1")
    if not options.slower >= 1.0:
        parser.error("--slower should be at least 1")
    when = [[t * options.slower for t in one] for one in times]
    motion = None
    if options.ip and not options.dry_run:
        motion = connect(options.ip, options.port)
        if motion is None:
            print("neither naoqi nor qi is installed", file=sys.stderr)
    if motion is None:
        dry_run(when, options.stiffness)
        return 0
    before = motion.getStiffnesses(names)
    motion.stiffnessInterpolation(names, [options.stiffness] * len(names), [0.5] * len(names))
    try:
        motion.angleInterpolation(names, keys, when, True)
    finally:
        motion.stiffnessInterpolation(names, list(before), [1.0] * len(names))
    return 0


if __name__ == "__main__":
    sys.exit(main())
'''


def script(motion: Motion, file: str = "movement.py") -> str:
    """Return the program's text; `file` is the name by which its help calls it."""
    lead = motion.lead_s()
    times = motion.times_s(lead)
    called = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in file)
    lines = [
        f"names = {_rows([ascii(joint) for joint in motion.joints])}",
        f"times = {_rows([repr(times)] * len(motion.joints))}",
        f"keys = {_rows([repr(column.tolist()) for column in motion.angles.T])}",
        f"metadata = json.loads({json.dumps(motion.metadata)!a})",
    ]
    return _HEAD.format(file=called, approach=APPROACH_SPEED_RAD_S) + "\n".join(lines) + "\n" + _TAIL


def write_script(motion: Motion, path: Path) -> list[str]:
    """Write the program; finer ticks than 20 ms are brought to 20 ms first."""
    notes = []
    if motion.dt_s < _SHORTEST_S * (1.0 - 1e-9):
        notes.append(f"keys every {motion.dt_s:g} s brought to {_SHORTEST_S:g} s, {MAX_KEYS_PER_S} a second")
        times = np.arange(len(motion.angles)) * motion.dt_s
        fine = resample(times, motion.angles, _SHORTEST_S) if len(times) > 1 else motion.angles
        motion = dataclasses.replace(motion, angles=fine, dt_s=_SHORTEST_S)
    atomic.write_text(path, script(motion, path.name))
    path.chmod(path.stat().st_mode | 0o111)
    return [*notes, f"the first posture is reached after {motion.lead_s():g} s"]


def _rows(values: list[str]) -> str:
    return "[\n    " + ",\n    ".join(values) + ",\n]"
