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
from creative_nao.fields import Fields
from creative_nao.untrusted import as_json, as_text, read_bytes

MAX_HEADER_BYTES = 1_000_000
MAX_FILE_BYTES = 256_000_000
_DTYPES = ("F64", "F32", "F16", "I64", "I32", "I16", "I8", "U64", "U32", "U16", "U8", "BOOL")
"""Kinds of values that NumPy has too."""


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
    told = metadata.get("creative_nao")
    if not isinstance(told, str):
        raise FileFormatError(f"{path}: the JSON header of the {kind} is missing or broken")
    header = as_json(told, f"{path}: the header of the {kind}")
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
    foreign = f"{path}: no {kind} file: its header is not a safetensors header"
    table = as_json(as_text(content[8 : 8 + length], foreign, "header"), foreign)
    if not isinstance(table, dict):
        raise FileFormatError(foreign)
    metadata = table.pop("__metadata__", {})
    if not isinstance(metadata, dict):
        raise FileFormatError(f"{path}: no {kind} file: its header has no metadata")
    available = len(content) - 8 - length
    for name, entry in table.items():
        described = Fields(entry, f"{path}: the array `{name[:60]}`")
        ends = described.listed("data_offsets", most=2)
        if len(ends) != 2 or any(type(end) is not int or end < 0 for end in ends):
            raise described.refuse("data_offsets", "two places in the file")
        if described.any("dtype") not in _DTYPES:
            raise described.refuse("dtype", f"one of {', '.join(_DTYPES)}")
        if ends[1] > available:
            raise FileFormatError(
                f"{path}: the array `{name[:60]}` is torn: it ends at byte {ends[1]} of the data, {available} are there"
            )
    return metadata


def take(
    path: str | os.PathLike[str],
    tensors: dict[str, np.ndarray],
    name: str,
    shape: tuple[int | None, ...],
    dtype: type[np.generic] | None = None,
) -> np.ndarray:
    """Return the array `name` after checking its shape (None matches any size) and that all values are finite.

    Args:
        path: The file, for messages.
        tensors: Its arrays.
        name: Which one.
        shape: What it should be.
        dtype: Kind of its values; None takes any floating kind.

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
    if dtype is not None and array.dtype != dtype:
        raise FileFormatError(f"{path}: the array `{name}` should hold {np.dtype(dtype)}, but holds {array.dtype}")
    if not np.issubdtype(array.dtype, np.floating) or not np.isfinite(array).all():
        raise FileFormatError(f"{path}: the array `{name}` should hold finite numbers, but does not")
    return array
