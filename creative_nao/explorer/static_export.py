"""The explorer as one file without a server: the network itself runs in the page, from the memory's weights."""

from __future__ import annotations

import dataclasses
import html
import io
import json
import zlib
from base64 import b64encode
from importlib import util
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from PIL import Image

from creative_nao import storage
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.errors import MissingDependencyError
from creative_nao.explorer.colours import (
    NAMES,
    PATTERNS,
    STRENGTH,
    Chart,
    Computation,
    Scale,
    cell_colours,
    figure_of_body,
    is_number,
    is_of_body,
    legend_html,
    measured,
    scale_label,
    spans,
)
from creative_nao.explorer.map_pane import borders
from creative_nao.explorer.memory_service import ORDER, MemoryService, spoken
from creative_nao.explorer.physics_service import BrowserRobot
from creative_nao.explorer.registry import cached_map
from creative_nao.explorer.view import SIZE, View
from creative_nao.joints import LIMITS_RAD
from creative_nao.maps import PAPER_RESOLUTION, PBMap
from creative_nao.maps.figure_style import INK, UNUSABLE, rgb
from creative_nao.maps.picture import MEASURE_COLOURS
from creative_nao.measures import Criteria, excursion_limit
from creative_nao.model import Memory

LEVELS = 256 - len(UNUSABLE)
"""Steps of a scale; the bytes above them are the outcomes that cannot be used, which have no number."""


def colour_sheets(memory: Memory, chart: PBMap, physical: PhysicalMap | None = None) -> dict[str, Any]:
    """Return the colourings of a map; JSON values.

    Args:
        memory: Makes the movements again where the map does not hold them: about a second of a core for a fine map.
        chart: The map of the whole PB space.
        physical: What the robot's body makes of every movement, if that was worked out.

    Returns:
        `levels`: the steps of a scale. `textures`: pictures of hatching and borders as data addresses, to lie over the
        cells, one a map. `sheets`: for each colouring its `name` and `text`, which of the `textures` belongs to it, `n`
        cells along a panel, `plane` (a byte a cell, row 0 at the lowest PB 2, each but the first of a row less the one
        before it, deflated), `palette` (red, green and blue of each byte), `legend` (HTML), and for a number `label`,
        `low` and `high`.
    """
    if chart.trajectories is None:
        chart = dataclasses.replace(chart, trajectories=memory.generate(chart.pb), dt_s=memory.dt_s)
    sheets = []
    for name, text in NAMES.items():
        of_body = is_of_body(name)
        if of_body and physical is None:
            continue
        of: Chart = physical if of_body and physical is not None else chart
        values = _values(memory, of, name) if is_number(name) else None
        sheets.append({"name": name, "text": text, "texture": int(of_body), **_sheet(of, name, values)})
    textures = [texture_address(one) for one in (chart, physical) if one is not None]
    return {"levels": LEVELS, "textures": textures, "sheets": sheets}


def _values(memory: Memory, chart: Chart, name: str) -> np.ndarray:
    if isinstance(chart, PhysicalMap):
        return figure_of_body(chart, name)
    values = measured(memory, chart, name, chart, Computation())
    assert values is not None  # nobody calls this work off
    return values


def _sheet(chart: Chart, name: str, values: np.ndarray | None) -> dict[str, Any]:
    n = chart.resolution
    if values is None:
        drawn = Image.fromarray(np.round(255 * cell_colours(chart, name)).astype(np.uint8)).quantize(256)
        told = {"legend": legend_html(chart, name)}
        plane, palette = np.asarray(drawn), np.array(drawn.getpalette(), np.uint8)
    else:
        low, high = spans([chart], [values])
        plane, palette = _steps(chart, values, low, high)
        label = scale_label(name)
        told = {"legend": legend_html(chart, name, Scale(label, low, high)), "label": label, "low": low, "high": high}
    differences = np.diff(plane.reshape(n, n), axis=1, prepend=np.uint8(0))
    return {
        "n": n,
        "plane": _text(zlib.compress(differences.tobytes(), 9)),
        "palette": _text(palette.tobytes()),
        **told,
    }


