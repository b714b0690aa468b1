from .grid import (
    PAPER_RESOLUTION,
    Landscape,
    landscape,
    nearest_cell,
    pb_grid,
)
from .map import (
    PBMap,
    PBSlice,
    pb_map,
    pb_slice,
)
from .picture import (
    COLOURINGS,
    check_colour,
    colour_values,
)

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
