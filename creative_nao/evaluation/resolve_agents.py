"""Who may take part: an agent by name, one trained on the spot, a bundle trained before, or a factory of the user's."""

from __future__ import annotations

import os
from pathlib import Path

from creative_nao.agents.base import Agent, PolicyAgent
from creative_nao.agents.bundle import load_bundle, shipped_agents
from creative_nao.agents.registry import NAMES, TRAINED, UNTRAINED, is_entry_point, load_entry_point, make_agent
from creative_nao.errors import NotFoundError, nearest_name

PPO = "ppo"
"""The one agent that a suite trains itself, where it names it without a bundle."""


def trained_here(name: str) -> bool:
    """Return whether an entrant is trained by the suite itself, on the memory on which it is judged."""
    return name == PPO


def in_bundle(name: str) -> bool:
    """Return whether an entrant comes out of a bundle that was trained before."""
    return name not in NAMES and (name in shipped_agents() or os.path.isfile(name))


def check_entrant(name: str) -> str:
    """Return `name` if it can take part.

    Whatever it names is made at once: a package that is missing, a bundle that is damaged or a mistake in a
    `package.module:factory` should not wait for the first job.

    Raises:
        NotFoundError: If it is neither an agent, nor a bundle, nor a factory; the message offers the nearest name.
        SettingsError: If a factory makes no agent.
        FileFormatError: If a bundle is damaged.
        MissingDependencyError: If it needs a package that is not installed; the message names its extra.
    """
    if trained_here(name):
        return name
    if name in UNTRAINED:
        UNTRAINED[name]()
        return name
    if in_bundle(name):
        load_bundle(name)
        return name
    if is_entry_point(name):
        load_entry_point(name)
        return name
    if name in TRAINED:
        raise NotFoundError(
            f"agent `{name}` takes part out of a bundle, such as `{name}/BoxingMental-v0` or a file of "
            f"`creative-nao agent train {name}`"
        )
    known = (*UNTRAINED, PPO, *shipped_agents())
    raise NotFoundError(
        f"no agent `{name}`{nearest_name(name, known)}; there are: {', '.join(known)}, bundle files, and "
        "package.module:factory for your own"
    )


def make_entrant(name: str, bundle: Path | None = None) -> Agent:
    """Make the agent that takes part under this name.

    Args:
        name: Agent or bundle.
        bundle: Bundle of an agent that was trained on the spot.

    Raises:
        NotFoundError: If there is no such agent or bundle.
        FileFormatError: If a bundle is damaged.
    """
    if in_bundle(name):
        trained = load_bundle(name)
        return PolicyAgent(trained, deterministic=trained.header.deterministic, name=name)
    return make_agent(check_entrant(name), bundle)


def actions_before(name: str) -> int:
    """Return how many actions an entrant out of a bundle generated in training; 0 for any other."""
    return load_bundle(name).header.n_actions_training if in_bundle(name) else 0
