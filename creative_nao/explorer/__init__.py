"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

- `memory_service`: one memory, asked for movements, what they are worth and in words (`MemoryService`, `Recall`).
- `physics_service`: the robot as JSON for the browser, and its performances in physics.
- `registry`: the memories that can be shown, and what is computed of them in threads: maps, measures, finer cells.
- `view`, `colours`: the window of the PB space; the colourings, patterns and picture of a map.
- `markup`: the figures that the HTML and SVG templates in `templates` show.
- `map_pane`: a map to touch; `tab`: what one browser tab shows and does; `page`: where it stands.
- `state`: the page's address and the favourites; `server`: who may open the page, and what ends with a tab.
- `keyframe_editor`, `teach_training`, `teach_page`: demonstrations made in the page, and memories trained from them.
- `static_export`: the same as one file that needs no server.

Only what stands on the page needs the extra `explore`.
"""

from creative_nao.explorer.memory_service import MemoryService, Recall
from creative_nao.explorer.registry import cached_map

__all__ = ["MemoryService", "Recall", "cached_map"]
