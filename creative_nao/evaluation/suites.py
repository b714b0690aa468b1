"""Suites: what is compared, as data. A TOML file each, here or of your own.

`Suite` and `Taught` say what a suite holds; `read_suite` reads a file, `suite_from_values` a record. `SUITES` are the
shipped ones by name; `find_suite` takes a shipped name or a path.

Also here:
- What a suite is: which agents search which memories in which environments, how often and at which budget.
- Suites from TOML files and from records: every key checked, with the nearest name when one is unknown.
"""

from __future__ import annotations

import dataclasses
import math
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao.agents.ppo import PPOSettings, settings_from
from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.evaluation.resolve_agents import check_entrant
from creative_nao.fields import is_plain_name, shown
from creative_nao.model import SPLITS, split_memories
from creative_nao.model.memory import shipped_memories
from creative_nao.storage import read_text

SUFFIX = ".toml"
FOLDER = Path(__file__).parent / "suite_files"
"""Where the shipped suites are."""

SUITE_NAMES: tuple[str, ...] = tuple(
    sorted((path.stem for path in FOLDER.glob(f"*{SUFFIX}")), key=lambda name: (name != "quick", name))
)
"""Names of the shipped suites, `quick` first."""


def find_suite(name: str, *, trusted: bool = False) -> Suite:
    """Return the shipped suite called `name`, or the one in the TOML file at `name`.

    Args:
        name: Name or file.
        trusted: Whether modules that a file names are imported.

    Raises:
        NotFoundError: If there is none; the message offers the nearest name.
        FileFormatError: If a file is no TOML.
        SettingsError: If a file's content is no suite; the message names the key.
    """
    if name in SUITE_NAMES:
        return read_suite(FOLDER / f"{name}{SUFFIX}")
    if name.endswith(SUFFIX):
        return read_suite(Path(name), trusted=trusted)
    raise NotFoundError(
        f"no suite `{name}`{nearest_name(name, SUITE_NAMES)}; there are: {', '.join(SUITE_NAMES)}, "
        f"or a file of your own ending in {SUFFIX}"
    )


def shipped_suites() -> dict[str, Suite]:
    """Return all shipped suites by name."""
    return {name: find_suite(name) for name in SUITE_NAMES}


__all__ = [
    "SUFFIX",
    "SUITE_NAMES",
    "Suite",
    "Taught",
    "find_suite",
    "read_suite",
    "refuse_modules",
    "shipped_suites",
    "suite_from_values",
]


COUNTS = {
    "n_seeds": 10_000,
    "n_actions": 10_000,
    "resolution": 4_000,
    "seeds_per_job": 10_000,
    "memories_per_job": 1_000,
}
"""Largest value of each count."""
MAX_EPISODES = 1_000_000
"""Of a suite: about a year of a core."""
MAX_EPOCHS = 10_000_000
LISTS = ("agents", "envs", "memories")


@dataclass(frozen=True)
class Taught:
    """Memories that are trained in the run folder first, on demonstrations other than the shipped ones.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    seeds: tuple[int, ...]
    """Seed of the initial weights of each memory; the suite lists it as `taught/SEED`."""
    demonstrations: str | None = None
    """Folder of CSV recordings, a basic action each; None teaches the six boxing actions anew, by another hand."""
    teaching_seed: int = 1
    """Seed of everything in which that hand differs; not used with a folder."""
    closed_loop_ratio: float = 0.5
    """Share of its own prediction in the network's input while it is trained."""
    n_epochs: int = 20_000
    """Passes over all actions; the epoch with the lowest loss is kept."""

    def __post_init__(self) -> None:
        if not self.seeds or min(self.seeds) < 0:
            raise SettingsError(
                f"`taught.seeds` should list at least one seed, none below 0, but is {list(self.seeds)}"
            )
        if not 0.0 <= self.closed_loop_ratio <= 1.0:
            raise SettingsError(
                f"`taught.closed_loop_ratio` should be between 0 and 1, but is {self.closed_loop_ratio}"
            )
        if self.n_epochs > MAX_EPOCHS or max(*self.seeds, self.teaching_seed) >= 2**63:
            field, most = ("n_epochs", MAX_EPOCHS) if self.n_epochs > MAX_EPOCHS else ("seeds", 2**63 - 1)
            raise SettingsError(f"`taught.{field}` should be at most {most}, but is {shown(getattr(self, field))}")
        if self.n_epochs < 1 or self.teaching_seed < 0:
            field, least = ("n_epochs", 1) if self.n_epochs < 1 else ("teaching_seed", 0)
            raise SettingsError(f"`taught.{field}` should be at least {least}, but is {getattr(self, field)}")

    @property
    def names(self) -> tuple[str, ...]:
        """How the suite's rows call these memories."""
        return tuple(f"taught/{seed}" for seed in self.seeds)


