"""Files of named arrays: safetensors with a JSON header, and NPZ files, counted before they are unpacked.

Nothing in them can run. Before the arrays are read, the frame is checked byte by byte, so that a torn or foreign file
is named together with the part that is wrong. Both carry SHA-256 digests of every byte: a safetensors file one of its
header and one of each array, an NPZ file one of the whole archive as the archive's comment.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import lzma
import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from creative_nao.errors import FileFormatError, shown
from creative_nao.schema import Index, checked_path, parse, record
from creative_nao.storage import BLANK, SEAL, as_json, as_text, note_unsealed, read_bytes, sealed, unsealed, write_bytes

MAX_HEADER_BYTES = 1_000_000
MAX_FILE_BYTES = 256_000_000
_OF_ARRAYS = "arrays_sha256"
"""Key of a header: the SHA-256 of each array by its name; the `SEAL` beside it is that of the header."""
Shared = Callable[[], Mapping[str, np.ndarray]]
"""Gives arrays that every installation has, by their SHA-256: a packed file only names them."""
_XZ = b"\xfd7zXZ\0"
_XZ_MEMORY_BYTES = 100_000_000  # most that unpacking may take; the highest level of `xz` asks for 65 MB
_FOR_FLOATS = {
    "id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 2, "pb": 2, "dict_size": 2**20,
}  # fmt: skip


@record
class _Entry:
    """An array in the frame of a safetensors file, of a type that NumPy has too."""

    dtype: Literal["F64", "F32", "F16", "I64", "I32", "I16", "I8", "U64", "U32", "U16", "U8", "BOOL"]
    shape: tuple[Index, ...]
    data_offsets: tuple[Index, Index]


def save_tensors(
    path: str | os.PathLike[str],
    *,
    kind: str,
    header: dict[str, Any],
    tensors: dict[str, np.ndarray],
    shared: Shared = dict,
) -> Path:
    """Write `tensors` and a `header` of JSON values without NaN to one file, in one step, and return its path.

    `kind` says what the file holds, for example ``memory``; it is checked when the file is read. A path that ends in
    ``.xz`` gets a packed file: compressed without loss, and of the `shared` arrays it holds the SHA-256 only.
    """
    path = checked_path(path)
    tensors = {name: np.asarray(one, one.dtype.newbyteorder("="), order="C") for name, one in tensors.items()}
    digests = {name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in tensors.items()}
    if path.suffix == ".xz":
        tensors = {name: array for name, array in tensors.items() if digests[name] not in shared()}
    content = _framed({"kind": kind, SEAL: BLANK, _OF_ARRAYS: digests, **header}, tensors)
    end = 8 + int.from_bytes(content[:8], "little")
    content = sealed(content[:end]) + content[end:]
    return write_bytes(path, lzma.compress(content, filters=[_FOR_FLOATS]) if path.suffix == ".xz" else content)


def _framed(told: dict[str, Any], tensors: dict[str, np.ndarray]) -> bytes:
    from safetensors.numpy import save

    # One entry only: the format keeps several in no fixed order, and equal content should give equal bytes.
    metadata = {"creative_nao": json.dumps(told, allow_nan=False)}
    return save(tensors, metadata)


def unsealed_sha256(path: str | os.PathLike[str], *, kind: str, shared: Shared = dict) -> str:
    """Return the SHA-256 that a file of `save_tensors` has, or had, without the digests in its header.

    Release 0.1.0 wrote none: the records of its runs name the shipped memories and agents by this hash.
    """
    header, tensors = load_tensors(path, kind=kind, shared=shared)
    return hashlib.sha256(_framed({"kind": kind, **header}, tensors)).hexdigest()


def load_tensors(
    path: str | os.PathLike[str], *, kind: str, shared: Shared = dict
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the header and the arrays by name of a file of `save_tensors`, packed or not.

    An array that the header names by its SHA-256 and the file does not hold is taken from `shared`, if it is there.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign, too large or of another kind; the message names the part.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    path = checked_path(path)
    content = _without_xz(path, kind, read_bytes(path, f"{kind} file", MAX_FILE_BYTES))
    metadata, entries = _check_frame(path, kind, content)
    told = metadata.get("creative_nao")
    if not isinstance(told, str):
        raise FileFormatError(f"{path}: the JSON header of the {kind} is missing or broken")
    header = as_json(told, f"{path}: the header of the {kind}")
    if not isinstance(header, dict):
        raise FileFormatError(f"{path}: the JSON header of the {kind} should be an object, but is {header!r:.40}")
    end = 8 + int.from_bytes(content[:8], "little")
    header = unsealed(header, content[:end], f"{path}: header")
    digests = header.pop(_OF_ARRAYS, {})
    if not isinstance(digests, dict):
        raise FileFormatError(f"{path}: header: `{_OF_ARRAYS}` should be an object, but is {shown(digests)}")
    for name, entry in entries.items():
        data = memoryview(content)[end:][slice(*entry.data_offsets)]
        if digests and hashlib.sha256(data).hexdigest() != digests.get(name):
            raise FileFormatError(f"{path}: the array `{name[:60]}` is damaged: it does not fit its SHA-256")
    found = header.pop("kind", None)
    if found != kind:
        raise FileFormatError(f"{path}: expected kind {kind!r}, but its header says kind {found!r}")
    left_out = {name: digest for name, digest in digests.items() if name not in entries}
    known = shared() if left_out else {}
    filled = {name: known[digest] for name, digest in left_out.items() if isinstance(digest, str) and digest in known}
    try:
        return header, load(content) | filled
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise FileFormatError(f"{path}: the arrays of the {kind} cannot be read: {error}") from error


def _without_xz(path: Path, kind: str, content: bytes) -> bytes:
    """Return the content of a packed file, of at most `MAX_FILE_BYTES`; that of any other file as it is."""
    if not content.startswith(_XZ):
        return content
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_XZ_MEMORY_BYTES)
    try:
        content = unpacker.decompress(content, MAX_FILE_BYTES + 1)
    except (lzma.LZMAError, MemoryError) as error:
        raise FileFormatError(f"{path}: no {kind} file: its XZ compression is damaged: {error}") from error
    if len(content) > MAX_FILE_BYTES:
        raise FileFormatError(f"{path}: no {kind} file: it unpacks to more than {MAX_FILE_BYTES} bytes")
    if not unpacker.eof or unpacker.unused_data:
        raise FileFormatError(f"{path}: no {kind} file: its XZ compression is torn, or followed by something else")
    return content


def _check_frame(path: Path, kind: str, content: bytes) -> tuple[dict[str, Any], dict[str, _Entry]]:
    """Check lengths and offsets of a safetensors file; return its metadata and what it says of its arrays."""
    if len(content) < 8:
        raise FileFormatError(f"{path}: no {kind} file: the header length needs 8 bytes, the file has {len(content)}")
    if content.startswith(b"PK\3\4"):
        way = ""
        if kind == "agent bundle":
            way = (
                ", as Stable-Baselines3 saves a policy: pickles, which are not read; name a function that loads it, "
                "package.module:factory, or train with `creative-nao agent train`"
            )
        raise FileFormatError(f"{path}: no {kind} file: it is a ZIP archive{way}")
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
    entries = {}
    for name, values in table.items():
        where = f"{path}: the array `{name[:60]}`"
        entries[name] = parse(_Entry, values, where)
        if (end := entries[name].data_offsets[1]) > available:
            raise FileFormatError(f"{where} is torn: it ends at byte {end} of the data, {available} are there")
    return metadata, entries


def take(
    path: str | os.PathLike[str],
    arrays: dict[str, np.ndarray],
    name: str,
    shape: tuple[int | None, ...],
    dtype: type[np.generic] | None = None,
    *,
    kinds: str = "f",
    least: float = -math.inf,
    most: float = math.inf,
) -> np.ndarray:
    """Return one array of a file after checking it; NaN and infinities are refused in any case.

    Args:
        path: The file, for messages.
        arrays: All of its arrays.
        name: Which one.
        shape: What it should be; None matches any size.
        dtype: Type of its values; None takes every type of `kinds`.
        kinds: NumPy's letters for the kinds of values it may hold: ``iu`` whole numbers, ``f`` floating ones.
        least: Smallest value it may hold.
        most: Largest value.

    Raises:
        FileFormatError: If it is missing or does not fit; the message names the file and the array.
    """
    if name not in arrays:
        raise FileFormatError(f"{path}: the array `{name}` is missing; the file has {', '.join(arrays)[:200]}")
    array, where = arrays[name], f"{path}: the array `{name}`"
    if array.ndim != len(shape) or any(e not in (None, n) for e, n in zip(shape, array.shape, strict=True)):
        expected = ", ".join("any" if e is None else str(e) for e in shape)
        raise FileFormatError(f"{where} should have shape ({expected}), but has {array.shape}")
    if dtype is not None and array.dtype != dtype:
        raise FileFormatError(f"{where} should hold {np.dtype(dtype)}, but holds {array.dtype}")
    if array.dtype.kind not in kinds:
        wanted = "floating numbers" if kinds == "f" else "whole numbers"
        raise FileFormatError(f"{where} should hold {wanted}, but holds {array.dtype}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise FileFormatError(f"{where} should hold finite numbers, but does not")
    if array.size and not (least <= float(array.min()) and float(array.max()) <= most):
        raise FileFormatError(
            f"{where} should hold numbers from {least:g} to {most:g}, but reaches from {array.min()} to {array.max()}"
        )
    return array


def only_arrays(where: object, arrays: Iterable[str], names: Iterable[str]) -> None:
    """Refuse a file whose arrays have other names than these, by a FileFormatError that says the first of them."""
    if surplus := sorted(set(arrays) - set(names)):
        raise FileFormatError(f"{where}: the array `{surplus[0][:60]}` belongs to no part of it")


MAX_UNPACKED_BYTES = 256_000_000  # most bytes that the arrays of one NPZ file may unpack to
MAX_MEMBERS = 256
_COMMENT = b"sha256="
"""Beginning of an archive's comment, which ends in the digits of the hash of everything before them."""
_MAX_ARRAY_HEADER = 10_000
_PLAIN_TYPE = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|U\d{1,9})", re.ASCII)
"""Names of the kinds of values that are read, as NumPy writes them; it knows many more."""
_BROKEN_ZIP = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, ValueError, KeyError, IndexError,
    TypeError, NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


