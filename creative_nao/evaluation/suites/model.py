"""What a suite is: which agents search which memories in which environments, how often and at which budget."""

from __future__ import annotations

import math
from dataclasses import dataclass

from creative_nao.agents.ppo import PPOSettings
from creative_nao.errors import SettingsError
from creative_nao.fields import is_plain_name, shown

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
