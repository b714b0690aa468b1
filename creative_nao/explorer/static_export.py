"""The explorer as one file without a server: the network itself runs in the page, from the memory's weights."""

from __future__ import annotations

import dataclasses
import json
import zlib
from base64 import b64encode
from pathlib import Path
from typing import Any

import nicegui
import numpy as np
from PIL import Image

from creative_nao import storage
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.evaluation.pages import render
from creative_nao.explorer import colours
from creative_nao.explorer.markup import ORDER, TEMPLATES, legend_html
from creative_nao.explorer.memory_service import MemoryService, spoken
from creative_nao.explorer.physics_service import STATIC, BrowserRobot
from creative_nao.explorer.registry import Computation, cached_map, measured
from creative_nao.explorer.view import SIZE, View
from creative_nao.joints import LIMITS_RAD
from creative_nao.maps import PAPER_RESOLUTION, PBMap
from creative_nao.maps.figure_style import INK, UNUSABLE, rgb
from creative_nao.maps.picture import MEASURE_COLOURS, measure_span
from creative_nao.measures import Criteria, excursion_limit
from creative_nao.model import Memory

LEVELS = 256 - len(UNUSABLE)
"""Steps of a scale; the bytes above them are the outcomes that cannot be used, which have no number."""


def colour_sheets(memory: Memory, pb_map: PBMap, physical: PhysicalMap | None = None) -> dict[str, Any]:
    """Return the colourings of a map of the whole PB space and, if there is one, of a physical map; JSON values.

    `levels`: the steps of a scale. `textures`: pictures of hatching and borders as data addresses, to lie over the
    cells, one a map. `sheets`: for each colouring its `name` and `text`, which of the `textures` belongs to it, `n`
    cells along a panel, `plane` (a byte a cell, row 0 at the lowest PB 2, each but the first of a row less the one
    before it, deflated), `palette` (red, green and blue of each byte), `legend` (HTML), and for a number `label`,
    `low` and `high`.
    """
    if pb_map.trajectories is None:
        pb_map = dataclasses.replace(pb_map, trajectories=memory.generate(pb_map.pb), dt_s=memory.dt_s)
    sheets = []
    for name, text in colours.NAMES.items():
        values = None
        if not colours.is_physical(name):
            coloured = pb_map
            values = measured(memory, pb_map, name, pb_map, Computation()) if colours.is_number(name) else None
        elif physical is not None:
            coloured = physical
            values = colours.physical_figure(physical, name) if colours.is_number(name) else None
        else:
            continue
        sheet = _sheet(coloured, name, values)
        sheets.append({"name": name, "text": text, "texture": int(colours.is_physical(name)), **sheet})
    textures = [texture_address(drawn) for drawn in (pb_map, physical) if drawn is not None]
    return {"levels": LEVELS, "textures": textures, "sheets": sheets}


def _sheet(pb_map: PBMap, name: str, values: np.ndarray | None) -> dict[str, Any]:
    n = pb_map.resolution
    if values is None:
        drawn = colours.as_picture(colours.cell_colours(pb_map, name)).quantize(256)
        scale = {"legend": legend_html(pb_map, name)}
        plane, palette = np.asarray(drawn), np.array(drawn.getpalette(), np.uint8)
    else:
        low, high = span = measure_span(pb_map, values)
        plane, palette = _steps(pb_map, values, low, high)
        scale = {"legend": legend_html(pb_map, name, span), "label": colours.scale_label(name)}
        scale |= {"low": low, "high": high}
    differences = np.diff(plane.reshape(n, n), axis=1, prepend=np.uint8(0))
    return {
        "n": n, "plane": _text(zlib.compress(differences.tobytes(), 9)), "palette": _text(palette.tobytes()), **scale
    }  # fmt: skip


