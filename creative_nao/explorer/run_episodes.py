"""The episodes in a run folder of `creative-nao evaluate`, to be played again before the eyes of the page."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterator
from pathlib import Path

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


@dataclasses.dataclass(frozen=True)
class Try:
    """One movement of an episode.

    Attributes:
        pb: The PB vector, in [-1, 1].
        reward: What it earned.
        outcome: One of `measures.outcome.ALL_OUTCOMES`.
        imagined: How many movements were imagined before it.
        distance: To the nearest basic action (DTW) [rad], where it was scored as generated; else NaN.
    """

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
        SettingsError: If one PB vector makes no movement in any of its environments.
    """

    def __init__(self, folder: Path) -> None:
        self.path, self.name = folder / TABLE, folder.resolve().name
        if not self.path.is_file():
            raise NotFoundError(f"no {self.path}; --run takes a folder that `creative-nao evaluate` wrote")
        text = read_text(self.path, "table of episodes")
        _check_sum(self.path)
        found: dict[tuple[str, str, str], dict[int, list[Try]]] = {}
        left_out = set()
        for where, row in _rows(self.path, text):
            if not row["env"].startswith(ENVIRONMENTS):
                left_out.add(row["env"])
                continue
            seeds = found.setdefault((row["memory"], row["agent"], row["env"]), {})
            tries = seeds.setdefault(_whole(row["seed"], f"{where}: seed"), [])
            if _whole(row["step"], f"{where}: step") != len(tries) + 1:
                raise FileFormatError(
                    f"{where}: step should be {len(tries) + 1}, the next of its episode, but is {row['step']}"
                )
            tries.append(_try(row, where))
        if left_out and not found:
            raise SettingsError(
                f"{self.path}: in {', '.join(sorted(left_out))} a movement takes several decisions, or the environment "
                "is not known here; the explorer plays episodes of Boxing, BoxingMental and BoxingRehearsal"
            )
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
            if not names:
                raise SettingsError(f"{self.path} holds no episode")
            others = f" and {len(names) - 6} others" if len(names) > 6 else ""
            own = self.path.parent / "memories" / f"{names[0].replace('/', '-')}.safetensors"
            raise SettingsError(
                f"{self.path} has no episodes in {memory.name}, but in {', '.join(names[:6])}{others}; begin with "
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
            raise FileFormatError(
                f"{path}: line {number}: expected at most {MAX_LINES} lines of {MAX_LINE} characters, but it is line "
                f"{number} of {len(line)} characters"
            )
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
            if row.get(None) or None in [row[name] for name in COLUMNS]:
                raise FileFormatError(f"{where}: should have {len(names)} cells, one for each column")
            yield where, row
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {reader.line_num}: not a line of CSV ({error})") from None


def _try(row: dict[str, str], where: str) -> Try:
    pb = [_number(row[name], f"{where}: {name}") for name in ("pb_1", "pb_2")]
    if row["outcome"] not in ALL_OUTCOMES:
        raise FileFormatError(
            f"{where}: outcome should be one of {', '.join(ALL_OUTCOMES)}, but is {shown(row['outcome'])}"
        )
    return Try(
        (min(1.0, max(-1.0, pb[0])), min(1.0, max(-1.0, pb[1]))),  # as the environment performed it
        _number(row["reward"], f"{where}: reward"),
        row["outcome"],
        _whole(row["n_imagined"], f"{where}: n_imagined") if row.get("n_imagined") else 0,
        _number(row["distance"], f"{where}: distance") if row.get("distance") and MENTAL in row["env"] else math.nan,
    )


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(f"{where} should be a number, but is {shown(cell)}")
    return value


def _whole(cell: str, where: str) -> int:
    if not (cell.isascii() and cell.isdecimal() and len(cell) < 10):
        raise FileFormatError(f"{where} should be a whole number, but is {shown(cell)}")
    return int(cell)


def _check_sum(path: Path) -> None:
    """Compare the table with the hash that `run.json` has of it."""
    from creative_nao.evaluation.run import RECORD, read_record

    told = read_record(path.parent).get("hashes") if (path.parent / RECORD).is_file() else None
    if not isinstance(told, dict) or path.name not in told:
        note_unsealed(f"table of episodes {path}")
    elif told[path.name] != sha256(path):
        raise FileFormatError(f"{path}: damaged, or changed by hand: it does not fit its SHA-256 in {RECORD}")
