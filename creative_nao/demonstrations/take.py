"""A person's movement as eight landmarks: read from motion capture (BVH) or a table, checked, cuts of it proposed.

Only directions are taken from a take, so the unit of length does not matter, as long as it is one. What a camera sees
in two dimensions, another order of left and right, or nobody standing cannot become angles of a robot's arms.
"""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError, load_extra
from creative_nao.exchange.keys import NOTHING_SAID, Reading
from creative_nao.exchange.table import read_csv
from creative_nao.schema import Field, checked, checked_path

LANDMARKS = ("RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "RHip", "LHip")
_NAMES = (
    "rightarm rightforearm righthand leftarm leftforearm lefthand rightupleg leftupleg",  # MotionBuilder, Mixamo, CMU
    "rshldr rforearm rhand lshldr lforearm lhand rthigh lthigh",  # Poser
    "rightupperarm rightforearm righthand leftupperarm leftforearm lefthand rightupperleg leftupperleg",
    "rightupperarm rightlowerarm righthand leftupperarm leftlowerarm lefthand rightupperleg leftupperleg",
    "rightarm rightforearm righthand leftarm leftforearm lefthand rightthigh leftthigh",
    "rupperarm rforearm rhand lupperarm lforearm lhand rthigh lthigh",  # Biped
    "upperarmr forearmr handr upperarml forearml handl thighr thighl",  # Blender
    "upperarmr lowerarmr handr upperarml lowerarml handl thighr thighl",  # Unreal
    "rshoulder relbow rwrist lshoulder lelbow lwrist rhip lhip",  # this project, SMPL
    "rightshoulder rightelbow rightwrist leftshoulder leftelbow leftwrist righthip lefthip",  # MediaPipe
    "shoulderright elbowright wristright shoulderleft elbowleft wristleft hipright hipleft",  # Kinect
    "12 14 16 11 13 15 24 23",  # MediaPipe by number
)
MAX_TAKE_BYTES = 30_000_000
_MAX_JOINTS, MAX_FRAMES = 1_000, 100_000
_BRIDGED_S = 0.1  # landmarks missing for so long are taken from before and after
_STANDING = 0.7  # cosine between the trunk and the vertical
_LOWPASS_HZ = 8.0
_SLOWEST, _HOME = 0.8, 0.35  # of proposed cuts: arm lengths a second that are a movement, arm lengths that are away

Up = Literal["auto", "y", "-y", "z"]
Facing = Literal["auto", "chest"] | Annotated[float, Field(ge=-360, le=360)]
Hertz = Annotated[float, Field(gt=0, le=100)]


@dataclass(frozen=True, eq=False)
class Take:
    """A person's movement at even times, y up; `missing` marks frames that nothing is known of.

    `places` are the landmarks, shape (n_frames, 8, 3), in the order of `LANDMARKS`; `dt_s` is the time between frames.
    """

    source: str
    places: np.ndarray
    dt_s: float
    missing: np.ndarray
    notes: tuple[str, ...]

    def lowpass(self, hz: float = _LOWPASS_HZ) -> np.ndarray:
        """Return the places without what is faster than `hz` (Butterworth, fourth order, forth and back)."""
        from scipy.signal import butter, filtfilt

        if hz >= 0.45 / self.dt_s or len(self.places) < 20:
            return self.places
        numerator, denominator = cast(tuple[np.ndarray, np.ndarray], butter(4, 2 * hz * self.dt_s))
        return filtfilt(numerator, denominator, self.places, axis=0)


def load_take(path: str | os.PathLike[str], *, reading: Reading | None = None, up: Up = "auto") -> Take:
    """Read a take: a BVH file, or a table with columns such as `RShoulder_x`, also with MediaPipe's and Kinect's names.

    Args:
        path: The file.
        reading: Frames a second of a table without times, its time column and unit.
        up: The vertical axis of the file; `auto` takes y, or -y where the trunk points there.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it holds no standing person in three dimensions; the message says why not.
        MissingDependencyError: If a BVH file is to be read without `pybvh` (the extra `mocap`).
    """
    path = checked_path(path)
    said: Reading = NOTHING_SAID if reading is None else checked(Reading, reading, "reading")
    content = storage.read_bytes(path, "take", MAX_TAKE_BYTES)
    if content[:2000].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"HIERARCHY"):
        times, places, notes = _from_bvh(path, content)
    else:
        times, places, notes = _from_table(path, content, said)
    if not 10 <= len(times) <= MAX_FRAMES:
        raise FileFormatError(f"{path}: has {len(times)} frames, expected 10 to {MAX_FRAMES}.")
    steps = np.diff(times)
    if not (steps > 0).all():
        raise FileFormatError(f"{path}: times should rise, but {times[1:][steps <= 0][0]:g} s does not.")
    dt_s = float(np.median(steps))
    mean_s = float(times[-1] - times[0]) / len(steps)
    dt_s = mean_s if abs(dt_s - mean_s) < 0.01 * dt_s else dt_s  # rounded times
    if not 1e-3 <= dt_s <= 0.2:
        raise FileFormatError(
            f"{path}: has a frame every {dt_s:g} s, expected every 0.001 to 0.2 s; --time-unit or --rate says it right."
        )
    times, places, missing, gaps = _evenly(times, places, dt_s)
    notes += gaps
    _check_body(path, places[~missing] if (~missing).sum() >= 10 else places[:0])
    places, turned = _upright(path, places, missing, up)
    take = Take(path.name, places, dt_s, missing, (*notes, *turned))
    _check_sides(path, take)
    return take


