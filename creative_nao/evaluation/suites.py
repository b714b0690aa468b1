"""Suites: which agents search which memories in which environments, how often and at which budget. A TOML file each.

`SUITE_NAMES` are the shipped ones; `find_suite` takes a name or a path, `suite_from_values` reads a record. An agent
of a suite is an agent by name, one that the suite trains, a bundle trained before, or a factory of the user's:
`check_agent`, `resolve_agent`.
"""

from __future__ import annotations

import dataclasses
import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from creative_nao.agents.base import Agent
from creative_nao.agents.bundle import load_bundle, shipped_agents
from creative_nao.agents.registry import (
    NAMES,
    TRAINED,
    UNTRAINED,
    is_entry_point,
    load_entry_point,
    make_agent,
    split_name,
)
from creative_nao.agents.training import PPOSettings
from creative_nao.demonstrations import load_demonstrations
from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.model import SPLITS, split_memories
from creative_nao.model.controls import CONTROLS
from creative_nao.model.memory import shipped_memories
from creative_nao.schema import AfterValidator, Field, PlainName, Seed, UnitInterval, parse, record
from creative_nao.storage import read_text

SUFFIX = ".toml"
FOLDER = Path(__file__).parent / "suite_files"
"""Where the shipped suites are."""
SUITE_NAMES: tuple[str, ...] = tuple(
    sorted((path.stem for path in FOLDER.glob(f"*{SUFFIX}")), key=lambda name: (name != "quick", name))
)
"""Names of the shipped suites, `quick` first."""
MENTAL = "CreativeNao/BoxingMental-v0"
MAX_EPISODES = 1_000_000
"""Of a suite: about a year of a core."""
MAX_FILE_BYTES = 200_000
MAX_SHOWN = 3
"""Most memories that the report draws one by one."""
MAX_NAMES = 1_000
"""In each list of a suite."""
MAX_DOTS = 500
"""In a line of a suite: Python's reader of TOML keeps every beginning of a dotted name."""
PPO = "ppo"
"""The one agent that a suite trains itself, where it names it without a bundle."""


def slug(name: str) -> str:
    """Return a name as it may stand in a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name)


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"a list that has `{twice[:60]}` only once")
    return names


_Names = Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_NAMES), AfterValidator(_each_once)]
_Repeats = Annotated[int, Field(ge=1, le=10_000)]


@record
class TaughtSet:
    """Basic actions that a suite's memories are trained on."""

    name: PlainName
    demonstrations: str | None = None
    """Folder of recordings; None: the six shipped boxing actions."""
    actions: tuple[str, ...] = ()
    """Which of the folder's recordings; default: all."""


MemoryCondition = Literal["open", "half", "closed", "auto", "interpolation", "splines", "vae"]
BOXING = TaughtSet("boxing")