def read_npz(path: Path, what: str, largest: int = MAX_UNPACKED_BYTES) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file.

    The table of contents is read first; what would unpack to more than `largest` bytes is refused before anything is
    unpacked, and an array is only made when its member holds as many bytes as its shape asks for.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign, too large, or holds objects (a pickle); the message names the array.
    """
    content = read_bytes(path, what, largest)
    if content[-64 - len(_COMMENT) : -64] != _COMMENT:
        note_unsealed(f"{what} {path}")
    return unpack_npz(path, what, content, largest)


def unpack_npz(path: Path, what: str, content: bytes, largest: int = MAX_UNPACKED_BYTES) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file whose bytes are `content`; see `read_npz`."""
    where = f"{path}: not a {what}, or a torn one"
    try:
        if content.count(b"PK\1\2") > 2 * MAX_MEMBERS:  # before an object is made of each; data may hold some by chance
            raise FileFormatError(f"{path}: a {what} has at most {MAX_MEMBERS} arrays, but this file announces more")
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            unpacked = sum(member.file_size for member in members)
            if len(members) > MAX_MEMBERS or unpacked > largest:
                raise FileFormatError(
                    f"{path}: a {what} has at most {MAX_MEMBERS} arrays and {largest} bytes unpacked, but this file "
                    f"announces {len(members)} and {unpacked}"
                )
            names = [member.filename.removesuffix(".npy") for member in members]
            for name, member in zip(names, members, strict=True):
                # Nothing is ever unpacked to disk, but a name that is a path tells a foreign file.
                if name in ("", member.filename) or any(mark in name for mark in ("/", "\\", "\0", "..", ":")):
                    told = f"{member.filename[:60]!r}, expected arrays as plain names with `.npy`"
                    raise FileFormatError(f"{where}: the archive holds {told}")
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise FileFormatError(f"{where}: the array `{twice[0][:60]}` is in it twice")
            arrays = {
                name: _array(f"{where}: the array `{name[:60]}`", archive, member)
                for name, member in zip(names, members, strict=True)
            }
            uncommented = content[-22:-18] == b"PK\5\6" and content[-2:] == b"\0\0"
            if not uncommented and content[-64:] != hashlib.sha256(content[:-64]).hexdigest().encode():
                raise FileFormatError(f"{path}: damaged: its table of contents does not fit the SHA-256 in its comment")
            return arrays
    except FileFormatError:
        raise
    except _BROKEN_ZIP as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise FileFormatError(f"{where}: no readable NPZ file: {reason}") from error


