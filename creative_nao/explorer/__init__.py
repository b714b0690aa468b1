"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

- `Mind`, `Recall`: one memory, asked for movements and what they are worth (`mind.py`).
- `cached_map`: the scored map of a memory, computed once (`maps.py`); `map_view.py` draws it.
- `View`: the window of the PB space that a map shows (`view.py`); `finer_sheet`: finer cells in it (`finer.py`).
- `colours.py`: what the colours may tell; `measuring.py`: their numbers on demand; `legend.py`, `hatching.py`.
- `Subject`: a memory with all that is known of it (`subject.py`); `Shelf`: those that can be shown (`shelf.py`).
- `Body`: the robot as a tree of shapes for the browser, and its performances as clips (`body.py`).
- `curves_svg`: the eight joints over time (`curves.py`); `describe`: scores in words (`words.py`).
- `map_pane.py` and `side.py` show one memory, `look.py` what all maps of a tab have in common, `toolbar.py` and
  `panels.py` the controls; `page.py` puts them together for one browser tab, `layout.py` says where they stand.
- `server.py` serves the page, `security.py` keeps strangers out.
- `static_page`: the same as one file that needs no server (`static_export.py`).

Only what stands on the page needs the extra `explore`.
"""

from creative_nao.explorer.maps import cached_map
from creative_nao.explorer.mind import Mind, Recall

__all__ = ["Mind", "Recall", "cached_map"]