@record
class Taught:
    """Memories that are trained in the run folder first, on demonstrations other than the shipped ones."""

    seeds: Annotated[tuple[Seed, ...], Field(min_length=1, max_length=MAX_NAMES)]
    """Seed of the initial weights of each memory; the suite lists it as `taught/SEED`."""
    demonstrations: str | None = None
    """Folder of CSV recordings, a basic action each; None teaches the six boxing actions anew, by another hand."""
    teaching_seed: Seed = 1
    """Seed of everything in which that hand differs; not used with a folder."""
    closed_loop_ratio: UnitInterval = 0.5
    """Share of its own prediction in the network's input while it is trained."""
    n_epochs: Annotated[int, Field(ge=1, le=10_000_000)] = 20_000
    """Passes over all actions; the epoch with the lowest loss is kept."""

    conditions: Annotated[tuple[MemoryCondition, ...], AfterValidator(_each_once)] = ()
    """A memory of each for every seed and set, listed as `SET/CONDITION/SEED`; `closed_loop_ratio` is not used then.
    Controls (`model.controls`) take the PB points of the last network before them."""
    sets: tuple[TaughtSet, ...] = (BOXING,)
    """Only with `conditions`: what is taught."""
    set_size: Annotated[int, Field(ge=2, le=1_000)] = 6
    """A folder of more recordings is dealt out to as many disjoint sets of at least this size as it has recordings for.
    """

    def __post_init__(self) -> None:
        if self.conditions and self.conditions[0] in CONTROLS:
            raise SettingsError(f"`conditions` should begin with a network, but begins with {self.conditions[0]}")

    @property
    def names(self) -> tuple[str, ...]:
        """How the suite's rows call these memories."""
        if self.conditions:
            return tuple(f"{one.name}/{kind}/{s}" for one in self.sets for kind in self.conditions for s in self.seeds)
        return tuple(f"taught/{seed}" for seed in self.seeds)

    def last_network(self, control: str) -> str:
        """Return the condition of which a control takes the PB points."""
        before = self.conditions[: self.conditions.index(control)]
        return [kind for kind in before if kind not in CONTROLS][-1]

    def on(self, folders: Sequence[Path]) -> Taught:
        """Return the same with the recordings of these folders; with `conditions` they come beside the sets there are.

        Raises:
            SettingsError: If several folders are given where one is taught, or two sets have one name.
            CreativeNaoError: If a folder holds no recordings that can be read.
        """
        read = [(folder, load_demonstrations(folder)) for folder in folders]  # mistakes in them are told now
        if not self.conditions:
            if len(read) > 1:
                raise SettingsError("--demonstrations should name one folder for this suite; `gestures` takes several")
            return dataclasses.replace(self, demonstrations=str(folders[0]))
        added = []
        for folder, demonstrations in read:
            names, label = demonstrations.names, slug(folder.resolve().name)
            n_sets = max(1, len(names) // self.set_size)
            dealt = [(label if n_sets == 1 else f"{label}-{k + 1}", names[k::n_sets]) for k in range(n_sets)]
            added += [TaughtSet(name, str(folder), actions) for name, actions in dealt]
        sets = (*self.sets, *added)
        if len({one.name for one in sets}) < len(sets):
            raise SettingsError("--demonstrations should name folders of different names, and none called `boxing`")
        return dataclasses.replace(self, sets=sets)


@record
class Suite:
    """One comparison of agents."""

    name: PlainName
    agents: _Names
    """Names of agents, shipped bundles such as `ppo/BoxingMental-v0`, or bundle files."""
    envs: _Names
    memories: _Names
    """Shipped names, memory files, or the names of `taught` memories."""
    n_seeds: _Repeats
    """Repetitions of everything; agents that are trained here are trained anew for each."""
    n_actions: _Repeats
    """Budget of an episode, in performed movements."""
    training_env: str
    """Where agents are trained that come in no bundle, on the memory on which they are judged."""
    ppo: PPOSettings
    oracle_envs: tuple[str, ...]
    """Environments in which the greedy oracle over the whole map is exact: they score the generated trajectory."""
    resolution: Annotated[int, Field(ge=1, le=4_000)] = 200
    """Points along each axis of the map that the oracle searches."""
    seeds_per_job: _Repeats = 4
    """Seeds that one process judges: starting it costs as much as an episode."""
    memories_per_job: Annotated[int, Field(ge=1, le=1_000)] = 1
    """Memories on which one process judges."""
    seconds_per_action: tuple[tuple[str, float], ...] = ()
    """Expected cost of an action in an environment, for the time left alone."""
    baseline: str = "supervised"
    """The agent that all others are compared with; no comparison is made where it does not take part."""
    about: str = ""
    """What the suite asks, in a sentence or two, for the report."""
    taught: Taught | None = None
    """Memories to be trained in the run folder first."""
    charted: Literal["all", "shown"] = "all"
    """Of which memories the whole map is searched by the oracle: all, or only those that the report draws."""
    n_imagined: Annotated[tuple[Annotated[int, Field(ge=1, le=100_000)], ...], Field(max_length=100)] = ()
    """Movements that every agent looks at for each one performed: it takes part once with each, as `spread@8`. An agent
    named with its own number, as `bayesian@1`, takes part with that."""

    def __post_init__(self) -> None:
        n_episodes = self.n_seeds * math.prod(map(len, (self.agents, self.envs, self.memories)))
        if n_episodes > MAX_EPISODES:
            raise SettingsError(
                f"suite `{self.name}`: its agents, envs, memories and seeds should make at most {MAX_EPISODES} "
                f"episodes, but make {n_episodes}"
            )

    def taught_seed(self, memory: str) -> int | None:
        """Return the seed of a memory that is trained in the run folder, or None for any other memory."""
        known = self.taught is not None and memory in self.taught.names
        return int(memory.rpartition("/")[2]) if known else None

    @property
    def shown(self) -> tuple[str, ...]:
        """The memories that the report draws one by one: all of a few, else some spread over the list."""
        n_shown = min(MAX_SHOWN, len(self.memories))
        return tuple(self.memories[place * len(self.memories) // n_shown] for place in range(n_shown))


def find_suite(name: str, *, trusted: bool = False) -> Suite:
    """Return the shipped suite called `name`, or the one in the TOML file at `name`.

    Raises:
        NotFoundError: If there is none; the message offers the nearest name.
        CreativeNaoError: If the file is no suite, as `read_suite` tells.
    """
    if name in SUITE_NAMES:
        return read_suite(FOLDER / f"{name}{SUFFIX}")
    if name.endswith(SUFFIX):
        return read_suite(Path(name), trusted=trusted)
    raise NotFoundError(
        f"no suite `{name}`{nearest_name(name, SUITE_NAMES)}; there are: {', '.join(SUITE_NAMES)}, "
        f"or a file of your own ending in {SUFFIX}"
    )


def read_suite(path: Path, *, trusted: bool = False) -> Suite:
    """Read a suite from a TOML file; `trusted` takes agents and environments named with a module, and imports it.

    Raises:
        NotFoundError: If there is no such file, or it names an agent, environment or memory that does not exist.
        FileFormatError: If it is no TOML.
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
    """
    where = f"suite {path}"
    text = read_text(path, "suite", MAX_FILE_BYTES)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MAX_DOTS:
            raise FileFormatError(f"{where}: line {number}: has more than {MAX_DOTS} dots; break a list into lines")
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise FileFormatError(f"{where}: not TOML ({reason})") from error
    suite = suite_from_values({"name": path.stem, **values}, where=where)
    if not trusted:
        refuse_modules(suite, where)
    _check_names(suite, where)
    return suite


def suite_from_values(values: Mapping[str, Any], *, where: str, check_names: bool = False) -> Suite:
    """Make a suite out of plain values, as TOML or a record holds them.

    Args:
        values: Keys are the fields of `Suite`; lists stand for tuples. `training_env`, `oracle_envs`, `ppo` and
            `memories` (with `taught`) may be left out; a part of the bank, as `test`, stands for its memories, and
            `seconds_per_action` may be a table.
        where: Beginning of error messages.
        check_names: Whether everything that the suite names has to exist.

    Raises:
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
        NotFoundError: If a name is to be checked and does not exist.
    """
    chosen: dict[str, Any] = {"n_seeds": 10, "n_actions": 30, "training_env": MENTAL, "memories": (), "ppo": {}}
    chosen |= values
    # What has another type is left as it is: `parse` then says so.
    if isinstance(costs := chosen.get("seconds_per_action"), Mapping):
        chosen["seconds_per_action"] = [*costs.items()]
    if "oracle_envs" not in chosen and isinstance(envs := chosen.get("envs"), list | tuple):
        chosen["oracle_envs"] = [env for env in envs if env == MENTAL]
    if chosen.get("taught") is not None:
        chosen["taught"] = parse(Taught, chosen["taught"], f"{where}: `taught`", error=SettingsError)
    if isinstance(names := chosen["memories"], list | tuple) and len(names) <= MAX_NAMES:
        parts = [split_memories(part) if isinstance(part, str) and part in SPLITS else (part,) for part in names]
        named = [name for part in parts for name in part]
        taught = chosen["taught"].names if chosen.get("taught") is not None else ()
        chosen["memories"] = [*named, *(name for name in taught if name not in named)]
    suite = with_n_imagined(parse(Suite, chosen, where, error=SettingsError))
    if check_names:
        _check_names(suite, where)
    return suite


def with_n_imagined(suite: Suite) -> Suite:
    """Return a suite in which every agent without a number of its own takes part once with each of `n_imagined`."""
    if not suite.n_imagined:
        return suite
    names = [
        [agent] if split_name(agent)[1] is not None else [f"{agent}@{n}" for n in suite.n_imagined]
        for agent in suite.agents
    ]
    return replace(suite, agents=tuple(dict.fromkeys(name for some in names for name in some)))


def refuse_modules(suite: Suite, where: str) -> None:
    """Refuse agents and environments that are named with a module: what stands in a file is not imported unasked.

    Raises:
        SettingsError: Naming the first of them, and how to ask.
        NotFoundError: If an environment is none of this project's.
    """
    envs = [name for name in (*suite.envs, suite.training_env, *suite.oracle_envs) if ":" in name]
    agents = [name for name in suite.agents if is_entry_point(split_name(name)[0])]
    for name in (*agents, *envs):  # whatever file of that name lies here
        raise SettingsError(
            f"{where}: `{name}` is a module that would be imported and run; if you trust the file, add --trust"
        )
    _check_envs(suite, where)


def _check_names(suite: Suite, where: str) -> None:
    """Check that everything a suite names exists, before anything is started."""
    for agent in suite.agents:
        try:
            check_agent(agent)
        except (SettingsError, NotFoundError) as error:
            raise type(error)(f"{where}: {error}") from error
    _check_envs(suite, where)
    names = (*shipped_memories(None), *SPLITS)
    for memory in suite.memories:
        if suite.taught_seed(memory) is None and memory not in names and not os.path.isfile(memory):
            raise NotFoundError(
                f"{where}: no memory `{memory}`{nearest_name(memory, names)}: neither a file, a shipped name, nor a "
                f"part of the bank ({', '.join(SPLITS)})"
            )


def _check_envs(suite: Suite, where: str) -> None:
    for env in (*suite.envs, suite.training_env, *suite.oracle_envs):
        if env not in ENVIRONMENTS and ":" not in env:  # `module:name` registers its own
            raise NotFoundError(
                f"{where}: no environment `{env}`{nearest_name(env, ENVIRONMENTS)}; there are {', '.join(ENVIRONMENTS)}"
            )


def trained_here(name: str) -> bool:
    """Return whether an agent is trained by the suite itself, on the memory on which it is judged."""
    return split_name(name)[0] == PPO


def bundle_of(name: str) -> str | None:
    """Return the bundle, trained before, that an agent comes out of: a shipped name or a file; None for any other."""
    base, _ = split_name(name)
    found = base not in NAMES and not is_entry_point(base) and (base in shipped_agents() or os.path.isfile(base))
    return base if found else None


def check_agent(name: str) -> str:
    """Return `name` if it can take part.

    Whatever it names is made at once: a package that is missing, a bundle that is damaged or a mistake in a
    `package.module:factory` should not wait for the first job.

    Raises:
        NotFoundError: If it is neither an agent, nor a bundle, nor a factory; the message offers the nearest name.
        SettingsError: If a factory makes no agent.
        FileFormatError: If a bundle is damaged.
        MissingDependencyError: If it needs a package that is not installed; the message names its extra.
    """
    base, _ = split_name(name)
    if trained_here(name):
        return name
    if base in UNTRAINED:
        make_agent(name)
    elif bundle_of(name) is not None:
        load_bundle(base)
    elif is_entry_point(base):
        load_entry_point(base)
    elif base in TRAINED:
        raise NotFoundError(
            f"agent `{base}` takes part out of a bundle, such as `{base}/BoxingMental-v0` or a file of "
            f"`creative-nao agent train {base}`"
        )
    else:
        known = (*UNTRAINED, PPO, *shipped_agents())
        raise NotFoundError(
            f"no agent `{base}`{nearest_name(base, known)}; there are: {', '.join(known)}, bundle files, and "
            "package.module:factory for your own"
        )
    return name


def resolve_agent(name: str, bundle: Path | None = None) -> Agent:
    """Make the agent that takes part under this name; `bundle` is that of one trained on the spot.

    Raises:
        CreativeNaoError: As of `check_agent`.
    """
    agent = make_agent(check_agent(name), bundle)
    agent.name = name  # pyright: ignore[reportAttributeAccessIssue]
    return agent


def actions_before(name: str) -> int:
    """Return how many actions an agent generated in training: as its bundle or its factory tells, else 0."""
    base, _ = split_name(name)
    if (bundle := bundle_of(name)) is not None:
        return load_bundle(bundle).header.n_actions_training
    return load_entry_point(base).n_actions_training if is_entry_point(base) else 0
