"""Agents that explore before the eyes of the page, try by try: they play an episode now, or did so in a run."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from creative_nao.agents import UNTRAINED, make_agent, shipped_agents
from creative_nao.agents.bundle import KIND, find_bundle
from creative_nao.agents.play import make_env, play_episode
from creative_nao.agents.registry import split_name
from creative_nao.arrays import load_tensors
from creative_nao.envs import BoxingMentalEnv, Track
from creative_nao.envs.observation import CELLS
from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.explorer.run_episodes import MENTAL, RunEpisodes, Try
from creative_nao.model import Memory

UNTRAINED_ENVIRONMENT = f"{MENTAL}1"
N_TRIES = 30
MAX_CANDIDATES = 64
"""An agent may look at so many movements before each that it performs."""
MAX_DOTS = 5000
IMAGINING = ("plan@8", "surrogate@8", "random@8")
RECORDED = "run:"
"""Begins the name of an agent of the run folder."""


def trained_agents(memory: Memory) -> list[str]:
    """Return the shipped agents that can play in a memory without physics, the best recorded score first."""
    seen = {
        BoxingMentalEnv(memory, n_actions=N_TRIES, observation=kind).observation_space.shape
        for kind in (CELLS, *(track for track in Track if track != Track.MAP))
    }
    mental = [name for name in shipped_agents() if _environment(name).startswith(MENTAL)]
    return sorted((name for name in mental if _trained_on(name)[1] in seen), key=lambda name: -_trained_on(name)[2])


@functools.cache
def _trained_on(name: str) -> tuple[str, tuple[int, ...], float]:
    """Return an agent's environment, the shape of what it observes and its score; its policy would load torch."""
    header, _ = load_tensors(find_bundle(name), kind=KIND)
    score = header["score"]  # all that ship record one, in the environment that they are for
    return score["env"], tuple(header["observation_space"]["shape"]), float(score["mean"])


def _environment(name: str) -> str:
    """Return the environment that an agent plays in: a trained one where it was trained."""
    return _trained_on(name)[0] if "/" in name else UNTRAINED_ENVIRONMENT


def agents_for(memory: Memory, run: RunEpisodes | None = None) -> dict[str, Any]:
    """Return the agents that the page offers in a memory; JSON values.

    `groups` of names with their titles, the `pair` that races unless others are chosen, and `guide`, who finds the
    surprises of the tour.
    """
    trained, recorded = trained_agents(memory), list(_recorded(memory, run))
    groups = {
        "" if run is None else f"Of the run {run.name}": recorded,
        "Trained": trained, "By rule or search": [*UNTRAINED],
        "Imagining eight before each": [*(f"{name}@8" for name in trained[:1]), *IMAGINING],
    }  # fmt: skip
    guide = [*trained, "spread_points"][0]
    return {
        "groups": [[title, names] for title, names in groups.items() if names],
        "pair": [*recorded[:2], guide, "random"][:2], "guide": guide,
    }  # fmt: skip


def dots(memory: Memory, run: RunEpisodes | None) -> list[tuple[float, float]]:
    """Return the PB points that agents of a run tried in a memory, at most `MAX_DOTS`."""
    return [one.pb for seeds in _recorded(memory, run).values() for episode in seeds for one in episode][:MAX_DOTS]


def _recorded(memory: Memory, run: RunEpisodes | None) -> dict[str, list[list[Try]]]:
    return {} if run is None else {f"{RECORDED}{title}": seeds for title, seeds in run.of(memory.name).items()}


def tries(memory: Memory, name: str, seed: int, run: RunEpisodes | None = None) -> dict[str, Any]:
    """Return the tries of one episode: PB point, reward, outcome and imagined movements of each, JSON values.

    An agent of the run is taken at its `seed`-th episode there, beginning again after the last; another plays one now.
    NotFoundError if there is no such agent.
    """
    recorded = _recorded(memory, run)
    if name in recorded:
        found = recorded[name][seed % len(recorded[name])]
    else:
        base, n_candidates = split_name(name)
        known = [*recorded, *trained_agents(memory), *UNTRAINED]
        if base not in known or base in recorded or (n_candidates or 1) > MAX_CANDIDATES:
            raise NotFoundError(f"no agent `{name:.40}`{nearest_name(name, known)}; there are {', '.join(known)}")
        agent = make_agent(name)
        if "/" in base:
            import torch

            torch.set_num_threads(1)  # so that sums are made in the same order everywhere
        env = make_env(_environment(base), memory, agent, N_TRIES)
        played = play_episode(agent, env, seed=seed, rng=np.random.default_rng(seed), n_actions=N_TRIES)
        found, before = [], 0
        for pb, reward, info, n_imagined in played:
            found.append(Try((float(pb[0]), float(pb[1])), reward, str(info["outcome"]), n_imagined - before))
            before = n_imagined
    return {"tries": [dict(zip(Try._fields[:4], one, strict=False)) for one in found]}
