"""The scored map of a memory, computed once and kept in the user's cache folder under its content."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from creative_nao import __version__
from creative_nao.errors import FileFormatError
from creative_nao.model import Memory
from creative_nao.pb_space import PAPER_RESOLUTION, PBMap, pb_map

CACHE_VARIABLE = "CREATIVE_NAO_CACHE"
"""Environment variable that names another cache folder."""


def cache_folder() -> Path:
    """Return the folder of everything that can be computed again."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "creative_nao"


def content_hash(memory: Memory) -> str:
    """Return a name for what a memory does: equal for equal weights, settings, tick, joints and basic actions.

    Files of favourites hold it, so it stays as it is; physical maps have another (`envs.physical_map.fingerprint`).
    """
    digest = hashlib.sha256(repr((memory.network, memory.dt_s, memory.joints, memory.demonstrations.names)).encode())
    arrays = [memory.parameters[name] for name in sorted(memory.parameters)]
    for array in (*arrays, *memory.demonstrations.trajectories):
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]


def cache_path(memory: Memory, resolution: int = PAPER_RESOLUTION) -> Path:
    """Return where the map of a memory is kept; another release of the package may score otherwise and has its own."""
    return cache_folder() / "maps" / f"{content_hash(memory)}-{resolution}-{__version__}.npz"


def kept_map(memory: Memory, resolution: int = PAPER_RESOLUTION) -> PBMap | None:
    """Return the map if it was computed before; a torn file counts as none."""
    path = cache_path(memory, resolution)
    try:
        return PBMap.load(path) if path.is_file() else None
    except FileFormatError:
        return None


def cached_map(memory: Memory, resolution: int = PAPER_RESOLUTION) -> PBMap:
    """Return the scored map of a memory, from the cache or computed now and kept.

    A cache that cannot be written is no error: the map is then computed each time.

    Raises:
        SettingsError: If the memory does not have two PB units or `resolution` is below 2.
    """
    known = kept_map(memory, resolution)
    if known is not None:
        return known
    chart = pb_map(memory, resolution)
    try:
        chart.save(cache_path(memory, resolution))
    except OSError:
        return chart
    return chart
