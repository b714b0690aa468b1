"""A movement as a skeleton in BVH, which Blender and other animation programs read.

The skeleton is the NAO's, in centimetres, y up, facing z, its left at x. A shoulder's three channels are pitch, roll
and elbow yaw, an elbow's one that turns is its roll; the elbow lies on the axis of the upper arm (on the robot 15 mm
beside it), so that the direction of an upper arm in the file is the one that the robot's angles mean.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange.keys import NOTHING_SAID, Keys, Reading
from creative_nao.exchange.motion import Motion
from creative_nao.joints import JOINTS

_HIP_HEIGHT_CM = 24.81
_TURNS = "CHANNELS 3 Xrotation Yrotation Zrotation"
_BONES: tuple[tuple[int, str, tuple[float, float, float]], ...] = (
    (1, "Spine", (0.0, 8.5, 0.0)),
    (2, "Head", (0.0, 12.65, 0.0)),
    (3, "", (0.0, 11.0, 0.0)),
    *(
        bone
        for side, x in (("Right", -1.0), ("Left", 1.0))
        for bone in (
            (2, f"{side}Arm", (9.8 * x, 10.0, 0.0)),
            (3, f"{side}ForeArm", (0.0, 0.0, 10.5)),
            (4, f"{side}Hand", (0.0, 0.0, 5.595)),
            (5, "", (0.0, -1.231, 5.775)),
        )
    ),
    *(
        bone
        for side, x in (("Right", -1.0), ("Left", 1.0))
        for bone in (
            (1, f"{side}UpLeg", (5.0 * x, 0.0, 0.0)),
            (2, f"{side}Leg", (0.0, -10.0, 0.0)),
            (3, f"{side}Foot", (0.0, -10.29, 0.0)),
            (4, "", (0.0, -4.519, 6.0)),
        )
    ),
)
"""Depth below the hips, name (none: the end of a bone) and offset from the parent [cm], from the link lengths."""


def write_bvh(motion: Motion, path: Path) -> list[str]:
    """Write a movement of the eight arm joints; SettingsError for others. One frame for each posture."""
    if motion.joints != JOINTS:
        raise SettingsError(f"a skeleton needs the joints {', '.join(JOINTS)}; this movement has other ones.")
    lines = ["HIERARCHY", "ROOT Hips", "{", f"  OFFSET 0 {_HIP_HEIGHT_CM} 0"]
    lines.append("  CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation")
    names, open_at = ["Hips"], [0]
    for depth, name, offset in _BONES:
        while open_at[-1] >= depth:
            lines.append("  " * open_at.pop() + "}")
        space = "  " * depth
        lines += [f"{space}{f'JOINT {name}' if name else 'End Site'}", space + "{"]
        lines.append(f"{space}  OFFSET {' '.join(f'{one:g}' for one in offset)}")
        if name:
            lines.append(f"{space}  {_TURNS}")
            names.append(name)
        open_at.append(depth)
    lines += ["  " * depth + "}" for depth in reversed(open_at)]
    turns = np.zeros((len(motion.angles), len(names), 3))
    degrees = np.degrees(motion.angles)
    for side, first in (("Right", 0), ("Left", 4)):
        turns[:, names.index(f"{side}Arm")] = degrees[:, first : first + 3]
        turns[:, names.index(f"{side}ForeArm"), 1] = degrees[:, first + 3]
    lines += ["MOTION", f"Frames: {len(turns)}", f"Frame Time: {motion.dt_s:.9g}"]
    root = f"0 {_HIP_HEIGHT_CM} 0 "
    lines += [root + " ".join(f"{angle:.9g}" for angle in frame.ravel()) for frame in turns]
    storage.write_text(path, "\n".join(lines) + "\n")
    return ["a skeleton in centimetres, y up, facing z"]


def refuse_bvh(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Refuse a skeleton as a recording of joint angles: it moves a body, which is yet to be brought to the robot."""
    raise FileFormatError(
        f"{path}: is the skeleton of a body, no recording of a robot; make actions of it with "
        f"`creative-nao teach --from {path.name} --out DIR`."
    )