def _array(where: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
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
        told, order, shape = header["descr"], header["fortran_order"], header["shape"]
        if not isinstance(told, str) or not _PLAIN_TYPE.fullmatch(told):
            held = "object" if isinstance(told, str) and told.lstrip("|=<>").startswith("O") else shown(told)
            raise FileFormatError(f"{where} holds {held}, expected numbers or text; objects are never unpickled")
        dtype = np.dtype(told)
        sound = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
    except FileFormatError:
        raise
    except (SyntaxError, ValueError, TypeError, KeyError, RecursionError, MemoryError) as error:
        raise FileFormatError(f"{where} has a broken header") from error
    data = content[start + length :]
    if not sound or len(data) != math.prod(shape) * dtype.itemsize:
        raise FileFormatError(f"{where} has {len(data)} bytes, which do not fit {dtype} of shape {str(shape)[:60]}")
    if not dtype.itemsize:
        raise FileFormatError(f"{where} holds texts of no length")
    flat = np.frombuffer(data, dtype=dtype).astype(dtype.newbyteorder("="))
    if dtype.kind == "U":  # Python falls over what is no character, and halves of pairs cannot be written
        codes = flat.view(np.uint32)
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes < 0xE000))).any():
            raise FileFormatError(f"{where} holds numbers that stand for no character")
    return flat.reshape(shape, order="F" if order else "C")