def _from_table(path: Path, content: bytes, reading: Reading) -> tuple[np.ndarray, np.ndarray, list[str]]:
    keys = read_csv(path, content, reading)[0]
    columns: dict[tuple[str, str], int] = {}
    for place, name in enumerate(keys.joints):
        found = re.fullmatch(r"(.+?)[ ._]?([xyz])|([xyz])[ ._]?(\d+)", name, re.IGNORECASE)
        if found:
            columns[_bare(found[1] or found[4]), (found[2] or found[3]).lower()] = place
    bodies = {name for name, _ in columns}
    family = _family(path, bodies)
    flat = [name for name in family if (name, "z") not in columns]
    if flat:
        raise FileFormatError(f"{path}: `{flat[0]}` has no z: keypoints in two dimensions cannot give these joints.")
    lost = [f"{name}_{axis}" for name in family for axis in "xy" if (name, axis) not in columns]
    if lost:
        raise FileFormatError(f"{path}: the column {lost[0]} is missing.")
    places = np.stack([[keys.angles[columns[name, axis]] for axis in "xyz"] for name in family]).transpose(2, 0, 1)
    if np.nanmax(np.abs(places), initial=0) > 1e6:
        raise FileFormatError(f"{path}: places of {np.nanmax(np.abs(places)):g}, expected metres or millimetres.")
    hips = np.nanmedian(np.abs(places[:, 6:].mean(axis=1)), axis=0) if np.isfinite(places).any() else np.zeros(3)
    if family[0] in ("rightshoulder", "12") and hips[:2].max() > 0.15 and np.nanmax(np.abs(places[..., :2])) < 1.5:
        raise FileFormatError(
            f"{path}: places within the picture (0 to 1), not in the world: expected pose_world_landmarks."
        )
    return keys.times[0], places, list(keys.notes)


def _from_bvh(path: Path, content: bytes) -> tuple[np.ndarray, np.ndarray, list[str]]:
    text = storage.as_text(content, f"{path}", "take")
    head = text.partition("MOTION")[0]
    if head.count("JOINT") > _MAX_JOINTS:
        raise FileFormatError(f"{path}: has more than {_MAX_JOINTS} joints.")
    pybvh: Any = load_extra("pybvh", "mocap", "a BVH file")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        copy = Path(folder) / "take.bvh"
        copy.write_bytes(text.encode("ascii", "replace"))  # it is read again in the encoding of the locale
        try:
            body = pybvh.read_bvh_file(copy, world_up="+y")
            angles, names = np.asarray(body.joint_angles), [_bare(name) for name in body.joint_names]
            places = np.asarray(body.joint_positions(), dtype=np.float64)
        except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
            told = " ".join(str(error).replace(f" in file {copy}", "").split())[:200]
            raise FileFormatError(f"{path}: no BVH that can be read ({told}).") from None
    if not np.isfinite(places).all():
        raise FileFormatError(f"{path}: holds a place that is not a finite number.")
    family, dt_s = _family(path, set(names)), float(body.frame_time)
    notes = [f"{1 / dt_s:.4g} frames a second"]
    if len(angles) > 2 and not angles[0].any() and angles[1:].any(axis=(1, 2)).all():
        places, notes = places[1:], [*notes, "the first frame, a rest pose, was left out"]
    return np.arange(len(places)) * dt_s, places[:, [names.index(name) for name in family]], notes


def _bare(name: str) -> str:
    """Return a name without prefix, marks and capitals: `mixamorig:RightArm` and `right_arm` are the same."""
    bare = re.sub(r"[^a-z0-9]", "", name.rpartition(":")[2].lower())
    return re.sub(r"^(landmark|pose|joint|bip01|bip)(?=.)", "", bare)


