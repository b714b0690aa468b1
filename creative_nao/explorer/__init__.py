"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

- `Mind`, `Recall`: one memory, asked for movements and what they are worth (`mind.py`).
- `cached_map`: the scored map of a memory, computed once (`maps.py`); `map_view.py` draws it.
- `Body`: the robot as a tree of shapes for the browser, and its performances as clips (`body.py`).
- `curves_svg`: the eight joints over time (`curves.py`); `describe`: scores in words (`words.py`).
- `page.py` puts them together for one browser tab, `server.py` serves it, `security.py` keeps strangers out.
- `static_page`: the same as one file that needs no server (`static_export.py`).

Only `page.py` and `server.py` need the extra `explore`.
"""

from creative_nao.explorer.maps import cached_map
from creative_nao.explorer.mind import Mind, Recall

__all__ = ["Mind", "Recall", "cached_map"]
