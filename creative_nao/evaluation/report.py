"""`report.html`: a whole run on one page that needs nothing else, and its figures as PNG and SVG.

This file works out the figures, draws the maps with the points that agents chose and a film strip of finds; charts are
in `plots.py`. The sentences are in `templates/report.html.jinja`, `findings.html.jinja` (what the results say) and
`limits.html.jinja` (what they do not).
"""

from __future__ import annotations

import dataclasses
import functools
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from creative_nao import storage
from creative_nao.agents.registry import UNTRAINED, split_name
from creative_nao.errors import MissingDependencyError, NotFoundError
from creative_nao.evaluation import pages, plots
from creative_nao.evaluation.pages import env_label
from creative_nao.evaluation.plots import agent_colour, agent_label
from creative_nao.evaluation.results import Measured, Row, entries_of, verdict
from creative_nao.evaluation.suites import Suite, actions_before, slug, trained_here
from creative_nao.joints import JOINTS
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import INK, figure, save, save_small, styled
from creative_nao.maps.picture import draw_on, legend_handles
from creative_nao.model import load_memory

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

MANY = 16
"""Most agents that have curves of their own."""
FEW = 3
"""Most agents whose maps are drawn large, two in a row; more stand three in a row."""
N_BARS = 6
"""Most agents in the page's first figure."""
N_FINDS = 4
"""Finds that are shown: those that earned most; the first at the head of the page."""
N_POSES, N_TICKS = 8, 20
"""Poses that are drawn of a movement, and the ticks they are chosen from: after its first punch it repeats itself."""
SIZE_PX = (170, 190)
CAMERA = "close"
INTRODUCED = ("supervised", "random", "ppo", "oracle")
"""Agents that the report introduces in words of its own."""


def write_report(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, record: Mapping[str, Any]
) -> Path:
    """Draw the figures of a run folder, write `report.html` beside them and return its path.

    The folder's maps are read; `results` is the content of `results.json`, `record` that of `run.json`.
    """
    paths = {memory: folder / "maps" / f"{slug(memory)}.npz" for memory in suite.shown}
    # Memories of more than two PB units have no map.
    maps = {memory: PBMap.load(path) if path.stat().st_size else None for memory, path in paths.items()}
    others = []  # told of by training if they come out of a bundle, else by docstring; each once, whatever it imagines
    for agent in dict.fromkeys(split_name(agent)[0] for agent in suite.agents if agent not in INTRODUCED):
        about = (UNTRAINED[agent].__doc__ or "").strip().partition("\n")[0] if agent in UNTRAINED else None
        n_trained = actions_before(agent) or None
        others.append({"name": agent, "n_trained": n_trained, "about": about})
    page = pages.render(
        "report.html.jinja",
        **findings(suite, results, measured),
        first=first_figure(suite, results),
        record=record,
        n_basic=max((len(scored.names) for scored in maps.values() if scored is not None), default=6),
        columns=pages.MEASURED_COLUMNS,
        rows=[_line(row, pages.cells(row)) for row in results["rows"]],
        summary_titles=[title.replace("\n", " ") for title in pages.SUMMARY_TITLES],
        summary=[_line(entry, pages.summary_cells(entry)) for entry in results["summary"]],
        others=others,
        trained=[agent for agent in suite.agents if trained_here(agent)],
        notes=notes(results),
        pictures=draw_figures(folder, suite, results, measured, maps),
        data_uri=pages.data_uri,
        ppo_settings=", ".join(f"{name} {value}" for name, value in dataclasses.asdict(suite.ppo).items()),
        env_label=env_label,
    )
    return storage.write_text(folder / "report.html", page)


def _line(row: Row, cells: Sequence[tuple[str, str]]) -> dict[str, Any]:
    return {**row, "env": env_label(row["env"]), "colour": agent_colour(row["agent"]), "cells": cells}


