"""What a run folder holds, read file by file: a torn file is an error; what tells the time is left out."""

import csv
import json
import re
from pathlib import Path

import numpy as np
from PIL import Image
from safetensors.numpy import load

TIMELESS = ("created", "seconds", "wall_s", "cpu_s", "machine", "hashes", "Updated", "sha256", "arrays_sha256")
"""Fields of JSON that tell when, how fast and on what something was made; hashes are of what holds them."""


def remains(folder):
    """Return the names of all temporary files in a folder."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob(".*"))


def contents(folder):
    """Return the content of every finished file of a run folder by its name, such that equal results are equal.

    Raises an error of whatever kind if a file is torn. Logs, checkpoints on the way and progress are not results.
    """
    return {
        path.relative_to(folder).as_posix(): READERS[path.suffix](path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".") and path.suffix not in (".log", ".progress")
    }


def timeless(value):
    """Return JSON without the fields that tell the time, and without the places where the run folder stood."""
    if isinstance(value, str):
        return re.sub(r"(?:/[\w.-]+)+/out\b", "out", value)
    if isinstance(value, dict):
        return {key: timeless(part) for key, part in value.items() if not key.startswith(TIMELESS)}
    return [timeless(part) for part in value] if isinstance(value, list) else value


def tensors(path):
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = timeless(json.loads(json.loads(content[8 : 8 + length])["__metadata__"]["creative_nao"]))
    if header["kind"] == "agent checkpoint":
        header["state"]["episodes"] = [one[:2] for one in header["state"]["episodes"]]  # the third is the time of day
    return header, {name: array.tobytes() for name, array in load(content).items()}


def npz(path):
    with np.load(path, allow_pickle=False) as arrays:
        found = {name: arrays[name].tobytes() for name in arrays.files}
    return timeless(json.loads(found.pop("header"))), found


def table(path):
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert rows
    assert all(None not in row and None not in row.values() for row in rows), f"{path} is torn"
    return [{key: value for key, value in row.items() if not key.startswith("time/")} for row in rows]


def picture(path):
    with Image.open(path) as image:
        return image.convert("RGBA").tobytes()


def document(end):
    def read(path):
        text = Path(path).read_text(encoding="utf-8")
        assert text.rstrip().endswith(end), f"{path} is torn"
        return end  # reports tell when they were made and how long it took

    return read


# The last column of the table is the time.
READERS = {
    ".safetensors": tensors,
    ".checkpoint": tensors,
    ".npz": npz,
    ".csv": table,
    ".png": picture,
    ".json": lambda path: timeless(json.loads(path.read_text(encoding="utf-8"))),
    ".md": lambda path: [line.rsplit("|", 2)[0] for line in path.read_text(encoding="utf-8").splitlines()],
    ".html": document("</html>"),
    ".svg": document("</svg>"),
}
