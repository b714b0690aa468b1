"""Files of named arrays with a JSON header, in the safetensors format: nothing in them can run.

A memory, a checkpoint and an agent bundle are such files. Before the arrays are read, the frame is checked byte by
byte, so that a torn or foreign file is named together with the part that is wrong.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.atomic import write_bytes
from creative_nao.errors import FileFormatError
from creative_nao.untrusted import read_bytes

MAX_HEADER_BYTES = 1_000_000
MAX_FILE_BYTES = 256_000_000


def save_tensors(
    path: str | os.PathLike[str], *, kind: str, header: dict[str, Any], tensors: dict[str, np.ndarray]
) -> Path:
    """Write `tensors` and a JSON-able `header` to one file, in one step, and return its path.

    Args:
        path: The file to make or replace.
        kind: What the file holds, for example ``memory``; checked when it is read.
        header: Everything that is not an array. Only what JSON can hold; no NaN.
        tensors: Arrays by name.
    """
    from safetensors.numpy import save

    # One entry only: the format keeps several in no fixed order, and equal content should give equal bytes.
    metadata = {"creative_nao": json.dumps({"kind": kind, **header}, allow_nan=False)}
    return write_bytes(path, save({name: np.asarray(a, order="C") for name, a in tensors.items()}, metadata))


def load_tensors(path: str | os.PathLike[str], *, kind: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a file of `save_tensors`.

    Returns:
        The header and the arrays by name.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign, too large or of another kind; the message names the part.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    path = Path(path)
    content = read_bytes(path, f"{kind} file", MAX_FILE_BYTES)
    metadata = _check_frame(path, kind, content)
    try:
        header = json.loads(metadata["creative_nao"])
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: the JSON header of the {kind} is missing or broken") from error
    if not isinstance(header, dict):
        raise FileFormatError(f"{path}: the JSON header of the {kind} should be an object, but is {header!r:.40}")
    found = header.pop("kind", None)
    if found != kind:
        raise FileFormatError(f"{path}: expected kind {kind!r}, but its header says kind {found!r}")
    try:
        return header, load(content)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise FileFormatError(f"{path}: the arrays of the {kind} cannot be read: {error}") from error


def _check_frame(path: Path, kind: str, content: bytes) -> dict[str, Any]:
    """Check lengths and offsets of a safetensors file; return its metadata."""
    if len(content) < 8:
        raise FileFormatError(f"{path}: no {kind} file: the header length needs 8 bytes, the file has {len(content)}")
    length = int.from_bytes(content[:8], "little")
    if length > MAX_HEADER_BYTES:
        raise FileFormatError(f"{path}: no {kind} file: its first 8 bytes announce a header of {length} bytes")
    if 8 + length > len(content):
        raise FileFormatError(f"{path}: the header is torn: {length} bytes announced, {len(content) - 8} are there")
    try:
        table = json.loads(content[8 : 8 + length])
        entries = {name: entry["data_offsets"] for name, entry in table.items() if name != "__metadata__"}
        metadata = table.get("__metadata__", {})
        ends = {name: (int(start), int(end)) for name, (start, end) in entries.items()}
    except (UnicodeDecodeError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileFormatError(f"{path}: no {kind} file: its header is not a safetensors header") from error
    if not isinstance(metadata, dict):
        raise FileFormatError(f"{path}: no {kind} file: its header has no metadata")
    available = len(content) - 8 - length
    for name, (_, end) in sorted(ends.items(), key=lambda item: item[1]):
        if end > available:
            raise FileFormatError(
                f"{path}: the array `{name}` is torn: it ends at byte {end} of the data, {available} are there"
            )
    return metadata


def take(
    path: str | os.PathLike[str], tensors: dict[str, np.ndarray], name: str, shape: tuple[int | None, ...]
) -> np.ndarray:
    """Return the array `name` after checking its shape (None matches any size) and that all values are finite.

    Raises:
        FileFormatError: If it is missing or does not fit; the message names the file and the array.
    """
    if name not in tensors:
        raise FileFormatError(f"{path}: the array `{name}` is missing")
    array = tensors[name]
    fits = array.ndim == len(shape) and all(e in (None, n) for e, n in zip(shape, array.shape, strict=True))
    if not fits:
        expected = ", ".join("any" if e is None else str(e) for e in shape)
        raise FileFormatError(f"{path}: the array `{name}` should have shape ({expected}), but has {array.shape}")
    if not np.issubdtype(array.dtype, np.floating) or not np.isfinite(array).all():
        raise FileFormatError(f"{path}: the array `{name}` should hold finite numbers, but does not")
    return array