@dataclass(frozen=True)
class Suite:
    """One comparison of agents.

    Raises:
        SettingsError: If a list is empty or names something twice, or a count is below 1; the message names the field.
    """

    name: str
    agents: tuple[str, ...]
    """Names of agents, shipped bundles such as `ppo/BoxingMental-v0`, or bundle files."""
    envs: tuple[str, ...]
    memories: tuple[str, ...]
    """Shipped names, memory files, or the names of `taught` memories."""
    n_seeds: int
    """Repetitions of everything; agents that are trained here are trained anew for each."""
    n_actions: int
    """Budget of an episode, in generated actions."""
    training_env: str
    """Where agents are trained that come in no bundle, on the memory on which they are judged."""
    ppo: PPOSettings
    oracle_envs: tuple[str, ...]
    """Environments in which the greedy oracle over the whole map is exact: they score the generated trajectory."""
    resolution: int = 200
    """Points along each axis of the map that the oracle searches."""
    seeds_per_job: int = 4
    """Seeds that one process judges: starting it costs as much as an episode."""
    memories_per_job: int = 1
    """Memories on which one process judges."""
    seconds_per_action: tuple[tuple[str, float], ...] = ()
    """Expected cost of an action in an environment, for the time left alone."""
    baseline: str = "supervised"
    """The agent that all others are compared with; no comparison is made where it does not take part."""
    about: str = ""
    """What the suite asks, in a sentence or two, for the report."""
    taught: Taught | None = None
    """Memories to be trained in the run folder first."""

    def __post_init__(self) -> None:
        if not is_plain_name(self.name):
            raise SettingsError(f"suite {shown(self.name)}: `name` should be a plain name, as of a file")
        for field, most in COUNTS.items():
            count = getattr(self, field)
            if count < 1:
                raise SettingsError(f"suite `{self.name}`: `{field}` should be at least 1, but is {count}")
            if count > most:
                raise SettingsError(f"suite `{self.name}`: `{field}` should be at most {most}, but is {shown(count)}")
        for field in LISTS:
            values = getattr(self, field)
            if not values:
                raise SettingsError(f"suite `{self.name}`: `{field}` should name at least one, but is empty")
            if twice := sorted({value for value in values if values.count(value) > 1}):
                raise SettingsError(f"suite `{self.name}`: `{field}` should name each once, but has `{twice[0]}` twice")

        n_episodes = self.n_seeds * math.prod(len(getattr(self, field)) for field in LISTS)
        if n_episodes > MAX_EPISODES:
            raise SettingsError(
                f"suite `{self.name}`: its agents, envs, memories and seeds should make at most {MAX_EPISODES} "
                f"episodes, but make {n_episodes}"
            )

    def taught_seed(self, memory: str) -> int | None:
        """Return the seed of a memory that is trained in the run folder, or None for any other memory."""
        if self.taught is None or memory not in self.taught.names:
            return None
        return self.taught.seeds[self.taught.names.index(memory)]


MENTAL = "CreativeNao/BoxingMental-v0"
MAX_FILE_BYTES = 200_000

WORDS = {"str": "text in quotes", "int": "a whole number", "float": "a number", "list": "a list"}


def read_suite(path: Path, *, trusted: bool = False) -> Suite:
    """Read a suite from a TOML file.

    Args:
        path: The file.
        trusted: Whether agents and environments that are named with a module, which would be imported, are taken.

    Raises:
        NotFoundError: If there is no such file, or it names an agent, environment or memory that does not exist.
        FileFormatError: If it is no TOML.
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
    """
    try:
        values = tomllib.loads(read_text(path, "suite", MAX_FILE_BYTES))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FileFormatError):
            raise
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise FileFormatError(f"suite {path}: not TOML ({reason})") from error
    try:
        suite = suite_from_values({"name": path.stem, **values}, where=f"suite {path}")
        if not trusted:
            refuse_modules(suite, f"suite {path}")
        _check_names(suite, f"suite {path}")
    except (SettingsError, NotFoundError) as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"suite {path}: {error}") from error
    return suite


