"""The open choices of the reproduction, each changed alone: other ways to score, and other ways to train."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.resampling import monotone_cubic
from creative_nao.measures import Criteria
from creative_nao.measures.appropriateness import PAPER_CRITERIA
from creative_nao.measures.dtw_variants import dtw_variant_matrix
from creative_nao.model import NetworkSettings

WINDOW_TICKS = 5
"""Sakoe-Chiba window of the variant: a tenth of an action's length."""


@dataclass(frozen=True)
class Scoring:
    """Another way to score the same movements.

    Attributes:
        key: Short name.
        title: What is changed.
        distance: Settings of `dtw_variant_matrix`.
        criteria: Where the lines between outcomes are drawn.
    """

    key: str
    title: str
    distance: dict[str, Any] = field(default_factory=dict)
    criteria: Criteria = PAPER_CRITERIA

    def distances(self, a: Any, b: Any) -> np.ndarray:
        """Return the distance of every trajectory of `a` to every one of `b`."""
        return dtw_variant_matrix(a, b, **self.distance)


SCORINGS = (
    Scoring("default", "the defaults"),
    Scoring("independent", "DTW: a path of its own for each joint", {"dependent": False}),
    Scoring("window", f"DTW: window of {WINDOW_TICKS} ticks", {"window": WINDOW_TICKS}),
    Scoring("normalised", "DTW: divided by the length of the path", {"normalise": True}),
    Scoring("squared", "DTW: squared cost", {"squared": True}),
    Scoring("per-joint", "speed limit: each joint its own", criteria=Criteria(per_joint=True)),
)
"""The first one is what the others are compared with."""


def _same(demos: Demonstrations) -> Demonstrations:
    return demos


@dataclass(frozen=True)
class Training:
    """Another way to train.

    Attributes:
        key: Short name.
        title: What is changed.
        network: Settings of the network.
        demonstrations: Turns the taught actions into those that are learned.
    """

    key: str
    title: str
    network: NetworkSettings = field(default_factory=NetworkSettings)
    demonstrations: Callable[[Demonstrations], Demonstrations] = _same


def retimed(demos: Demonstrations, *, dt_s: float, n_steps: int, slower: float = 1.0) -> Demonstrations:
    """Return the same movements at another tick or another speed.

    The recording is read anew from the monotone cubic through its postures; what lies beyond its end is the last one.

    Args:
        demos: The basic actions.
        dt_s: The tick [s].
        n_steps: Postures of each action.
        slower: How many times as long a movement takes.
    """
    wanted = dt_s * np.arange(n_steps)
    read = [
        monotone_cubic(slower * demos.dt_s * np.arange(len(trajectory)), trajectory, wanted)
        for trajectory in demos.trajectories
    ]
    record = {**demos.record, "retimed": {"dt_s": dt_s, "n_steps": n_steps, "slower": slower}}
    return dataclasses.replace(demos, trajectories=read, dt_s=dt_s, record=record)


def _tick_010(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=0.10, n_steps=75)


def _tick_020(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=0.20, n_steps=38)


def _slower(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=demos.dt_s, n_steps=50, slower=1.5)


TRAININGS = (
    Training("default", "the defaults"),
    Training("rad2", "sigma 0.5 in rad^2", NetworkSettings(sigma_unit="rad2")),
    # What the network sees is the angle from tick to tick: this is also a movement 1.5 times as slow at 0.15 s.
    Training("tick-0.10", "tick 0.10 s, 75 ticks", demonstrations=_tick_010),
    Training("tick-0.20", "tick 0.20 s, 38 ticks", demonstrations=_tick_020),
    Training("slower", "1.5 times as slow, 50 ticks: two punches", demonstrations=_slower),
    Training("pb-weights", "initial PB weights ten times as large", NetworkSettings(pb_weight_scale=1.0)),
    Training("weights", "initial weights twice as large", NetworkSettings(weight_scale=1.0)),
)
"""The first one is what the others are compared with."""