def _steps(chart: Chart, values: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of each cell and the colour of each step."""
    from matplotlib import colormaps

    share = (values - low) / (high - low) if high > low else np.zeros(len(values))
    plane = np.clip(np.floor(LEVELS * share), 0, LEVELS - 1).astype(np.uint8)
    for place, outcome in enumerate(UNUSABLE):
        plane[chart.outcome == outcome] = LEVELS + place
    ramp = colormaps[MEASURE_COLOURS]((np.arange(LEVELS) + 0.5) / LEVELS)[:, :3]
    palette = np.concatenate([ramp, [rgb(colour) for colour, _ in UNUSABLE.values()]])
    return plane, np.round(255 * palette).astype(np.uint8)


def texture_address(chart: Chart) -> str:
    """Return what lies over the colours of a map as a data address: hatching half see-through, and borders."""
    n = chart.resolution
    rows, columns = View.of(chart).cells(chart)
    outcome = chart.outcome.reshape(n, n)[np.ix_(rows, columns)]
    up, across = np.mgrid[:SIZE, :SIZE]
    drawn = np.zeros((SIZE, SIZE), np.uint8)
    for name, pattern in PATTERNS.items():
        drawn[(outcome == name) & pattern(up, across)] = 1
    drawn[borders(chart, rows, columns)] = 2
    picture = Image.fromarray(drawn, mode="P")
    picture.putpalette([255, 255, 255, 255, 255, 255, *(round(255 * one) for one in rgb(INK))])
    stream = io.BytesIO()
    picture.save(stream, format="PNG", optimize=True, bits=2, transparency=bytes([0, round(255 * STRENGTH), 255]))
    return f"data:image/png;base64,{_text(stream.getvalue())}"


def _text(content: bytes) -> str:
    return b64encode(content).decode()


STATIC = Path(__file__).with_name("static")


def write_page(
    memory: Memory, target: Path, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None
) -> Path:
    """Write the page and return its path; it opens by double click and asks nothing of a network.

    Args:
        memory: A memory with two PB units and the eight arm joints.
        target: HTML file, replaced in one step.
        resolution: Points along each axis of the map.
        physical: A physical map of the memory, whose colourings the page then has as well.

    Raises:
        SettingsError: If the memory has other joints or another number of PB units.
        MissingDependencyError: If the 3-D library of the extra `explore` is not there.
    """
    service = MemoryService(memory)
    data = {
        "memory": memory_data(service),
        "robot": BrowserRobot().description(),
        "colours": colour_sheets(memory, cached_map(memory, resolution), physical),
    }
    page = Template((STATIC / "alone.html").read_text(encoding="utf-8")).substitute(
        name=html.escape(memory.name),
        style=(STATIC / "page.css").read_text(encoding="utf-8"),
        data=_in_script(json.dumps(data)),
        modules=_in_script(json.dumps({"imports": _modules()})),
        script=(STATIC / "alone.js").read_text(encoding="utf-8"),
    )
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
        "demonstrations": [one.tolist() for one in memory.demonstrations.trajectories],
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
    found = util.find_spec("nicegui")
    if found is None or found.origin is None:
        raise MissingDependencyError(
            'a page of its own needs NiceGUI\'s 3-D library: pip install "creative-nao[explore]"'
        )
    library = Path(found.origin).parent / "elements" / "scene" / "dist" / "index.js"
    sources = {"nicegui-scene": library}
    sources |= {f"cn-{name}": STATIC / f"{name}.js" for name in ("robot", "network", "attribution", "colouring")}
    return {name: _address("text/javascript", path.read_bytes()) for name, path in sources.items()}


def _address(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{b64encode(content).decode()}"


def _packed(array: np.ndarray) -> str:
    return b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode()


def _in_script(text: str) -> str:
    """Return JSON that cannot end the script element that it stands in."""
    return text.replace("</", "<\\/").replace("<!--", "<\\u0021--")
