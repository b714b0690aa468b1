"""The memories that come with the package, and finding a memory by name or path."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.model.memory import Memory

PRETRAINED = Path(__file__).parent / "pretrained"
SCORES = PRETRAINED / "scores.json"
CONDITIONS = {"open": 0.0, "half": 0.5, "closed": 1.0}
"""The paper's three closed-loop ratios by name."""

SPLITS = {"train": range(10), "validation": range(10, 12), "test": range(12, 16)}
"""Seeds of the bank's three parts, each with all conditions. Agents learn on `train`, are tuned on `validation` and
judged on `test`, whose memories no training ever sees."""


def split_memories(split: str) -> tuple[str, ...]:
    """Return the names of the shipped memories of one part of the bank.

    Args:
        split: `train`, `validation` or `test`.

    Raises:
        NotFoundError: If there is no such part, or none of its memories ships.
    """
    if split not in SPLITS:
        raise NotFoundError(f"no split `{split}`{nearest_name(split, SPLITS)}; there are {', '.join(SPLITS)}")
    names = tuple(name for name in shipped_memories() if int(name.split("/")[1]) in SPLITS[split])
    if not names:
        raise NotFoundError(f"no memory of the split `{split}` ships with this installation")
    return names


def split_of(name: str) -> str:
    """Return the part of the bank that a shipped memory such as ``half/0`` belongs to."""
    seed = int(name.split("/")[1])
    return next((split for split, seeds in SPLITS.items() if seed in seeds), "none")


def shipped_scores() -> dict[str, dict[str, Any]]:
    """Return the figures of the shipped memories by name, as `creative-nao memories --rescore` wrote them.

    Each has `best_loss`, `worst_reproduction_dtw` [rad], and the figures of the paper's Table I over the 200 x 200 map.
    """
    return json.loads(SCORES.read_text(encoding="utf-8"))["memories"] if SCORES.is_file() else {}


def shipped_memories() -> tuple[str, ...]:
    """Return the names of the shipped memories, condition and seed: ``open/0``, ``half/0``, ``closed/0``, ..."""
    found = [path.stem.rsplit("-", 1) for path in PRETRAINED.glob("*-*.safetensors")]
    order = list(CONDITIONS)
    return tuple(f"{c}/{s}" for c, s in sorted(found, key=lambda item: (order.index(item[0]), int(item[1]))))


def load_memory(name: str | os.PathLike[str]) -> Memory:
    """Load a memory by shipped name or from a file.

    Args:
        name: A shipped name such as ``half/0``, or the path of a memory file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
        FileFormatError: If the file is torn or foreign.
    """
    text = os.fspath(name)
    names = shipped_memories()
    if text in names:
        condition, seed = text.split("/")
        return Memory.read(PRETRAINED / f"{condition}-{seed}.safetensors", name=text)
    if Path(text).is_file():
        return Memory.read(text)
    if text in SPLITS:
        raise NotFoundError(
            f"`{text}` is a part of the bank, not one memory; an environment draws from it, "
            f"split_memories({text!r}) lists it"
        )
    raise NotFoundError(
        f"no memory `{text}`{nearest_name(text, names)}: neither a file nor a shipped name; "
        f"shipped are {', '.join(names)}"
    )
