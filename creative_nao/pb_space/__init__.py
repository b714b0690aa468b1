"""The chart of a memory: which movement lies where in its PB space (the paper's Fig. 4).

- `pb_map` -> `PBMap`: the whole grid generated and scored, saved, loaded, drawn.
- `pb_slice` -> `PBSlice`: the same over two of several PB units.
- `landscape` -> `Landscape`: the shape of a map in numbers (regions, borders, evenness, ruggedness).
- `COLOURINGS`, `check_colour`, `colour_values`: what the colours of a map may tell (`colouring.py`).
- `pb_grid`, `nearest_cell`: the points of the grid.
"""

from creative_nao.pb_space.chart import PBMap, pb_map
from creative_nao.pb_space.colouring import COLOURINGS, check_colour, colour_values
from creative_nao.pb_space.grid import PAPER_RESOLUTION, nearest_cell, pb_grid
from creative_nao.pb_space.landscape import Landscape, landscape
from creative_nao.pb_space.slices import PBSlice, pb_slice

__all__ = [
    "COLOURINGS",
    "PAPER_RESOLUTION",
    "Landscape",
    "PBMap",
    "PBSlice",
    "check_colour",
    "colour_values",
    "landscape",
    "nearest_cell",
    "pb_grid",
    "pb_map",
    "pb_slice",
]
