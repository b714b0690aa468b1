"""The trained agents that come with the package, and finding a bundle by name or path."""

from __future__ import annotations

import os
from pathlib import Path

from creative_nao.errors import NotFoundError, nearest_name

PRETRAINED = Path(__file__).parent / "pretrained"


def shipped_agents() -> tuple[str, ...]:
    """Return the names of the shipped agents, algorithm and environment: ``ppo/BoxingMental-v0``, ..."""
    return tuple(sorted(path.stem.replace("-", "/", 1) for path in PRETRAINED.glob("*-*.safetensors")))


def find_bundle(name: str | os.PathLike[str]) -> Path:
    """Return the path of a bundle.

    Args:
        name: A shipped name such as ``ppo/BoxingMental-v0``, or the path of a file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
    """
    text = os.fspath(name)
    names = shipped_agents()
    if text in names:
        return PRETRAINED / f"{text.replace('/', '-', 1)}.safetensors"
    if os.path.isfile(text):
        return Path(text)
    raise NotFoundError(
        f"no agent bundle file at {text}{nearest_name(text, names)}: neither a file nor a shipped name; "
        f"shipped are {', '.join(names) or 'none'}"
    )
