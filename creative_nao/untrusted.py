"""Bytes, text, JSON and NPZ from files that anybody may have made: bounded before they are read, nothing run.

Every fault is one `FileFormatError` that names the file. Links are followed as the system follows them; what is not a
plain file in the end (a folder, a pipe, a device, a link to nothing) counts as not there.
"""

from __future__ import annotations

import ast
import io
import json
import lzma
import math
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.errors import FileFormatError, NotFoundError

MAX_TEXT_BYTES = 64_000_000
"""Largest JSON file, a run folder's results; smaller limits are given where they are known."""
MAX_UNPACKED_BYTES = 256_000_000
"""Most bytes that the arrays of one NPZ file may unpack to."""
MAX_MEMBERS = 256
_MAX_ARRAY_HEADER = 10_000
_BROKEN_ZIP = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError, ValueError, KeyError, IndexError, TypeError,
    NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


def read_bytes(path: Path, what: str, largest: int = MAX_TEXT_BYTES) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Args:
        path: The file.
        what: What it should be, for messages: ``suite``.
        largest: A larger file is refused before a byte of it is read.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger or cannot be read.
    """
    if not path.is_file():
        raise NotFoundError(f"no {what} at {path}")
    try:
        with open(path, "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            content = b"" if size > largest else stream.read(largest + 1)
    except OSError as error:
        raise FileFormatError(f"{path}: the {what} cannot be read: {error.strerror}") from error
    if max(size, len(content)) > largest:
        raise FileFormatError(f"{path}: has {max(size, len(content))} bytes; a {what} has at most {largest}")
    return content


def read_text(path: Path, what: str, largest: int = MAX_TEXT_BYTES) -> str:
    """Return UTF-8 text, with or without a byte order mark, of a file of at most `largest` bytes.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger, cannot be read, or is not UTF-8.
    """
    try:
        return read_bytes(path, what, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: byte {error.start} of the {what} is not UTF-8 text") from None


def as_json(text: str, where: str) -> Any:
    """Return what JSON text holds; `where` begins the message and names the file.

    Raises:
        FileFormatError: If it is torn, nested too deeply, or holds a number that is not finite.
    """
    try:
        return json.loads(text, parse_constant=_refuse, parse_float=_finite)
    except RecursionError:
        raise FileFormatError(f"{where}: not JSON (it is nested too deeply)") from None
    except ValueError as error:
        raise FileFormatError(f"{where}: not JSON ({error})") from error


def _refuse(word: str) -> float:
    raise ValueError(f"it holds {word}")


def _finite(digits: str) -> float:
    found = float(digits)
    return found if math.isfinite(found) else _refuse(digits[:20])


def whole_number(value: Any) -> int:
    """Return a whole number as JSON holds it.

    Raises:
        ValueError: If it is anything else: text, a truth value, a fraction.
    """
    if type(value) is not int:
        raise ValueError(f"{value!r:.40} is no whole number")
    return value


def read_npz(path: Path, what: str, largest: int = MAX_UNPACKED_BYTES) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file.

    The table of contents is read first; what would unpack to more than `largest` bytes is refused before anything is
    unpacked, and an array is only made when its member holds as many bytes as its shape asks for.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign, too large, or holds objects (a pickle); the message names the array.
    """
    content = read_bytes(path, what, largest)
    where = f"{path}: not a {what}, or a torn one"
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            unpacked = sum(member.file_size for member in members)
            if len(members) > MAX_MEMBERS or unpacked > largest:
                raise FileFormatError(
                    f"{path}: a {what} has at most {MAX_MEMBERS} arrays and {largest} bytes unpacked, but this file "
                    f"announces {len(members)} and {unpacked}"
                )
            return {_array_name(where, member.filename): _array(where, archive, member) for member in members}
    except FileFormatError:
        raise
    except _BROKEN_ZIP as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise FileFormatError(f"{where}: no readable NPZ file: {reason}") from error


