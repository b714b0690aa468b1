"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

- `memory_service`: one memory, asked for movements, what they are worth and in words (`MemoryService`, `Recall`).
- `physics_service`: the robot as JSON for the browser, and its performances in physics.
- `registry`: the memories that can be shown, their maps (coarse at once, fine when computed), the cache of maps.
- `view`, `colours`, `map_pane`: the window of the PB space, what colours tell, the map as a picture to touch.
- `memory_panel`: one memory in a tab; `tab`: what one browser tab shows and does; `panels`, `page`: where it stands.
- `state`: the page's address and the favourites; `server`: who may open the page, and what ends with a tab.
- `keyframe_editor`, `teach_training`, `teach_page`: demonstrations made in the page, and memories trained from them.
- `static_export`: the same as one file that needs no server.

Only what stands on the page needs the extra `explore`.
"""

from creative_nao.explorer.memory_service import MemoryService, Recall
from creative_nao.explorer.registry import cached_map

__all__ = ["MemoryService", "Recall", "cached_map"]