def save_npz(path: str | os.PathLike[str], header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Path:
    """Write arrays of numbers, and JSON as bytes in the array `header`, to an NPZ file in one step; return its path."""
    header_bytes = np.frombuffer(json.dumps(header, allow_nan=False).encode(), dtype=np.uint8)
    named: dict[str, Any] = {**arrays, "header": header_bytes}
    # In memory first: on a full disk, an archive that is being written complains once more when it is dropped.
    stream = io.BytesIO()
    np.savez_compressed(stream, **named)  # plain numbers only: nothing is pickled
    # The archive ends with the length of its comment, which is empty.
    content = stream.getvalue()[:-2] + (len(_COMMENT) + 64).to_bytes(2, "little") + _COMMENT
    return write_bytes(path, content + hashlib.sha256(content).hexdigest().encode())


def npz_header(path: Path, arrays: dict[str, np.ndarray], what: str) -> Any:
    """Return the JSON that stands as bytes in the array `header` of an NPZ file; FileFormatError if it does not."""
    found = arrays.get("header")
    if found is None or found.dtype != np.uint8 or found.ndim != 1:
        raise FileFormatError(f"{path}: not a {what}, or a torn one: the array `header` is missing or holds no bytes")
    return as_json(as_text(found.tobytes(), f"{path}: `header`", "header"), f"{path}: `header`")
