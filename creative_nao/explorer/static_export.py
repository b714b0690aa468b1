"""The explorer as one file without a server: the network itself runs in the page, from the memory's weights."""

from __future__ import annotations

import html
import json
from base64 import b64encode
from importlib import util
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.envs.physical_chart import PhysicalMap
from creative_nao.errors import MissingDependencyError
from creative_nao.explorer.body import Body
from creative_nao.explorer.colour_sheets import colour_sheets
from creative_nao.explorer.curves import ORDER
from creative_nao.explorer.maps import cached_map
from creative_nao.explorer.mind import Mind
from creative_nao.explorer.words import spoken
from creative_nao.joints import LIMITS_RAD
from creative_nao.measures import Criteria, excursion_limit
from creative_nao.model import Memory
from creative_nao.pb_space import PAPER_RESOLUTION

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
    mind = Mind(memory)
    data = {
        "memory": memory_data(mind),
        "robot": Body().description(),
        "colours": colour_sheets(memory, cached_map(memory, resolution), physical),
    }
    page = Template((STATIC / "alone.html").read_text(encoding="utf-8")).substitute(
        name=html.escape(memory.name),
        style=(STATIC / "page.css").read_text(encoding="utf-8"),
        data=_in_script(json.dumps(data)),
        modules=_in_script(json.dumps({"imports": _modules()})),
        script=(STATIC / "alone.js").read_text(encoding="utf-8"),
    )
    return atomic.write_text(target, page)


def memory_data(mind: Mind) -> dict[str, Any]:
    """Return what the page needs of a memory: weights, code, basic actions and thresholds; JSON values."""
    memory = mind.memory
    network = memory.network
    first = memory.demonstrations.initial_posture
    rates = 1 / np.repeat(np.array(network.time_constants, np.float32), network.layer_sizes)
    return {
        "names": [spoken(name) for name in mind.names],
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
        "speedLimit": mind.limit_rad_s.tolist(),
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
