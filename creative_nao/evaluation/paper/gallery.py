"""All figures of the reproduction, drawn and written, with what their captions need to know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from creative_nao.evaluation.drawing import STYLE, save
from creative_nao.evaluation.paper import curves, maps, movements
from creative_nao.evaluation.paper.bank import Entry
from creative_nao.evaluation.paper.measuring import chart_path
from creative_nao.evaluation.paper.reference import CONDITION_NAMES
from creative_nao.evaluation.paper.summary import Figures
from creative_nao.pb_space import PBMap


def draw_pictures(
    folder: Path,
    bank: Sequence[Entry],
    networks: Sequence[Figures],
    rows: Sequence[Mapping[str, Any]],
    *,
    seed: int,
) -> dict[str, Any]:
    """Draw every figure into the subfolder `images` of a run folder.

    Args:
        folder: Run folder with the maps.
        bank: The networks.
        networks: Their figures, in the same order.
        rows: The rows of `results.json`.
        seed: Draws the examples.

    Returns:
        What the captions say: the seed that is shown, the walk, what is missing from the examples.
    """
    memories = {entry.name: entry.load() for entry in bank}
    charts = {entry.name: PBMap.load(chart_path(folder, entry)) for entry in bank}
    per = {name: [entry for entry in bank if entry.condition == name] for name in CONDITION_NAMES}
    shown = {name: per[name][0] for name in CONDITION_NAMES}
    half = memories[shown["half"].name]
    # Half closed first, as in the paper's Fig. 3 and 5, then the others.
    ordered = sorted(bank, key=lambda entry: entry.condition != "half")
    combinations = {one["name"]: one["clearest_combination"] for one in networks}
    images = folder / "images"
    with matplotlib.rc_context(STYLE):
        by_condition = {name: [memories[entry.name] for entry in per[name]] for name in CONDITION_NAMES}
        save(curves.learning_curves(by_condition), images / "paper_learning.png")
        save(curves.table_dots(networks, rows), images / "paper_table.png")
        save(movements.basic_actions(half.demonstrations), images / "paper_actions.png")
        examples, missing = movements.examples(
            [memories[entry.name] for entry in ordered],
            [charts[entry.name] for entry in ordered],
            [combinations[entry.name] for entry in ordered],
            np.random.default_rng(seed),
        )
        save(examples, images / "paper_examples.png")
        save(maps.three_maps({name: charts[entry.name] for name, entry in shown.items()}), images / "paper_maps.png")
        several = {name: [(entry.seed, charts[entry.name]) for entry in per[name]] for name in CONDITION_NAMES}
        save(maps.all_maps(several), images / "paper_all_maps.png")
        save(maps.walk(half, charts[shown["half"].name]), images / "paper_walk.png")
    points, between = maps.walk_points(half)
    return {
        "shown_seed": shown["half"].seed,
        "n_epochs": sorted({memory.training.n_epochs for memory in memories.values()}),
        "examples_missing": missing,
        "walk": {"memory": half.name, "between": list(between), "pb": points.tolist()},
    }
