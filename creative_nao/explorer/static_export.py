"""The explorer as one file without a server: its scripts, a memory and what the server would be asked for."""

from __future__ import annotations

import hashlib
import json
import re
from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.explorer.live_agents import agents_for, tries
from creative_nao.explorer.registry import COLOURS, PHYSICAL, LoadedMemory
from creative_nao.explorer.robot_service import BrowserRobot
from creative_nao.maps import PAPER_RESOLUTION
from creative_nao.model import Memory

STATIC = Path(__file__).with_name("static")
MODULES = ("engine", "map", "robot", "source", "drawing", "shows", "page")
_import = re.compile(r'^import .*? from "\./\w+\.js";\n', re.MULTILINE | re.DOTALL)


def write_page(
    memory: Memory, target: Path, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None
) -> Path:
    """Write the page to an HTML file, replaced in one step; it opens by double click and asks nothing of a network.

    SettingsError if the memory has other than the eight arm joints or two PB units.
    """
    loaded = LoadedMemory(memory, resolution, physical)
    loaded.compute()
    agents = agents_for(memory)
    pair = [*dict.fromkeys((agents["guide"], *agents["pair"]))][:2]
    data = {
        "page": loaded.page_json() | {"agents": {**agents, "pair": pair, "groups": [["", pair]]}, "dots": []},
        "robot": BrowserRobot().description,
        "colours": {
            name: loaded.cells(name) for name in COLOURS if physical is not None or not name.startswith(PHYSICAL)
        },
        "tries": {name: tries(memory, name, 1) for name in pair},
    }
    return storage.write_text(target, page(memory.name, data))


def page(name: str, data: dict[str, Any]) -> str:
    """Return the page as one text that runs its own scripts and no others, and shows `data` (JSON values)."""
    style = (STATIC / "page.css").read_text(encoding="utf-8")
    library, script = (STATIC / "three.min.js").read_text(encoding="utf-8"), bundled()
    policy = (
        f"default-src 'none'; script-src {_hash(library)} {_hash(script)}; style-src {_hash(style)}; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    text = (STATIC / "index.html").read_text(encoding="utf-8")
    head = '<meta charset="utf-8">\n'
    parts = {
        head: f'{head}<meta http-equiv="Content-Security-Policy" content="{policy}">\n',
        "<title>Memory explorer</title>": f"<title>{escape(name)}: memory explorer</title>",
        '<link rel="stylesheet" href="static/page.css">': f"<style>{style}</style>",
        '<script src="static/three.min.js"></script>': f"<script>{library}</script>",
        '<script type="module" src="static/page.js"></script>': (
            f'<script type="application/json" id="data">{_in_script(json.dumps(data))}</script>\n'
            f'<script type="module">{script}</script>'
        ),
    }
    for place, content in parts.items():
        assert text.count(place) == 1, place
        text = text.replace(place, content)
    return text


def bundled() -> str:
    """Return the page's modules as one: they share no name at their top, so what they import is simply there."""
    modules = [(STATIC / f"{name}.js").read_text(encoding="utf-8") for name in MODULES]
    return "".join(re.sub(r"^export ", "", _import.sub("", module), flags=re.MULTILINE) for module in modules)


def _hash(content: str) -> str:
    return f"'sha256-{b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


def _in_script(text: str) -> str:
    """Return JSON that cannot end the script element that it stands in."""
    return text.replace("<", "\\u003c")