def _array_name(where: str, member: str) -> str:
    """Return the array's name; nothing is ever unpacked to disk, but a name that is a path tells a foreign file."""
    name = member.removesuffix(".npy")
    if name == member or not name or any(mark in name for mark in ("/", "\\", "\0", "..", ":")):
        raise FileFormatError(f"{where}: the archive holds {member[:60]!r}, expected arrays as plain names with `.npy`")
    return name


def _array(file: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    where = f"{file}: the array `{_array_name(file, member.filename)[:60]}`"
    with archive.open(member) as stream:
        content = stream.read(member.file_size)  # `read()` would unpack all there is, whatever the contents announce
    width = {1: 2, 2: 4, 3: 4}.get(content[6] if len(content) > 6 else 0)
    if not content.startswith(b"\x93NUMPY") or width is None:
        raise FileFormatError(f"{where} is not in NumPy's format")
    start = 8 + width
    length = int.from_bytes(content[8:start], "little")
    if length > _MAX_ARRAY_HEADER:
        raise FileFormatError(f"{where} announces a header of {length} bytes, expected at most {_MAX_ARRAY_HEADER}")
    try:
        header = ast.literal_eval(content[start : start + length].decode("utf-8").strip())
        dtype, order, shape = np.dtype(str(header["descr"])), header["fortran_order"], header["shape"]
        sound = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
    except (SyntaxError, ValueError, TypeError, KeyError, RecursionError, MemoryError) as error:
        raise FileFormatError(f"{where} has a broken header") from error
    if dtype.kind not in "biufU":
        raise FileFormatError(f"{where} holds {dtype}, expected numbers or text; objects are never unpickled")
    data = content[start + length :]
    if not sound or len(data) != math.prod(shape) * dtype.itemsize:
        raise FileFormatError(f"{where} has {len(data)} bytes, which do not fit {dtype} of shape {str(shape)[:60]}")
    if not dtype.itemsize:
        raise FileFormatError(f"{where} holds texts of no length")
    flat = np.frombuffer(data, dtype=dtype).copy()
    return flat.reshape(shape, order="F" if order else "C")


def take_array(
    path: Path, arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], *, kinds: str, finite: bool = True
) -> np.ndarray:
    """Return one of the arrays of `read_npz` after checking it.

    Args:
        path: The file, for messages.
        arrays: All of its arrays.
        name: Which one.
        shape: Its shape.
        kinds: NumPy's letters for the kinds of values it may hold: ``iu`` whole numbers, ``f`` floating ones.
        finite: Whether NaN and infinities are refused.

    Raises:
        FileFormatError: If it is missing or does not fit; the message names the file and the array.
    """
    if name not in arrays:
        raise FileFormatError(f"{path}: `{name}` is missing; the file has {', '.join(arrays)[:200]}")
    found = arrays[name]
    if found.shape != shape:
        raise FileFormatError(f"{path}: `{name}` should have shape {shape}, but has {found.shape}")
    if found.dtype.kind not in kinds:
        wanted = "floating numbers" if kinds == "f" else "whole numbers"
        raise FileFormatError(f"{path}: `{name}` should hold {wanted}, but holds {found.dtype}")
    if finite and found.dtype.kind == "f" and not np.isfinite(found).all():
        raise FileFormatError(f"{path}: `{name}` should hold finite numbers, but does not")
    return found


def take_header(path: Path, arrays: dict[str, np.ndarray], what: str) -> dict[str, Any]:
    """Return the JSON object that stands as bytes in the array `header`.

    Raises:
        FileFormatError: If it is missing, no bytes, or no JSON object.
    """
    found = arrays.get("header")
    if found is None or found.dtype != np.uint8 or found.ndim != 1:
        raise FileFormatError(f"{path}: not a {what}, or a torn one: the array `header` is missing or holds no bytes")
    try:
        text = found.tobytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: byte {error.start} of its `header` is not UTF-8 text") from None
    header = as_json(text, f"{path}: `header`")
    if not isinstance(header, dict):
        raise FileFormatError(f"{path}: `header` should be a JSON object, but is {header!r:.40}")
    return header
