"""Broken copies of a file: bytes changed anywhere, and parts changed inside a frame that stays whole.

A blind change of a packed or framed file is found out by its frame at once; to reach what is read afterwards,
safetensors and NPZ files are taken apart, changed and put together again.
"""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

TREES = (
    None, True, False, 0, 1, -1, 2, 3, 255, 2**31, 2**63, -(2**63), 10**30, 10**60, 0.5, -0.0, 1e-320, 1e38, 3.5e38,
    1e300, -1e308, 1.5, "", "0", "1", "nan", "\u00e4", "a/../b", "../x", "x" * 300, "a\nb", "\x1b[2J", "\ud800", [], {},
    [1], [[1]], {"a": 1}, ["a", "a"], "os:getcwd", "__import__('os')", [None], [True], [0] * 3, "float32", "object",
)  # fmt: skip
TOKENS = (
    b"0", b"-1", b"1e999", b"nan", b"inf", b"-inf", b"1e-320", b"9" * 50, b"1e308", b"0,5", b";", b",", b"\t", b"\n",
    b"\r\n", b"\r", b"\0", b"\xff", b"\xef\xbb\xbf", b'"', b"'", b"[", b"]", b"{", b"}", b":", b"#", b"!!python/tuple",
    b"&a", b"*a", b"<<", b"true", b"null", b"()", b"__import__('os').getcwd()", b"os:getcwd", b"-", b".", b"[" * 200,
    b"\xe2\x80\xa8", b"\x1b[2J", b"1_000", b"0x10", b"1970-01-01",
)  # fmt: skip
NUMBERS = np.array([0.0, -1.0, 1.0, np.nan, np.inf, -np.inf, 1e-320, 1e38, 3.4e38, 1e300, -1e300, 255.0, 1e7])
DTYPES = ("F64", "F32", "F16", "I64", "I32", "I16", "I8", "U8", "U16", "U64", "BOOL", "BF16", "C64", "F8_E4M3")