def _steps(pb_map: PBMap, values: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of each cell and the colour of each step."""
    from matplotlib import colormaps

    share = (values - low) / (high - low) if high > low else np.zeros(len(values))
    plane = np.clip(np.floor(LEVELS * share), 0, LEVELS - 1).astype(np.uint8)
    for place, outcome in enumerate(UNUSABLE):
        plane[pb_map.outcome == outcome] = LEVELS + place
    ramp = colormaps[MEASURE_COLOURS]((np.arange(LEVELS) + 0.5) / LEVELS)[:, :3]
    palette = np.concatenate([ramp, [rgb(colour) for colour, _ in UNUSABLE.values()]])
    return plane, np.round(255 * palette).astype(np.uint8)


def texture_address(pb_map: PBMap) -> str:
    """Return what lies over the colours of a map as a data address: hatching half see-through, and borders."""
    rows, columns = View.of(pb_map).cells(pb_map)
    outcome = pb_map.outcome.reshape(pb_map.resolution, -1)[np.ix_(rows, columns)]
    up, across = np.mgrid[:SIZE, :SIZE]
    drawn = np.zeros((SIZE, SIZE), np.uint8)
    for name, pattern in colours.PATTERNS.items():
        drawn[(outcome == name) & pattern(up, across)] = 1
    drawn[colours.borders(pb_map, rows, columns)] = 2
    picture = Image.fromarray(drawn, mode="P")
    picture.putpalette([255, 255, 255, 255, 255, 255, *(round(255 * channel) for channel in rgb(INK))])
    return colours.png_address(
        picture, optimize=True, bits=2, transparency=bytes([0, round(255 * colours.STRENGTH), 255])
    )


def _text(content: bytes) -> str:
    return b64encode(content).decode()


def write_page(
    memory: Memory, target: Path, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None
) -> Path:
    """Write the page to an HTML file, replaced in one step; it opens by double click and asks nothing of a network.

    SettingsError if the memory has other than the eight arm joints or two PB units.
    """
    service = MemoryService(memory)
    data = {
        "memory": memory_data(service),
        "robot": BrowserRobot().description,
        "colours": colour_sheets(memory, cached_map(memory, resolution), physical),
    }
    page = render(
        "alone.html.jinja", TEMPLATES, name=memory.name,
        style=(STATIC / "page.css").read_text(encoding="utf-8"),
        data=_in_script(json.dumps(data)),
        modules=_in_script(json.dumps({"imports": _modules()})),
        script=(STATIC / "alone.js").read_text(encoding="utf-8"),
    )  # fmt: skip
    return storage.write_text(target, page)


def memory_data(service: MemoryService) -> dict[str, Any]:
    """Return what the page needs of a memory: weights, code, basic actions and thresholds; JSON values."""
    memory = service.memory
    network = memory.network
    first = memory.demonstrations.initial_posture
    rates = 1 / np.repeat(np.array(network.time_constants, np.float32), network.layer_sizes)
    return {
        "names": [spoken(name) for name in service.names],
        "joints": list(memory.joints),
        "order": list(ORDER),
        "dt": memory.dt_s,
        "nSteps": memory.n_steps,
        "nUnits": network.n_softmax_units,
        "nFast": network.layer_sizes[0],
        "pb": memory.pb.tolist(),
        "demonstrations": [trajectory.tolist() for trajectory in memory.demonstrations.trajectories],
        "weights": {name: _packed(array) for name, array in memory.parameters.items() if name != "rho"},
        "references": _packed(memory.encoding.references),
        "rate": _packed(rates),
        "firstPosture": np.asarray(first).tolist(),
        "firstCode": _packed(memory.encoding.encode(first)),
        "limits": [list(LIMITS_RAD[joint]) for joint in memory.joints],
        "speedLimit": service.limit_rad_s.tolist(),
        "travelLimit": excursion_limit(memory.demonstrations),
        "learnedThreshold": Criteria().learned_threshold,
    }


def _modules() -> dict[str, str]:
    """Return the scripts as data addresses; the 3-D library keeps its own licence notice at its head."""
    sources = {"nicegui-scene": Path(nicegui.__file__).parent / "elements" / "scene" / "dist" / "index.js"}
    sources |= {f"cn-{name}": STATIC / f"{name}.js" for name in ("robot", "network", "attribution", "colouring")}
    return {name: colours.data_address("text/javascript", path.read_bytes()) for name, path in sources.items()}


def _packed(array: np.ndarray) -> str:
    return _text(np.ascontiguousarray(array, dtype="<f4").tobytes())


def _in_script(text: str) -> str:
    """Return JSON that cannot end the script element that it stands in."""
    return text.replace("</", "<\\/").replace("<!--", "<\\u0021--")