def suite_from_values(values: Mapping[str, Any], *, where: str) -> Suite:
    """Make a suite out of plain values, as TOML or a record holds them.

    Args:
        values: Keys are the fields of `Suite`; lists stand for tuples. `training_env`, `oracle_envs`, `ppo` and
            `memories` (with `taught`) may be left out.
        where: Beginning of error messages.

    Raises:
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
    """
    values = dict(values)
    known = {field.name: str(field.type) for field in dataclasses.fields(Suite)}
    _check_keys(values, known, where)
    for name in ("agents", "envs", "memories", "oracle_envs"):
        if name in values:
            values[name] = _typed(values[name], known[name], f"{where}: `{name}`")
    if isinstance(per_action := values.get("seconds_per_action"), Mapping):
        values["seconds_per_action"] = [[env, cost] for env, cost in per_action.items()]
    taught = _taught(values.get("taught"), where)
    memories = [*values.get("memories", ()), *(taught.names if taught is not None else ())]
    chosen: dict[str, Any] = {
        "training_env": MENTAL,
        "oracle_envs": [env for env in values.get("envs", ()) if env == MENTAL],
        "n_seeds": 10,
        "n_actions": 30,
        **values,
        "memories": list(dict.fromkeys(memories)),
        "taught": taught,
    }
    for name in ("agents", "envs"):
        if name not in chosen:
            raise SettingsError(f"{where}: `{name}` is missing; it should be a list of names")
    for name, value in chosen.items():
        if name not in ("taught", "ppo", "seconds_per_action"):
            chosen[name] = _typed(value, known[name], f"{where}: `{name}`")
    chosen["memories"] = tuple(
        name for part in chosen["memories"] for name in (split_memories(part) if part in SPLITS else (part,))
    )
    chosen["ppo"] = settings_from(values.get("ppo", {}))
    chosen["seconds_per_action"] = _costs(values.get("seconds_per_action", ()), where)
    return Suite(**chosen)


def _taught(values: Any, where: str) -> Taught | None:
    if values is None:
        return None
    if not isinstance(values, Mapping):
        raise SettingsError(f"{where}: `taught` should be a table of settings, but is {shown(values)}")
    known = {field.name: str(field.type) for field in dataclasses.fields(Taught)}
    _check_keys(values, known, f"{where}, [taught]")
    if "seeds" not in values:
        raise SettingsError(f"{where}, [taught]: `seeds` is missing; it should be a list of seeds, one per memory")
    typed = {name: _typed(value, known[name], f"{where}, [taught]: `{name}`") for name, value in values.items()}
    return Taught(**typed)


def _check_keys(values: Mapping[str, Any], known: Mapping[str, str], where: str) -> None:
    for name in values:
        if name not in known:
            raise SettingsError(f"{where}: no key `{name}`{nearest_name(name, known)}; there are: {', '.join(known)}")


def _typed(value: Any, annotation: str, where: str) -> Any:
    """Return `value` as the annotation wants it, or say what it should be."""
    if value is None and "None" in annotation:
        return None
    wanted = annotation.split("[")[0].split(" ")[0]
    if wanted == "tuple":
        inner = annotation.split("[")[1].split(",")[0]
        if not isinstance(value, list | tuple):
            raise SettingsError(f"{where} should be {WORDS['list']}, but is {shown(value)}")
        return tuple(_typed(part, inner, f"{where}, entry {place}") for place, part in enumerate(value, 1))
    right = {"str": str, "int": int, "float": (int, float)}[wanted]
    if not isinstance(value, right) or isinstance(value, bool) or value != value or value in (math.inf, -math.inf):
        raise SettingsError(f"{where} should be {WORDS[wanted]}, but is {shown(value)}")
    return value


def refuse_modules(suite: Suite, where: str) -> None:
    """Refuse agents and environments that are named with a module: what stands in a file is not imported unasked.

    Raises:
        SettingsError: Naming the first of them, and how to ask.
    """
    for name in (*suite.agents, *suite.envs, suite.training_env, *suite.oracle_envs):
        if ":" in name and not os.path.isfile(name):
            raise SettingsError(
                f"{where}: `{name}` is a module that would be imported and run; if you trust the file, add --trust"
            )


def _costs(values: Any, where: str) -> tuple[tuple[str, float], ...]:
    pairs = values if isinstance(values, list | tuple) else [values]
    for pair in pairs:
        if not isinstance(pair, list | tuple) or len(pair) != 2 or not isinstance(pair[0], str):
            raise SettingsError(f"{where}: `seconds_per_action` should map environments to seconds: {shown(pair)}")
    return tuple((env, float(_typed(cost, "float", f"{where}: `seconds_per_action` of {env}"))) for env, cost in pairs)


def _check_names(suite: Suite, where: str) -> None:
    """Check that everything a suite names exists, before anything is started."""
    for agent in suite.agents:
        check_entrant(agent)
    for env in (*suite.envs, suite.training_env, *suite.oracle_envs):
        if env not in ENVIRONMENTS and ":" not in env:  # `module:name` registers its own
            raise NotFoundError(
                f"{where}: no environment `{env}`{nearest_name(env, ENVIRONMENTS)}; there are {', '.join(ENVIRONMENTS)}"
            )
    for memory in suite.memories:
        if suite.taught_seed(memory) is None and memory not in shipped_memories() and not os.path.isfile(memory):
            names = (*shipped_memories(), *SPLITS)
            raise NotFoundError(
                f"{where}: no memory `{memory}`{nearest_name(memory, names)}: neither a file, a shipped name, nor a "
                f"part of the bank ({', '.join(SPLITS)})"
            )