def mutate(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Return a broken copy of a file.

    Args:
        content: The file.
        others: Other files, of which pieces may be taken.
        rng: Decides everything.
    """
    for _ in range(int(rng.geometric(0.6))):
        change = _inner(content) if rng.random() < 0.75 else None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                content = (change or _bytes)(content, others, rng)
        except Exception:
            content = _bytes(content, others, rng)  # it was broken before, so it cannot be taken apart
        content = content[:200_000]
    return content


def _inner(content: bytes) -> Callable[[bytes, list[bytes], np.random.Generator], bytes]:
    if content.startswith(b"PK"):
        return _archive
    if content[:1] in (b"{", b"["):
        return _json
    if len(content) > 9 and content[8:9] == b"{":
        return _tensors
    return _tokens


def _bytes(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    start, end = sorted(rng.integers(0, len(content) + 1, 2).tolist())
    end = min(end, start + 40)
    kind = rng.integers(8)
    if kind == 0 and content:
        broken = bytearray(content)
        broken[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        return bytes(broken)
    if kind == 1:
        return content[:start]
    if kind == 2:
        return content[:start] + content[end:]
    if kind == 3:
        return content[:end] + content[start:end] * int(rng.integers(1, 50)) + content[end:]
    if kind == 4:
        return content[:start] + rng.bytes(int(rng.integers(1, 9))) + content[end:]
    if kind == 5:
        other = others[int(rng.integers(len(others)))]
        place = int(rng.integers(len(other) + 1))
        return content[:start] + other[place : place + int(rng.integers(1, 200))] + content[end:]
    if kind == 6 and len(content) >= 8:
        place, width = int(rng.integers(len(content) - 7)), int(rng.choice([1, 2, 4, 8]))
        number = int(rng.choice([0, 1, 127, 255, 2**15, 2**31 - 1, 2**32 - 1, 2**62])) % 256**width
        return content[:place] + number.to_bytes(width, "little") + content[place + width :]
    return content[:start] + TOKENS[int(rng.integers(len(TOKENS)))] + content[start:]


def _tokens(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Replace, insert, remove, double or swap a word or a line of text."""
    separator = rng.choice(np.array([b"\n", b",", b" ", b":"], dtype=object))
    words = content.split(separator)
    place, other = int(rng.integers(len(words))), int(rng.integers(len(words)))
    kind = rng.integers(5)
    if kind == 0:
        words[place] = TOKENS[int(rng.integers(len(TOKENS)))]
    elif kind == 1:
        words.insert(place, TOKENS[int(rng.integers(len(TOKENS)))])
    elif kind == 2:
        del words[place]
    elif kind == 3:
        words[place:place] = [words[other]] * int(rng.integers(1, 200))
    else:
        words[place], words[other] = words[other], words[place]
    return separator.join(words)


def change_tree(tree: Any, rng: np.random.Generator) -> Any:
    """Return plain values with one part replaced, removed, doubled or added."""
    tree = json.loads(json.dumps(tree))
    inner = [one for one in _containers(tree) if one]
    if not inner or rng.random() < 0.02:
        return TREES[int(rng.integers(len(TREES)))]
    holder = inner[int(rng.integers(len(inner)))]
    keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
    key, new = keys[int(rng.integers(len(keys)))], TREES[int(rng.integers(len(TREES)))]
    kind = rng.integers(8)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder["more"] = new
    elif kind == 1:
        holder.insert(key, new)
    elif kind == 2 and isinstance(holder, list):
        holder += [holder[key]] * int(rng.integers(1, 100))
    elif kind == 3:
        others = _containers(tree)
        holder[key] = json.loads(json.dumps(others[int(rng.integers(len(others)))]))
    elif kind == 4 and isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
        holder[key] = [-holder[key], holder[key] + 1, holder[key] * 1e6, float(holder[key])][int(rng.integers(4))]
    else:
        holder[key] = new
    return tree


def _containers(tree: Any) -> list[Any]:
    found, waiting = [], [tree]
    while waiting:
        one = waiting.pop()
        if isinstance(one, list | dict):
            found.append(one)
            waiting += one.values() if isinstance(one, dict) else one
    return found


def _json(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    tree = json.loads(content)
    if isinstance(tree, dict):
        tree.pop("sha256", None)
    text = json.dumps(change_tree(tree, rng)).encode()
    if rng.random() < 0.1:  # what `json.dumps` would not write: a name twice, NaN, depth
        text = text.replace(b'":', rng.choice(np.array([b'": NaN, "":', b'": 1, "a": 2, "a":', b'": [[', b'":'])), 1)
    return text


def _tensors(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    length = int.from_bytes(content[:8], "little")
    table, data = json.loads(content[8 : 8 + length]), bytearray(content[8 + length :])
    told = json.loads(table["__metadata__"]["creative_nao"])
    for digest in ("sha256", "arrays_sha256"):  # whoever breaks a file on purpose takes them out
        told.pop(digest, None)
    table["__metadata__"]["creative_nao"] = json.dumps(told)
    names = [name for name in table if name != "__metadata__"]
    kind = rng.integers(6)
    if kind <= 1 or not names:
        table["__metadata__"]["creative_nao"] = json.dumps(change_tree(told, rng))
    elif kind == 2:
        entry = table[names[int(rng.integers(len(names)))]]
        entry["dtype"] = DTYPES[int(rng.integers(len(DTYPES)))]
        if rng.random() < 0.7:  # as many bytes as before
            size, width = entry["data_offsets"][1] - entry["data_offsets"][0], _width(entry["dtype"])
            entry["shape"] = [size // width] if rng.random() < 0.5 else [1, size // width]
    elif kind == 3:
        start, end = table[names[int(rng.integers(len(names)))]]["data_offsets"]
        wide = rng.random() < 0.5
        number = NUMBERS[int(rng.integers(len(NUMBERS)))]
        with np.errstate(all="ignore"):
            packed = number.tobytes() if wide else number.astype(np.float32).tobytes()
        count = (end - start) // len(packed)
        first = int(rng.integers(max(count, 1)))
        last = count if rng.random() < 0.3 else first + 1
        data[start + first * len(packed) : start + last * len(packed)] = packed * max(last - first, 0)
    elif kind == 4:
        name = names[int(rng.integers(len(names)))]
        table[f"{name}x" if rng.random() < 0.5 else names[int(rng.integers(len(names)))]] = table.pop(name)
    else:
        table = change_tree(table, rng)
    header = json.dumps(table).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + bytes(data)


def _width(dtype: str) -> int:
    return {"F64": 8, "I64": 8, "U64": 8, "C64": 8, "F32": 4, "I32": 4, "F16": 2, "I16": 2, "U16": 2, "BF16": 2}.get(
        dtype, 1
    )


def _archive(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(member.filename, archive.read(member)[:100_000]) for member in archive.infolist()]
    place = int(rng.integers(len(members)))
    name, inside = members[place]
    kind = rng.integers(6)
    if kind == 0:
        members[place] = (name, _bytes(inside, others, rng))
    elif kind == 1:
        del members[place]
    elif kind == 2:
        members.append((f"more{name}" if rng.random() < 0.5 else name, inside))
    else:
        members[place] = (name, _array(inside, rng))
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for name, inside in members:
            archive.writestr(zipfile.ZipInfo(name), inside)
    return written.getvalue()


def _array(inside: bytes, rng: np.random.Generator) -> bytes:
    array = np.load(io.BytesIO(inside), allow_pickle=False)
    if array.dtype == np.uint8 and array.size > 2 and bytes(array[:1]) == b"{":
        told = change_tree(json.loads(array.tobytes()), rng)
        array = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    else:
        kind = rng.integers(5)
        with np.errstate(all="ignore"):
            if kind == 0:
                array = array.astype(rng.choice(["f8", "f4", "f2", ">f8", "i1", "u8", "i8", "bool", "U5", "c16", "g"]))
            elif kind == 1:
                array = array.reshape(rng.choice(np.array([(-1,), (1, -1), (-1, 1), (-1, 2)], dtype=object)))
            elif kind == 2:
                array = np.concatenate([np.atleast_1d(array)] * 2)[: int(rng.integers(10))]
            elif array.size and array.dtype.kind in "fiu":
                array = np.array(array)
                number = NUMBERS[int(rng.integers(len(NUMBERS)))]
                array.flat[int(rng.integers(array.size))] = (
                    number if array.dtype.kind == "f" else int(rng.choice([0, 1, 99]))
                )
    written = io.BytesIO()
    np.lib.format.write_array(written, array, allow_pickle=False)
    return written.getvalue()
