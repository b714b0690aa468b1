"""Play the recorded score of a bundle again."""

from __future__ import annotations

import platform
from collections.abc import Callable

from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.bundle import TrainedPolicy
from creative_nao.agents.judging import Score, play_episodes
from creative_nao.errors import SettingsError


def replay(trained: TrainedPolicy, progress: Callable[[int], None] | None = None) -> Score:
    """Return the score that the bundle reaches now; it equals `trained.header.score` on the machine that recorded it.

    Raises:
        SettingsError: If the bundle records no score.
    """
    recorded = trained.header.score
    if recorded is None:
        raise SettingsError("this bundle records no score to replay; agents trained with `creative-nao agent train` do")
    return score_policy(
        trained, recorded.env, recorded.memories, recorded.seeds, recorded.deterministic, progress=progress
    )


def score_policy(
    policy: TrainedPolicy,
    env_id: str,
    memories: tuple[str, ...],
    seeds: tuple[int, ...],
    deterministic: bool,
    progress: Callable[[int], None] | None = None,
) -> Score:
    """Return the score of a policy over memories and seeds; see `play_episodes`."""
    import torch

    torch.set_num_threads(1)  # so that sums are made in the same order everywhere
    agent = PolicyAgent(policy, deterministic=deterministic)
    return Score(env_id, deterministic, play_episodes(agent, env_id, memories, seeds, progress=progress))


def machine() -> str:
    """Return what decides how torch rounds: the kind of processor and the instructions that it uses."""
    import torch

    return f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}"