def _family(path: Path, names: set[str]) -> list[str]:
    families: list[list[str]] = [list[str](family.split()) for family in _NAMES]
    for family in families:
        if names.issuperset(family):
            return family
    nearest = max(families, key=lambda family: len(names & set(family)))
    missing = [name for name in nearest if name not in names]
    flat = {"leftshoulder", "rightshoulder", "leftelbow"} <= names or {"lshoulder", "rshoulder"} <= names
    raise FileFormatError(
        f"{path}: no body with {', '.join(LANDMARKS)}; {'of' if flat else 'nearest to it'} {nearest[0]} ... "
        f"{', '.join(missing[:8])} {'is' if len(missing) == 1 else 'are'} missing; the file has "
        f"{', '.join(sorted(names))[:200] or 'no landmarks'}."
    )


def _evenly(times: np.ndarray, places: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Bring frames to even times; short gaps are bridged, longer ones marked."""
    flat = places.reshape(len(places), -1).copy()
    lost = (places == 0).all(axis=2) & (np.abs(places).max(axis=(0, 2)) > 0)  # a tracker's word for nothing
    flat[np.repeat(lost, 3, axis=1)] = np.nan
    even = times[0] + np.arange(round((times[-1] - times[0]) / dt_s) + 1) * dt_s
    result, missing = np.zeros((len(even), flat.shape[1])), np.zeros(len(even), dtype=bool)
    for column in range(flat.shape[1]):
        known = np.isfinite(flat[:, column])
        if known.sum() < 2:
            missing[:] = True
            continue
        result[:, column] = np.interp(even, times[known], flat[known, column])
        after = np.searchsorted(times[known], even - 1e-9).clip(0, known.sum() - 1)
        gap = times[known][after] - times[known][(after - 1).clip(0)]
        missing |= ((gap > _BRIDGED_S + 1.5 * dt_s) & (np.abs(times[known][after] - even) > 1e-9)) | (
            (even < times[known][0] - _BRIDGED_S) | (even > times[known][-1] + _BRIDGED_S)
        )
    n_filled = int((~np.isfinite(flat)).any(axis=1).sum())
    notes = [f"{n_filled} frames with missing landmarks; gaps up to {_BRIDGED_S:g} s bridged"] if n_filled else []
    if missing.any() and not missing.all():
        first = even[int(np.argmax(missing))] - even[0]
        notes.append(f"nothing is known for {missing.sum() * dt_s:.2f} s, first at {first:.2f} s")
    return even, result.reshape(len(even), -1, 3), missing, notes


def _check_body(path: Path, places: np.ndarray) -> None:
    """Refuse places that are not those of one body in one unit."""
    if not len(places):
        raise FileFormatError(f"{path}: the landmarks are missing in almost every frame.")
    spread = np.ptp(places.reshape(-1, 3), axis=0)
    if spread.min() < 1e-3 * np.median(spread):
        axis = "xyz"[int(spread.argmin())]
        raise FileFormatError(f"{path}: {axis} does not change: keypoints in two dimensions cannot give these joints.")
    bones = {"right upper arm": (0, 1), "right forearm": (1, 2), "left upper arm": (3, 4), "left forearm": (4, 5)}
    smooth = Take("", places, 1 / 30, np.zeros(0), ()).lowpass(5.0)
    lengths = {name: np.linalg.norm(smooth[:, b] - smooth[:, a], axis=1) for name, (a, b) in bones.items()}
    typical = {name: float(np.median(length)) for name, length in lengths.items()}
    arm = float(np.median(list(typical.values())))
    for name, length in lengths.items():
        low, high = np.percentile(length, (5, 95))
        if not 0.5 * arm <= typical[name] <= 2 * arm or high - low > 0.8 * typical[name]:
            raise FileFormatError(
                f"{path}: the {name} is {low:.3g} to {high:.3g} long, the others {arm:.3g}: no places of one body in "
                "one unit."
            )
    others = {"shoulders": (0, 3), "hips": (6, 7), "right side": (0, 6), "left side": (3, 7)}
    for name, (a, b) in others.items():
        length = float(np.median(np.linalg.norm(places[:, a] - places[:, b], axis=1)))
        if not 0.2 * arm <= length <= 5 * arm:
            raise FileFormatError(
                f"{path}: the {name} {'is' if 'side' in name else 'are'} {length:.3g} apart, the upper arms {arm:.3g} "
                "long: no places of one body in one unit."
            )


def _upright(path: Path, places: np.ndarray, missing: np.ndarray, up: Up) -> tuple[np.ndarray, list[str]]:
    """Return places with y up; refuse a take in which nobody stands."""
    trunk = _unit((places[:, (0, 3)].mean(axis=1) - places[:, (6, 7)].mean(axis=1))[~missing]).mean(axis=0)
    if up == "auto":
        up = "-y" if trunk[1] < -_STANDING else "y"
        notes = ["y points down there; turned over"] if up == "-y" else []
    else:
        notes = [f"{up} is up there"] if up != "y" else []
    along = {"y": trunk[1], "-y": -trunk[1], "z": trunk[2]}[up]
    if along < _STANDING:
        lean = np.degrees(np.arccos(np.clip(along, -1, 1)))
        other = "; --up z if z is up there" if up != "z" and trunk[2] > _STANDING else ""
        raise FileFormatError(f"{path}: nobody stands: on average the trunk leans by {lean:.0f} degrees{other}.")
    if up == "-y":
        places = places * [1.0, -1.0, -1.0]
    elif up == "z":
        places = places[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    return places, notes


def _check_sides(path: Path, take: Take) -> None:
    """Refuse left and right in each other's place: elbows would bend backward."""
    places = take.places[~take.missing]
    shoulders, hips = places[:, 3] - places[:, 0], places[:, 7] - places[:, 6]
    if np.mean((shoulders * hips).sum(axis=1) > 0) < 0.5:
        raise FileFormatError(f"{path}: left and right are swapped at the shoulders or at the hips.")
    forward = _unit(np.cross(shoulders, [0.0, 1.0, 0.0]))
    ahead = []
    for shoulder, elbow, wrist in ((0, 1, 2), (3, 4, 5)):
        upper, fore = _unit(places[:, elbow] - places[:, shoulder]), _unit(places[:, wrist] - places[:, elbow])
        bent = (upper * fore).sum(axis=1) < 0.87
        hanging = upper[:, 1] < -0.5
        ahead += (
            ((fore - (fore * upper).sum(axis=1, keepdims=True) * upper) * forward).sum(axis=1)[bent & hanging].tolist()
        )
    if len(ahead) >= 10 and np.median(ahead) < -0.15:
        raise FileFormatError(
            f"{path}: left and right are swapped: the elbows bend backward in {np.mean(np.array(ahead) < 0):.0%} of "
            "the frames in which they tell."
        )


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


@dataclass(frozen=True)
class ProposedCut:
    """One arm out and back, from rest to rest [s], and its largest speed in arm lengths a second; it has no name."""

    start_s: float
    end_s: float
    arm: str
    peak_speed: float


def wrist_paths(take: Take, hz: float = _LOWPASS_HZ) -> tuple[np.ndarray, np.ndarray]:
    """Return where both wrists are from their shoulders [arm lengths], (2, n_frames, 3), right first, and how fast.

    The speeds are in arm lengths a second, (2, n_frames).
    """
    places, paths = take.lowpass(hz), []
    for shoulder, elbow, wrist in ((0, 1, 2), (3, 4, 5)):
        bones = ((shoulder, elbow), (elbow, wrist))
        arm = sum(np.median(np.linalg.norm(places[:, b] - places[:, a], axis=1)) for a, b in bones)
        paths.append((places[:, wrist] - places[:, shoulder]) / arm)
    whole = np.stack(paths)
    return whole, np.linalg.norm(np.gradient(whole, take.dt_s, axis=1), axis=2)


def propose_cuts(take: Take) -> list[ProposedCut]:
    """Return where a wrist goes out and comes back to where it is most of the time; never what that is called."""
    from scipy.signal import find_peaks

    found = []
    for arm, path, speed in zip(("right", "left"), *wrist_paths(take), strict=True):
        fast = float(np.percentile(speed, 98))
        if fast < _SLOWEST:
            continue
        turns, _ = find_peaks(-speed, height=-0.35 * fast, distance=max(1, round(0.12 / take.dt_s)))
        some = path[:: max(1, len(path) // 500)]
        at_home = [float(np.mean(np.linalg.norm(some - path[turn], axis=1) < _HOME)) for turn in turns]
        place = 0
        while place < len(turns) - 1:
            end = _back_home(path, turns, at_home, place)
            if end is None or take.missing[turns[place] : turns[end] + 1].any():
                place += 1
                continue
            start, stop = int(turns[place]), int(turns[end])
            peak = float(speed[start : stop + 1].max())
            found.append(ProposedCut(round(start * take.dt_s, 2), round(stop * take.dt_s, 2), arm, peak))
            place = end
    return sorted(found, key=lambda cut: cut.start_s)


def _back_home(path: np.ndarray, turns: np.ndarray, at_home: list[float], place: int) -> int | None:
    """Return the turn at which a wrist is back where it was at another, having been away; None if it never is."""
    here = path[turns[place]]
    for end in range(place + 2, min(place + 6, len(turns))):
        away = np.linalg.norm(path[turns[place] : turns[end] + 1] - here, axis=1)
        between = max(at_home[place + 1 : end])
        if away.max() >= _HOME and away[-1] < 0.4 * away.max() and at_home[place] >= between:
            return end
    return None
