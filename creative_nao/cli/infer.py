"""`creative-nao infer`: find the PB value of a recorded movement, print it and draw both movements."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from creative_nao import exchange
from creative_nao.cli.terminal import print_result
from creative_nao.errors import SettingsError
from creative_nao.exchange import NOTHING_SAID, Reading
from creative_nao.maps.figure_style import INK, action_colour, action_letter, plain_text, write_figure
from creative_nao.measures import score
from creative_nao.model import load_memory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from creative_nao.model import Memory, Recognition


RECORDED, REGENERATED = action_colour(1), action_colour(0)
MAX_COLUMNS = 4


@plain_text
def _draw_recognition(memory: Memory, recorded: np.ndarray, found: Recognition, path: Path, title: str) -> None:
    """Draw recorded and regenerated curves of every joint beside the PB space with the answer in it."""
    from matplotlib.figure import Figure

    n_columns = min(MAX_COLUMNS, len(memory.joints))
    names = [*memory.joints, *["."] * (-len(memory.joints) % n_columns)]
    rows = [[*names[start : start + n_columns], "PB space"] for start in range(0, len(names), n_columns)]
    figure = Figure(figsize=(3.0 * n_columns + 3.4, max(3.4, 2.3 * len(rows)) + 0.7), layout="constrained")
    panels = figure.subplot_mosaic(rows, width_ratios=[3.0] * n_columns + [3.4])  # type: ignore[arg-type]
    time_s = np.arange(len(recorded)) * memory.dt_s
    both = np.concatenate([recorded, found.trajectory])
    margin = 0.05 * np.ptp(both)
    for joint, name in enumerate(memory.joints):
        axes = panels[name]
        axes.plot(time_s, recorded[:, joint], color=RECORDED, linewidth=3.2, alpha=0.8, label="recorded")
        axes.plot(time_s, found.trajectory[:, joint], color=REGENERATED, linewidth=1.4, label="regenerated")
        axes.set(ylim=(both.min() - margin, both.max() + margin), xlabel="time [s]", ylabel="angle [rad]")
        axes.label_outer()
    _draw_pb_space(panels["PB space"], memory, found)
    for name, axes in panels.items():
        axes.set_title(name, fontsize=10, loc="left", color=INK)
        axes.grid(color="#E6E8EB", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    names = "\n".join(f"{action_letter(k)}  {n.replace('_', ' ')}" for k, n in enumerate(memory.demonstrations.names))
    small = {"frameon": False, "fontsize": 9, "title_fontsize": 9, "alignment": "left"}
    curves, answers = (panels[name].get_legend_handles_labels() for name in (memory.joints[0], "PB space"))
    figure.legend(*curves, loc="outside lower left", ncols=2, **small)
    figure.legend(*answers, loc="outside right center", title=names, **small)
    figure.suptitle(title, fontsize=11, color=INK)
    write_figure(figure, path)


def _draw_pb_space(axes: Axes, memory: Memory, found: Recognition) -> None:
    """Draw the first two PB units: the basic actions' letters, where else the search ended, and the answer."""
    from matplotlib import patheffects

    vertical = min(1, memory.network.n_pb - 1)
    near = found.restarts.pb[found.restarts.error <= 1.5 * found.error + 1.0]
    axes.scatter(
        near[:, 0], near[:, vertical], s=14, color=INK, alpha=0.35, linewidth=0, label="other ends, little worse"
    )
    halo = [patheffects.withStroke(linewidth=3, foreground="white")]
    for action, pb in enumerate(memory.pb):
        axes.annotate(
            action_letter(action), (pb[0], pb[vertical]), color=INK, ha="center", va="center", fontsize=12,
            weight="bold", path_effects=halo, zorder=2,
        )  # fmt: skip
    star = {"marker": "*", "s": 230, "color": REGENERATED, "edgecolor": "white", "linewidth": 1.2, "zorder": 3}
    axes.scatter(found.pb[0], found.pb[vertical], label="answer", **star)
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal", xlabel="PB 1", ylabel=f"PB {vertical + 1}")


PICTURES = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class InferSettings:
    """Find the PB value from which a memory generates a recorded movement, or the most similar one it has."""

    file: tyro.conf.Positional[Path]
    """Recording in any known format, of any rate: CSV, a robot program, Choregraphe, ROS, Webots, JSON, NPZ."""
    memory: str = "half/0"
    """Shipped name, such as half/0, or a memory file."""
    out: Path | None = None
    """Picture to write, PNG, SVG or PDF by its ending: every joint, recorded and regenerated."""
    initial_state: bool = False
    """Start in the recording's own first posture and seek the initial state of the slowest layer too."""
    n_restarts: int = 48
    """Starting points of the search, worked on side by side; the best end is taken."""
    seed: int = 0
    """Seed of the search; one seed, one answer."""
    json: bool = False
    """Print the figures as JSON, the regenerated movement [rad] among them."""
    reading: Annotated[Reading, tyro.conf.OmitArgPrefixes] = NOTHING_SAID
    """What the recording does not say about itself."""


def run(settings: InferSettings) -> int:
    """Print PB value, error and nearest basic action; draw recording and regenerated movement."""
    if settings.out is not None and settings.out.suffix not in PICTURES:
        raise SettingsError(f"--out should end in {', '.join(PICTURES)}, but is {settings.out}")
    memory = load_memory(settings.memory)
    read = exchange.read(settings.file, memory.dt_s, memory.joints, reading=settings.reading, beyond="refuse")
    recorded = read.motion.angles
    found = memory.infer_pb(
        recorded, infer_initial_state=settings.initial_state, n_restarts=settings.n_restarts, seed=settings.seed
    )
    scores = score([recorded, found.trajectory], memory.demonstrations)
    names = memory.demonstrations.names
    figures: dict[str, Any] = {
        "file": str(settings.file),
        "notes": list(read.notes),
        "memory": settings.memory,
        "pb": found.pb.tolist(),
        "error": found.error,
        "rms_error_rad": found.squared_error**0.5,
        "recorded": _row(scores, 0, names),
        "regenerated": _row(scores, 1, names),
        "initial_state": None if found.initial_state is None else found.initial_state.tolist(),
        "dt_s": memory.dt_s,
        "joints": list(memory.joints),
        "trajectory": found.trajectory.tolist(),
        "out": None if settings.out is None else str(settings.out),
    }
    if settings.out is not None:
        _draw_recognition(memory, recorded, found, settings.out, _title(figures))
    lines = [_title(figures), *([f"  {'; '.join(read.notes)}"] if read.notes else [])]
    for what in ("recorded", "regenerated"):
        row = figures[what]
        lines.append(f"  {what:<12} nearest to {row['nearest']}, DTW {row['distance']:.2f}, {row['outcome']}")
    if settings.out is not None:
        lines.append(f"written: {settings.out}")
    print_result(figures, lines, as_json=settings.json)
    return 0


def _title(figures: dict[str, Any]) -> str:
    pb = ", ".join(f"{value:+.4f}" for value in figures["pb"])
    return (
        f"{Path(figures['file']).name} in memory {figures['memory']}: PB ({pb}), DTW {figures['error']:.2f}, "
        f"{figures['rms_error_rad']:.3f} rad rms"
    )


def _row(scores: Any, row: int, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "nearest": names[int(scores.nearest[row])],
        "distance": float(scores.novelty[row]),
        "outcome": str(scores.outcome[row]).replace("_", "-"),
    }