def first_figure(suite: Suite, results: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the page's first sentence and its bars: agents in the first environment, the best first."""
    entries = entries_of(results, suite.envs[0])
    ranked = [entry for entry in entries if entry["agent"] != "oracle"] or entries
    baseline = next((entry for entry in ranked if entry["agent"] == results["baseline"]), None)
    shown = ranked[:N_BARS]
    if baseline is not None and baseline not in shown:
        shown = [*shown[:-1], baseline]
    full = max(entry["reward"][key] or 0.0 for entry in shown for key in ("mean", "high")) or 1.0
    look = {"label": agent_label, "colour": agent_colour, "level": list(map(agent_label, _level(ranked)))}
    values = {"env": env_label(suite.envs[0]), "n_agents": len(ranked), "shown": shown, "full": full}
    return {**values, **look, "best": ranked[0], "baseline": baseline}


def _level(ranked: Sequence[Row]) -> list[str]:
    """Return the agents whose intervals reach that of the first; where seeds leave none, its mean stands for it."""
    low = ranked[0]["reward"]["low"]
    reaching = (row["agent"] for row in ranked[1:] if (row["reward"]["high"] or row["reward"]["mean"]) >= (low or 0.0))
    return [] if low is None else list(reaching)


def findings(suite: Suite, results: Mapping[str, Any], measured: Measured) -> dict[str, Any]:
    """Return the values of `findings.html.jinja`: a dictionary of figures for each sentence, with its `kind`."""
    found: list[dict[str, Any]] = []
    several = len(suite.memories) > 1
    for env in suite.envs:
        if several:
            entries = entries_of(results, env)
            found.append({"kind": "overall", "env": env_label(env), "rows": entries})
            if compared := [(verdict(entry), entry["agent"]) for entry in entries if entry["versus"] is not None]:
                found.append({"kind": "compared", "verdicts": compared})
        else:
            found.append({"env": env_label(env), **_ranking([row for row in results["rows"] if row["env"] == env])})
    for memory in suite.memories:
        found += _physics(suite, measured, memory)
    if several:
        earned = [sum(oracle.rewards) for oracle in measured.oracles.values()]
        found.append({"kind": "oracles", "least": min(earned), "most": max(earned)})
    else:
        found.append({"kind": "map", "oracle": measured.oracles[suite.memories[0]]})
    return {"findings": found, "suite": suite, "several_memories": several, "baseline": results["baseline"]}


def _ranking(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the agents by reward, those whose interval reaches the best one's, and who is more diverse."""
    ranked = sorted(rows, key=lambda row: -row["reward"]["mean"])
    best = ranked[0]
    known = [row for row in ranked if row["diversity"] is not None]
    most = max(known, key=lambda row: row["diversity"]["mean"], default=best)
    told = {"best": best, "level": _level(ranked), "diverse": known if most is not best else []}
    return {"kind": "ranking", "rows": ranked, **told}


def _physics(suite: Suite, measured: Measured, memory: str) -> list[dict[str, Any]]:
    """Compare, action by action, what the same PB vectors gave as the memory imagines them and in physics."""
    # Agents that look at no results choose the same points in both.
    blind = [agent for agent in suite.agents if agent in UNTRAINED and not UNTRAINED[agent]().learns_within_episode]
    found = []
    for env in [env for env in suite.envs if suite.oracle_envs and env not in suite.oracle_envs]:
        imagined, performed = (
            [e for e in measured.episodes if (e.memory, e.env) == (memory, which) and e.agent in blind]
            for which in (suite.oracle_envs[0], env)
        )
        actions = ([action for episode in episodes for action in episode.actions] for episodes in (imagined, performed))
        pairs = zip(*actions, strict=True)
        if usable := [after.appropriate for before, after in pairs if before.appropriate]:
            change = 100.0 * (sum(e.reward for e in performed) / sum(e.reward for e in imagined) - 1.0)
            counts = {"n_usable": len(usable), "n_refused": usable.count(False)}
            found.append({"kind": "physics", "memory": memory, "change_pct": change, **counts})
    return found


def notes(results: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Return the reasons of missing or partial figures, each once, with the rows they concern; none for all rows."""
    found: dict[str, list[str]] = {}
    for row in results["rows"]:
        for key, reason in row.items():
            if key.endswith("_reason"):
                text = f"{key.removesuffix('_reason').replace('_', ' ')}: {reason}"
                found.setdefault(text, []).append(f"{row['agent']}, {env_label(row['env'])}")
    return [(text, [] if len(rows) == len(results["rows"]) else rows) for text, rows in found.items()]


def draw_figures(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, maps: dict[str, PBMap | None]
) -> list[dict[str, Any]]:
    """Draw every figure into the subfolder `figures` of a run folder.

    Returns of each its `name` (the report knows title and caption), its `memory` (None for one over all) and the `path`
    of the file that is put into the page.
    """
    found = []
    several = len(suite.memories) > 1
    # Of many agents, curves and memories show each once, as it imagines most.
    few = tuple({split_name(agent)[0]: agent for agent in suite.agents}.values())
    one_by_one = dataclasses.replace(suite, agents=few) if len(suite.agents) > MANY else suite
    with styled():
        for memory in (None, *maps) if several else maps:
            shown = (one_by_one, results, measured)
            drawn = _draw_overall(*shown) if memory is None else _draw(*shown, memory, maps[memory])
            for name, picture in drawn.items():
                file = f"{name}-{slug(memory)}.png" if several and memory is not None else f"{name}.png"
                path = save(picture, folder / "figures" / file)
                if name != "choices":  # whose SVG of 40,000 points would be large
                    path = path.with_suffix(".svg")
                found.append({"name": name, "memory": memory, "path": path})
        return found + _draw_finds(folder, suite, results, measured)


def _draw_overall(suite: Suite, results: dict[str, Any], measured: Measured) -> dict[str, Figure]:
    summary = results["summary"]
    drawn = {"standing": plots.standing(results)}
    if len({entry["n_candidates"] for entry in summary}) > 1:
        drawn = {"frontier": plots.frontier(results), **drawn}
    if any(entry["versus"] is not None for entry in summary):
        drawn["improvement"] = plots.improvement(results)
    few = [entry for entry in summary if entry["agent"] in suite.agents]
    if any(entry["profile"] is not None and entry["agent"] != "oracle" for entry in few):
        drawn["profiles"] = plots.profiles({**results, "summary": few})
    if set(suite.oracle_envs) & set(suite.envs):
        drawn["regret"] = plots.regret(suite, measured)
    return drawn


def _draw(
    suite: Suite, results: dict[str, Any], measured: Measured, memory: str, scored: PBMap | None
) -> dict[str, Figure]:
    mental = suite.oracle_envs[0] if suite.oracle_envs else suite.envs[0]
    drawn = {
        "reward": plots.rewards(suite, results, measured, memory),
        "cumulative": plots.cumulative(suite, measured, memory),
        "outcomes": plots.outcomes(suite, measured, memory),
    }
    if scored is not None:
        drawn["choices"] = choices(suite, measured, scored, memory, mental)
    if any(training.memory == memory for training in measured.trainings):
        drawn["training"] = plots.training(suite, measured, memory)
    return drawn


def _draw_finds(folder: Path, suite: Suite, results: dict[str, Any], measured: Measured) -> list[dict[str, Any]]:
    """Draw what the best agent found on the first memory, what earned most first, each as a sheet of poses.

    Nothing where it found nothing, where this machine cannot draw the robot or the memory is another robot's.
    """
    env, memory = suite.envs[0], suite.memories[0]
    if "Modulation" in env:  # no single PB vector makes a modulated movement again
        return []
    own = folder / "memories" / f"{memory.replace('/', '-')}.safetensors"
    try:
        searched = load_memory(own if own.is_file() else memory)
    except NotFoundError:  # a name that only its environment knows
        return []
    rows = [row for row in results["rows"] if (row["env"], row["memory"]) == (env, memory)]
    agent = max(rows, key=lambda row: row["reward"]["mean"])["agent"]
    usable = [action for action in measured.of(memory, env, agent)[0].actions if action.appropriate]
    best = sorted(usable, key=lambda action: -action.reward)[:N_FINDS]
    if not best or tuple(searched.demonstrations.joints) != tuple(JOINTS):
        return []
    drawn = []
    for place, (move, action) in enumerate(zip(searched.generate([a.pb for a in best]), best, strict=True), 1):
        sheet, path = io.BytesIO(), folder / "figures" / f"find-{place}.png"
        try:
            Image.fromarray(_poses(move, float(searched.demonstrations.dt_s))).save(sheet, format="PNG")
        except MissingDependencyError:
            return []
        save_small(sheet, path)
        drawn.append({"name": "find", "memory": None, "path": path, "agent": agent_label(agent), "action": action})
    return drawn


def _poses(move: np.ndarray, dt_s: float) -> np.ndarray:
    """Return two rows of pictures, uint8: a movement's first pose and those that differ most, in order of time."""
    from creative_nao.robot.film import imagined_frames, pictures  # loads MuJoCo

    begun = move[:N_TICKS]
    apart = np.linalg.norm(begun[:, None] - begun, axis=2)
    ticks = [0]
    while len(ticks) < min(N_POSES, len(begun)):
        ticks.append(int(apart[ticks].min(axis=0).argmax()))
    frames = imagined_frames(_scene(), move, dt_s, frame_dt_s=dt_s)[sorted(ticks)]
    images = np.stack(pictures(_scene(), frames, camera=CAMERA, width=SIZE_PX[0], height=SIZE_PX[1]))
    framed = np.pad(images, ((0, N_POSES - len(images)), (2, 2), (2, 2), (0, 0)), constant_values=255)
    rows = framed.reshape(2, -1, *framed.shape[1:]).transpose(0, 2, 1, 3, 4)  # row, height, picture, width, colour
    return rows.reshape(2 * framed.shape[1], -1, 3)


@functools.cache
def _scene() -> Scene:
    from creative_nao.robot.scene import Scene

    return Scene(with_bag=False)  # it would hide an arm


def choices(suite: Suite, measured: Measured, scored: PBMap, memory: str, env: str) -> Figure:
    """Draw the map once per agent with the PB vectors it chose: the first seed's large, the other seeds' small."""
    n_columns = 2 if len(suite.agents) <= FEW else 3
    n_rows = -(-(len(suite.agents) + 1) // n_columns)
    drawn, axes = figure(8.6, 8.3 / n_columns * n_rows + 0.8, n_rows, n_columns)
    for ax in axes[len(suite.agents) + 1 :]:
        ax.remove()
    style = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4, "zorder": 3, "clip_on": False}
    for ax, agent in zip(axes, (*suite.agents, None), strict=False):
        draw_on(ax, scored)
        ax.grid(visible=False)
        title = "oracle (knows the map)" if agent is None else agent_label(agent)
        ax.set(title=title, xticks=[-1, 0, 1], yticks=[-1, 0, 1])
        large = [(measured.oracles[memory].pb, 44, "o")]
        if agent is not None:
            first, *others = measured.of(memory, env, agent)
            for episode in others:
                points = np.array([a.pb for a in episode.actions])
                ax.plot(*points.T, "o", color=INK, markersize=3.2, markeredgecolor="white", markeredgewidth=0.5)
            large = [
                ([a.pb for a in first.actions if a.appropriate == usable], size, marker)
                for usable, size, marker in ((True, 44, "o"), (False, 40, "X"))
            ]
        for points, size, marker in large:
            ax.scatter(*np.reshape(points, (-1, 2)).T, s=size, marker=marker, **style)
    drawn.legend(handles=legend_handles(scored), loc="outside lower center", ncols=3, fontsize=9)
    return drawn
