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
- Beside the map: `discover.py` (surprises), `session.py` (favourites) with `thumbnails.py`, `recordings.py` (files in,
  files out), `attribution_strip.py` (what a movement resembles when), `stage.py` (the body), `physical.py` (its map).
- `charting.py`: a coarse map at once, the fine one when it is there; `work.py`: work that can be called off.
- `server.py` serves the page, `in_turn.py` builds few at a time, `security.py` keeps strangers out, `tabs.py` frees
  what a closed tab held, `address.py` writes what a tab shows as an address.
- Teaching: `teach_page.py` with `teach_editor.py`, `teach_training.py` and `teach_drawings.py`; `notebook.py` holds the
  demonstrations, `notebook_checks.py` says what is wrong with them; `apprentice.py` learns them, one of a `school.py`;
  `taught.py` shows the outcome.
- `write_page`: the same as one file that needs no server (`static_export.py`),
  in all its colours (`colour_sheets.py`).

Only what stands on the page needs the extra `explore`.
"""

from creative_nao.explorer.memory_service import Mind, Recall
from creative_nao.explorer.registry import cached_map

__all__ = ["Mind", "Recall", "cached_map"]
