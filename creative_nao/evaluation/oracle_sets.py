"""What the greedy oracle chooses on each memory of the bank's validation and test parts, worked out beforehand.

`oracle_sets.safetensors` holds what `benchmarks/oracle_sets.py` found; a set counts only for the very file of memory
that it was made of.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from creative_nao.agents.black_box import oracle_pool
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.maps import PAPER_RESOLUTION, PBMap
from creative_nao.measures import OUTCOMES, farthest_points
from creative_nao.model import Memory
from creative_nao.model import memory as memories
from creative_nao.schema import Field, LongText, Sha256, Version1, parse, record

FILE = Path(__file__).with_suffix(".safetensors")
KIND = "oracle sets"
N_SHIPPED = 100
"""Movements in a shipped set; the choices of a shorter episode are its beginning."""


class OracleSet(NamedTuple):
    """What the oracle chooses on a memory.

    Attributes:
        pb: PB points in the order of choice, (n, n_pb).
        rewards: What each earns, (n,).
        shares_pct: Share of each outcome on the map, by its name.
    """

    pb: np.ndarray
    rewards: np.ndarray
    shares_pct: dict[str, float]


@record
class OracleSetOrigin:
    """Which memory file a set was made of, and what the map holds."""

    sha256: Sha256
    shares_pct: dict[str, float]


@record(closed=False)
class OracleSetsHeader:
    """What the file of shipped sets says of itself."""

    format_version: Version1
    command: LongText
    memories: Annotated[dict[str, OracleSetOrigin], Field(max_length=10_000)]


def find_oracle_set(memory: Memory, n_actions: int, resolution: int) -> tuple[OracleSet, PBMap | None]:
    """Search the whole map of a memory; return what the oracle chooses, and the map if it has one (two PB units)."""
    pb, trajectories, outcome, scored = oracle_pool(memory, resolution)
    best = farthest_points(trajectories, memory.demonstrations, n_actions, np.isin(outcome, ("learned", "unlearned")))
    shares = {name: 100.0 * float((outcome == name).mean()) for name in OUTCOMES}
    return OracleSet(pb[best.indices], best.rewards, shares), scored


@functools.cache
def _shipped() -> tuple[OracleSetsHeader, dict[str, np.ndarray]] | None:
    if not FILE.is_file():
        return None
    values, arrays = load_tensors(FILE, kind=KIND)
    return parse(OracleSetsHeader, values, f"{FILE}: header"), arrays


def _file_sha256(name: str) -> str | None:
    """Return the SHA-256 of the file of a shipped memory as release 0.1.0 shipped it; None without one."""
    path = memories.shipped_file(name)
    return memories.content_sha256(path) if path.is_file() else None


@functools.cache
def shipped_oracle_set(name: str, n_actions: int, resolution: int = PAPER_RESOLUTION) -> OracleSet | None:
    """Return the set of a shipped memory; None where none of this size ships, or the memory is another than then."""
    found = _shipped()
    if found is None or resolution != PAPER_RESOLUTION or n_actions > N_SHIPPED or name not in found[0].memories:
        return None
    header, arrays = found
    origin = header.memories[name]
    if _file_sha256(name) != origin.sha256:
        return None
    sets = arrays[name]
    return OracleSet(sets[:n_actions, 1:], sets[:n_actions, 0], dict(origin.shares_pct))


def save_oracle_sets(found: dict[str, OracleSet], command: str) -> Path:
    """Write the file of shipped sets: for each memory an array of rewards and PB points, (n, 1 + n_pb)."""
    memories = {name: {"sha256": _file_sha256(name), "shares_pct": one.shares_pct} for name, one in found.items()}
    header: dict[str, Any] = {"format_version": 1, "command": command, "memories": memories}
    tensors = {name: np.column_stack([one.rewards, one.pb]) for name, one in found.items()}
    return save_tensors(FILE, kind=KIND, header=header, tensors=tensors)
