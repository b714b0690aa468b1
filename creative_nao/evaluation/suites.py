"""Suites as data: which agents search which memories in which environments, how often and at which budget."""

from __future__ import annotations

from dataclasses import dataclass

from creative_nao.agents.ppo import PPOSettings
from creative_nao.errors import NotFoundError, SettingsError, nearest_name

BOXING = "CreativeNao/Boxing-v0"
MENTAL = "CreativeNao/BoxingMental-v0"


@dataclass(frozen=True)
class Suite:
    """One comparison of agents.

    Raises:
        SettingsError: If a count is below 1; the message names the field.
    """

    name: str
    agents: tuple[str, ...]
    envs: tuple[str, ...]
    memories: tuple[str, ...]
    n_seeds: int
    """Repetitions of everything; trained agents are trained anew for each."""
    n_actions: int
    """Budget of an episode, in generated actions."""
    training_env: str
    """Where trained agents are trained, on the memory on which they are judged."""
    ppo: PPOSettings
    oracle_envs: tuple[str, ...]
    """Environments in which the greedy oracle over the whole map is exact: they score the generated trajectory."""
    resolution: int = 200
    """Points along each axis of the map that the oracle searches."""
    seeds_per_job: int = 4
    """Seeds that one process judges: starting it costs as much as an episode."""
    seconds_per_action: tuple[tuple[str, float], ...] = ()
    """Expected cost of an action in an environment, for the time left alone."""

    def __post_init__(self) -> None:
        for field in ("n_seeds", "n_actions", "resolution", "seeds_per_job"):
            if getattr(self, field) < 1:
                raise SettingsError(
                    f"suite `{self.name}`: `{field}` should be at least 1, but is {getattr(self, field)}"
                )


QUICK = Suite(
    name="quick",
    agents=("supervised", "random", "ppo"),
    envs=(BOXING, MENTAL),
    memories=("half/0",),
    n_seeds=8,
    n_actions=30,
    training_env=MENTAL,
    ppo=PPOSettings(),
    oracle_envs=(MENTAL,),
    seconds_per_action=((BOXING, 0.07), (MENTAL, 0.0003)),
)
"""Minutes on two cores: is the memory a source of new actions, and does a search find more of them than chance?"""

SUITES: dict[str, Suite] = {QUICK.name: QUICK}


def find_suite(name: str) -> Suite:
    """Return the suite called `name`.

    Raises:
        NotFoundError: If there is none; the message offers the nearest name.
    """
    if name not in SUITES:
        raise NotFoundError(f"no suite `{name}`{nearest_name(name, SUITES)}; there are: {', '.join(SUITES)}")
    return SUITES[name]
