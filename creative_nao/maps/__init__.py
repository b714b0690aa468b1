"""The map of a memory: which movement lies where in its PB space (the paper's Fig. 4)."""

from creative_nao.maps.grid import PAPER_RESOLUTION, Landscape, landscape, nearest_cell, pb_grid
from creative_nao.maps.map import PBMap, PBSlice, pb_map, pb_slice
from creative_nao.maps.picture import COLOURINGS, check_colour, colour_values

__all__ = [
    "COLOURINGS", "PAPER_RESOLUTION", "Landscape", "PBMap", "PBSlice", "check_colour", "colour_values", "landscape",
    "nearest_cell", "pb_grid", "pb_map", "pb_slice",
]  # fmt: skip
