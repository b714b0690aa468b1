"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

docs/architecture.md follows a click through its files. Only what stands on the page needs the extra `explore`.
"""

from creative_nao.explorer.memory_service import MemoryService, Recall
from creative_nao.explorer.registry import cached_map

__all__ = ["MemoryService", "Recall", "cached_map"]
