"""What a memory holds, and the most that a search could get out of it: the ceiling for every agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from creative_nao.measures import OUTCOMES, farthest_points
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap, pb_map


def chart_memory(
    memory: Memory, resolution: int, n_actions: int, report: Callable[[float], None] = lambda _: None
) -> tuple[PBMap, dict[str, Any]]:
    """Score a memory's whole map and let the greedy oracle choose from it.

    Args:
        memory: The memory.
        resolution: Points along each PB axis.
        n_actions: Budget of the oracle.
        report: Called with the share that is done.

    Returns:
        The map, and a dictionary of plain values: what the oracle chose, `oracle_pb` (n, 2), what each choice earned,
        `oracle_rewards` (n,), and the share of each outcome on the map, `shares_pct`.
    """
    charted = pb_map(memory, resolution=resolution)
    report(0.5)
    assert charted.trajectories is not None
    best = farthest_points(charted.trajectories, memory.demonstrations, n_actions, charted.appropriate)
    return charted, {
        "oracle_pb": charted.pb[best.indices].tolist(),
        "oracle_rewards": best.rewards.tolist(),
        "shares_pct": {outcome: charted.share_pct(outcome) for outcome in OUTCOMES},
    }
