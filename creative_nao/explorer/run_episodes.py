"""The episodes in a run folder of `creative-nao evaluate`, to be played again before the eyes of the page."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, shown
from creative_nao.measures import score
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.model import Memory
from creative_nao.runtime import sha256
from creative_nao.storage import note_unsealed, read_text

TABLE = "episodes.csv"
COLUMNS = ("agent", "env", "memory", "seed", "step", "pb_1", "pb_2", "outcome", "reward")
MAX_LINES, MAX_LINE = 200_000, 10_000
"""Lines of a table, and characters of a line."""
ENVIRONMENTS = tuple(f"CreativeNao/{name}-v" for name in ("Boxing", "BoxingMental", "BoxingRehearsal"))
"""How the names of those begin in which one PB vector makes a movement."""
MENTAL = ENVIRONMENTS[1]
MAX_DEVIATION = 0.01
"""Of recorded distances from the memory's own, relative: processors round differently, other memories differ more."""


class Try(NamedTuple):
    """One movement of an episode, its `distance` to the nearest basic action [rad] where it was scored as generated."""

    pb: tuple[float, float]
    reward: float
    outcome: str
    imagined: int = 0
    distance: float = math.nan


class RunEpisodes:
    """The episodes of a run folder by memory, agent and seed.

    Raises:
        NotFoundError: If the folder holds no table of episodes.
        FileFormatError: If it is damaged or foreign; the message names the line.
        SettingsError: If it holds no episode in which one PB vector makes a movement.
    """

    def __init__(self, folder: Path) -> None:
        self.path, self.name = folder / TABLE, folder.resolve().name
        if not self.path.is_file():
            raise NotFoundError(f"no {self.path}; --run takes a folder that `creative-nao evaluate` wrote")
        text = read_text(self.path, "table of episodes")
        _check_sum(self.path)
        found: dict[tuple[str, str, str], dict[int, list[Try]]] = {}
        for where, row in _rows(self.path, text):
            if not row["env"].startswith(ENVIRONMENTS):
                continue
            seeds = found.setdefault((row["memory"], row["agent"], row["env"]), {})
            tries = seeds.setdefault(int(_number(row, "seed", where)), [])
            if _number(row, "step", where) != len(tries) + 1:
                raise FileFormatError(
                    f"{where}: step should be {len(tries) + 1}, the next of its episode, but is {shown(row['step'])}"
                )
            tries.append(_try(row, where))
        if not found:
            raise SettingsError(f"{self.path} has no episode of Boxing, BoxingMental or BoxingRehearsal to be played")
        several = len({env for *_, env in found}) > 1
        self._episodes: dict[str, dict[str, list[list[Try]]]] = {}
        for (memory, agent, env), seeds in found.items():
            title = f"{agent} in {env.removeprefix('CreativeNao/')}" if several else agent
            self._episodes.setdefault(memory, {})[title] = [seeds[seed] for seed in sorted(seeds)]

    def of(self, memory: str) -> dict[str, list[list[Try]]]:
        """Return the episodes in a memory by agent, one for each seed; the memory's name or its file in the folder."""
        same = [name for name in self._episodes if memory == name or Path(memory).stem == name.replace("/", "-")]
        return self._episodes[same[0]] if same else {}

    def check_name(self, memory: Memory) -> None:
        """Make sure that there are episodes in a memory of this name, SettingsError otherwise."""
        if not self.of(memory.name):
            names = list(self._episodes)
            own = self.path.parent / "memories" / f"{names[0].replace('/', '-')}.safetensors"
            raise SettingsError(
                f"{self.path} has no episodes in {memory.name}, but in {', '.join(names)[:200]}; begin with "
                f"`creative-nao explore {own if own.is_file() else names[0]} --run {self.path.parent}`"
            )

    def check(self, memory: Memory) -> None:
        """Make sure that the episodes were played in this memory; SettingsError if in another of its name."""
        told = [one for seeds in self.of(memory.name).values() for one in seeds[0] if not math.isnan(one.distance)][:30]
        if not told:
            return
        own = score(memory.generate(np.array([one.pb for one in told])), memory.demonstrations).novelty
        recorded = np.array([one.distance for one in told])
        if np.median(np.abs(own - recorded) / np.maximum(recorded, 1e-6)) > MAX_DEVIATION:
            raise SettingsError(
                f"{self.path}: the episodes in {memory.name} were played in another memory of this name: its distances "
                f"are {recorded[0]:.3f}, ..., those of the memory here {own[0]:.3f}, ..."
            )


def _lines(path: Path, text: str) -> Iterator[str]:
    for number, line in enumerate(io.StringIO(text, newline=""), start=1):  # empty ones, which the reader skips, too
        if number > MAX_LINES or len(line) > MAX_LINE:
            raise FileFormatError(f"{path}: line {number}: expected at most {MAX_LINES} lines of {MAX_LINE} characters")
        yield line


def _rows(path: Path, text: str) -> Iterator[tuple[str, dict[str, str]]]:
    reader = csv.DictReader(_lines(path, text))
    try:
        names = list(reader.fieldnames or ())
        if any(names.count(name) != 1 for name in COLUMNS):
            raise FileFormatError(
                f"{path}: the first line should name the columns {', '.join(COLUMNS)} once, between commas, "
                f"but is {', '.join(names)[:200]}"
            )
        for row in reader:
            where = f"{path}: line {reader.line_num}"
            if row.get(None) or None in row.values():
                raise FileFormatError(f"{where}: should have {len(names)} cells, one for each column")
            yield where, row
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {reader.line_num}: not a line of CSV ({error})") from None


def _try(row: dict[str, str], where: str) -> Try:
    if row["outcome"] not in ALL_OUTCOMES:
        raise FileFormatError(
            f"{where}: outcome should be one of {', '.join(ALL_OUTCOMES)}, but is {row['outcome'][:40]}"
        )
    first, second = (min(1.0, max(-1.0, _number(row, name, where))) for name in ("pb_1", "pb_2"))  # as it was performed
    return Try(
        (first, second), _number(row, "reward", where), row["outcome"],
        int(_number(row, "n_imagined", where)) if "n_imagined" in row else 0,  # an older release did not tell
        _number(row, "distance", where) if "distance" in row and row["env"].startswith(MENTAL) else math.nan,
    )  # fmt: skip


def _number(row: dict[str, str], name: str, where: str) -> float:
    try:
        value = float(row[name])
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (value < 0 and name == "seed"):
        raise FileFormatError(f"{where}: {name} should be a number, but is {shown(row[name])}")
    return value


def _check_sum(path: Path) -> None:
    from creative_nao.evaluation.run import RECORD, read_record

    told = read_record(path.parent).get("hashes") if (path.parent / RECORD).is_file() else None
    if not isinstance(told, dict) or path.name not in told:
        note_unsealed(f"table of episodes {path}")
    elif told[path.name] != sha256(path):
        raise FileFormatError(f"{path}: damaged, or changed by hand: it does not fit its SHA-256 in {RECORD}")
