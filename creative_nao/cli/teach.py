"""`creative-nao teach`: lead the simulated robot through the basic actions, or bring a person's movements to it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from creative_nao import runtime, storage
from creative_nao.cli.terminal import Display, changed_flags, print_result, remark
from creative_nao.demonstrations import Demonstrations, GuidanceVariation, save_demonstrations
from creative_nao.demonstrations.retargeting import RetargetedAction, Retargeting, from_motion
from creative_nao.demonstrations.take import Take, Up, load_take, propose_cuts, wrist_paths
from creative_nao.errors import SettingsError
from creative_nao.exchange import NOTHING_SAID, Reading
from creative_nao.exchange.motion import DT_S, draw_curves, resample
from creative_nao.joints import JOINTS
from creative_nao.maps.figure_style import plain_text, write_figure
from creative_nao.measures import dtw_matrix

if TYPE_CHECKING:
    from creative_nao.demonstrations.teaching import Lesson

SIMULATED = ("seed", "timing", "reach", "drift_rad", "tremor_rad")
FILM_SIZE = (320, 240)
AS_RETARGETED = Retargeting()


@dataclass(frozen=True)
class TeachSettings:
    """Teach the simulated robot: six boxing actions by leading its limp arms, or with --from what a person did.

    With --from and no --cut it proposes cuts: times with the speeds of the wrists, and a picture; what they are called
    is for a person to say. The robot performs every action in physics; what it cannot make is refused, not written.
    """

    out: Path
    """Folder for a CSV file an action and record.json, and with --from a picture and a film of each; files of these
    names are replaced."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Take of a standing person: a BVH file (needs the extra `mocap`), or a table of landmarks with columns such as
    RShoulder_x, also with MediaPipe's (world landmarks) or Kinect's names; default: the six boxing actions."""
    cut: tuple[str, ...] = ()
    """Actions of a take, as NAME=BEGIN:END in seconds; NAME=1.2:2.0,3.1:4.0 makes one action of two parts."""
    mirror: tuple[str, ...] = ()
    """Mirror images of cut actions, as NEW=NAME, such as left_jab=right_jab."""
    up: Up = "auto"
    """Vertical axis of a take; auto: y, or -y if the person stands that way."""
    film: bool = True
    """Draw a film of each action of a take, as the simulated robot performs it."""
    seed: int = 0
    """Seed of everything in which the person varies; the same seed gives the same files."""
    timing: float = GuidanceVariation.timing
    """How much the duration of each part of a movement varies, as a share of it (standard deviation)."""
    reach: float = GuidanceVariation.reach
    """How much each key posture falls short or goes far, as a share of its way from the guard (standard deviation)."""
    drift_rad: float = GuidanceVariation.drift_rad
    """Slow wander of each joint, standard deviation [rad]."""
    tremor_rad: float = GuidanceVariation.tremor_rad
    """Tremor of the hand in each joint, 8 to 12 Hz, standard deviation [rad]."""
    json: bool = False
    """Print the figures as JSON instead of a table."""
    retargeting: Annotated[Retargeting, tyro.conf.OmitArgPrefixes] = AS_RETARGETED
    """How a body's movement becomes the robot's."""
    reading: Annotated[Reading, tyro.conf.OmitArgPrefixes] = NOTHING_SAID
    """What a take does not say about itself; only its times."""


def run(settings: TeachSettings) -> int:
    """Teach, check, write the files, print the figures; the exit code is 1 when what was taught has shortcomings.

    The files are written all the same; the shortcomings stand in the record and on the error stream.
    """
    from creative_nao.demonstrations.teaching import MIN_DISTANCE_RAD, as_demonstrations, shortcomings, teach

    if settings.seed < 0:
        raise SettingsError(f"`seed` should be 0 or larger, but is {settings.seed}.")
    if settings.out.exists() and not settings.out.is_dir():
        raise SettingsError(f"`out` should be a folder, but {settings.out} is a file.")
    if settings.from_ is not None:
        return _from_take(settings, settings.from_)
    if settings.cut or settings.mirror or settings.up != "auto" or settings.reading != NOTHING_SAID:
        raise SettingsError("teach: --cut, --mirror, --up and what a take does not say need --from")
    if settings.retargeting != AS_RETARGETED:
        raise SettingsError("teach: --facing, --posture, --arms, --low-pass-hz and --dt-s need --from")
    variation = GuidanceVariation(settings.timing, settings.reach, settings.drift_rad, settings.tremor_rad)
    lessons = teach(np.random.default_rng(settings.seed), variation=variation)
    demos = as_demonstrations(lessons)
    distances = dtw_matrix(demos.trajectories)
    apart = distances[np.triu_indices(len(distances), 1)]
    too_close = [
        f"{demos.names[i]} and {demos.names[j]} are {distances[i, j]:.1f} apart, expected {MIN_DISTANCE_RAD} or more."
        for i, j in np.argwhere(np.triu(distances < MIN_DISTANCE_RAD, 1))
    ]
    figures = {
        "actions": {lesson.name: _figures(lesson, demos.dt_s) for lesson in lessons},
        "max_speed_rad_s": demos.max_speed,
        "distances": distances.round(3).tolist(),
        "smallest_distance": float(apart.min()),
        "mean_distance": float(apart.mean()),
        "shortcomings": [*shortcomings(lessons, demos), *too_close],
    }
    record = runtime.record(
        settings={k: v for k, v in dataclasses.asdict(settings).items() if k not in ("out", "json")},
        command=_command(settings),
    )
    record |= {"method": "kinesthetic teaching in simulation", "dt_s": demos.dt_s, "names": demos.names} | figures
    save_demonstrations(settings.out, dataclasses.replace(demos, record=record))
    print_result(figures, _lines(figures, settings.out), as_json=settings.json)
    for sentence in figures["shortcomings"]:
        remark(sentence)
    return 1 if figures["shortcomings"] else 0


def _command(settings: TeachSettings) -> str:
    """Return the command that gives the same files again; a folder outside the working directory is not named."""
    words = ["creative-nao", "teach", "--out", "DIR" if settings.out.is_absolute() else settings.out.as_posix()]
    names = ("timing", "reach", "drift_rad", "tremor_rad")
    return " ".join([*words, f"--seed {settings.seed}", *changed_flags(settings, names)])


def _figures(lesson: Lesson, dt_s: float) -> dict[str, Any]:
    lag, whole = np.abs(lesson.recorded - lesson.led), np.abs(lesson.recorded - lesson.meant)
    return {
        "max_speed_rad_s": float(np.abs(np.diff(lesson.recorded, axis=0)).max() / dt_s),
        "from_hand_mean_rad": float(lag.mean()),
        "from_hand_max_rad": float(lag.max()),
        "from_keyframes_mean_rad": float(whole.mean()),
        "from_keyframes_max_rad": float(whole.max()),
        "pull_mean_n": lesson.mean_pull_n,
        "pull_max_n": lesson.max_pull_n,
        "self_contact_share": lesson.self_contact_share,
    }


def _lines(figures: dict[str, Any], out: Path) -> list[str]:
    lines = [f"{'':16}{'speed':>8}{'from the hand':>18}{'from the key postures':>24}{'pull':>14}"]
    lines += [f"{'':16}{'rad/s':>8}{'mean, max rad':>18}{'mean, max rad':>24}{'mean, max N':>14}"]
    for name, one in figures["actions"].items():
        lines.append(
            f"{name:16}{one['max_speed_rad_s']:8.2f}"
            f"{one['from_hand_mean_rad']:12.3f}{one['from_hand_max_rad']:6.2f}"
            f"{one['from_keyframes_mean_rad']:18.3f}{one['from_keyframes_max_rad']:6.2f}"
            f"{one['pull_mean_n']:8.1f}{one['pull_max_n']:6.1f}"
        )
    lines.append(
        f"Largest speed {figures['max_speed_rad_s']:.2f} rad/s. Distance between two actions: "
        f"at least {figures['smallest_distance']:.1f}, {figures['mean_distance']:.1f} on average."
    )
    lines.append(f"Six actions of 50 postures written to {out}.")
    return lines


def _from_take(settings: TeachSettings, path: Path) -> int:
    """Propose cuts of a take, or bring those that were named to the robot; the exit code is 1 if one is refused."""
    others = [*changed_flags(settings, SIMULATED), *changed_flags(settings.reading, ("fill", "unit", "movement"))]
    if others:
        raise SettingsError(f"teach: {others[0].split()[0]} is not for --from")
    take = load_take(path, reading=settings.reading, up=settings.up)
    if not settings.cut:
        if settings.mirror:
            raise SettingsError("teach: --mirror needs --cut")
        return _proposals(settings, take)
    cuts: dict[str, list[tuple[float, float]]] = {}
    for word in settings.cut:
        name, _, spans = word.partition("=")
        try:
            cuts.setdefault(name, []).extend(tuple(map(float, span.split(":", 1))) for span in spans.split(","))  # type: ignore[misc]
        except ValueError:
            cuts[name] = [(0.0, 0.0)]
        if not name or not all(len(span) == 2 and span[0] < span[1] for span in cuts[name]):
            raise SettingsError(f"--cut should be NAME=BEGIN:END in seconds, but is {word[:60]!r}")
    mirror = {new: old for new, _, old in (word.partition("=") for word in settings.mirror)}
    actions = from_motion(take, cuts, mirror=mirror, retargeting=settings.retargeting)
    actions, frames = _performed(actions)
    kept = [one for one in actions if not one.refused]
    coarse = [resample(np.arange(len(one.angles)) * one.dt_s, one.angles, DT_S) for one in kept]
    distances = dtw_matrix(coarse) if kept else np.zeros((0, 0))
    for one, row in zip(kept, distances, strict=True):
        one.report["distances"] = {other.name: float(d) for other, d in zip(kept, row, strict=True) if other is not one}
    figures = {
        "take": take.source,
        "notes": list(take.notes),
        "actions": {one.name: one.report | {"refused": one.refused or None} for one in actions},
        "written": [one.name for one in kept],
    }
    if kept:
        record = runtime.record(settings=_plain(settings), command=runtime.command_line())
        record |= {"method": "retargeted from a body", "sha256_of_take": runtime.sha256(path)} | figures
        dt_s = settings.retargeting.dt_s
        names = tuple(one.name for one in kept)
        save_demonstrations(settings.out, Demonstrations(names, [one.angles for one in kept], dt_s, JOINTS, record))
        for one in kept:
            picture = draw_curves({one.name: one.angles}, dt_s, JOINTS)
            storage.write_bytes(settings.out / f"{one.name}.png", picture)
        if settings.film:
            _films(settings.out, kept, frames)
    print_result(figures, _report_lines(figures, settings.out), as_json=settings.json)
    for one in actions:
        if one.refused:
            remark(f"{one.name} is refused: {one.refused}")
    return 0 if len(kept) == len(actions) else 1


def _plain(settings: TeachSettings) -> dict[str, Any]:
    found = dataclasses.asdict(settings)
    return {k: v for k, v in found.items() if k not in ("out", "json", "from_", *SIMULATED)}


def _performed(actions: list[RetargetedAction]) -> tuple[list[RetargetedAction], dict[str, np.ndarray]]:
    """Let the simulated robot perform the actions; refuse what its body cannot do, and return snapshots for films."""
    from creative_nao.robot import Performer, first_failure

    performer, done, frames = Performer(), [], {}
    for one in actions:
        if not one.refused:
            performance = performer.perform(one.angles, one.dt_s, keep_frames=True)
            assert performance.frames is not None
            one.report["self_contact_share"] = performance.self_collision_share
            one.report["tracking_error_rad"] = float(performance.mean_error_rad.max())
            if (failure := first_failure(performance)) is not None:
                told = f"the body does not do it: {failure.replace('_', ' ')}"
                one = dataclasses.replace(one, refused=told)
            frames[one.name] = performance.frames
        done.append(one)
    return done, frames


def _films(out: Path, actions: list[RetargetedAction], frames: dict[str, np.ndarray]) -> None:
    from creative_nao.robot import PlaybackSettings, Scene, can_draw, pictures, write_gif

    if not can_draw():
        remark("no films, since nothing can be drawn here; see creative-nao doctor")
        return
    scene = Scene()
    with Display({"films": len(actions)}) as display:
        for number, one in enumerate(actions, start=1):
            images = pictures(scene, frames[one.name], camera="close", width=FILM_SIZE[0], height=FILM_SIZE[1])
            write_gif(images, out / f"{one.name}.gif", frame_dt_s=PlaybackSettings().frame_dt_s)
            display.show("films", number)


@plain_text
def _proposals(settings: TeachSettings, take: Take) -> int:
    """Print where the wrists go out and back, and draw it; a person says what it is."""
    from matplotlib.figure import Figure

    found = propose_cuts(take)
    _, speeds = wrist_paths(take)
    figure = Figure(figsize=(14, 3.4), layout="constrained")
    axes = figure.subplots()
    times = np.arange(speeds.shape[1]) * take.dt_s
    for number, name in enumerate(("right", "left")):
        axes.plot(times, speeds[number], linewidth=1.2, label=f"{name} wrist", color=f"C{number}")
        for one in (one for one in found if one.arm == name):
            axes.axvspan(one.start_s, one.end_s, color=f"C{number}", alpha=0.12)
            axes.text(one.start_s, axes.get_ylim()[1], f"{one.start_s:.2f}", fontsize=7, va="top")
    axes.set(
        xlabel="time [s]", ylabel="speed [arm lengths / s]", xlim=(0, times[-1]), title=f"cuts of {take.source[:80]}"
    )
    axes.legend(loc="upper right", fontsize=8)
    picture = settings.out / "cuts.png"
    write_figure(figure, picture)
    figures = {
        "take": take.source,
        "duration_s": float(times[-1]),
        "notes": list(take.notes),
        "cuts": [dataclasses.asdict(one) for one in found],
        "picture": str(picture),
    }
    lines = [
        f"{take.source}: {times[-1]:.2f} s, {1 / take.dt_s:.4g} frames a second",
        *(f"  {one}" for one in take.notes),
    ]
    lines += (
        [f"{'begin':>8} {'end':>8}  {'arm':<6} fastest [arm lengths/s]"] if found else ["no wrist goes out and back"]
    )
    lines += [f"{one.start_s:8.2f} {one.end_s:8.2f}  {one.arm:<6} {one.peak_speed:6.2f}" for one in found]
    lines += (
        [f"drawn: {picture}; name them: --cut NAME={found[0].start_s:.2f}:{found[0].end_s:.2f} ..."] if found else []
    )
    print_result(figures, lines, as_json=settings.json)
    return 0


def _report_lines(figures: dict[str, Any], out: Path) -> list[str]:
    lines = [f"{figures['take']}", *(f"  {note}" for note in figures["notes"])]
    heads = (("beside the person,", 18), ("mean (max) deg", 18), ("at limits", 11), ("slower", 8), ("speed", 7))
    units = (("upper arm", 18), ("forearm", 18), ("% of time", 11), ("times", 8), ("rad/s", 7), ("%", 7), ("DTW", 9))
    for row in ((*heads, ("touch", 7), ("nearest", 9)), units):
        lines.append(" " * 16 + "".join(f"{word:>{width}}" for word, width in row))
    for name, one in figures["actions"].items():
        upper, fore = one["upper_arm_error_deg"], one["forearm_error_deg"]
        nearest = min(one.get("distances", {}).values(), default=None)
        touch = one.get("self_contact_share")
        lines.append(
            f"{name[:15]:16}{upper[0]:11.1f} ({upper[1]:4.0f}){fore[0]:11.1f} ({fore[1]:4.0f})"
            f"{100 * max(one['at_limit_share'].values()):11.0f}{one['stretch']:8.2f}{one['max_speed_rad_s']:7.2f}"
            + ("      -" if touch is None else f"{100 * touch:7.1f}")
            + ("        -" if nearest is None else f"{nearest:9.1f}")
        )
    lines += [f"faces: {next(iter(figures['actions'].values()))['facing']}"]
    lines.append(f"{len(figures['written'])} of {len(figures['actions'])} actions written to {out}.")
    return lines
