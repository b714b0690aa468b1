"""PPO that starts from a learned map, whose supervised loss may be kept as an auxiliary one (after arXiv 2305.15930).

`python studies/ppo_from_map.py MAP.safetensors --truths FOLDER --auxiliary 8 --out FILE.json` trains the map's network
as a policy: what it expects a cell of a grid to earn, divided by a temperature that is learned too, is the logit of
choosing that cell. It prints the reward on validation memories before and after. FOLDER keeps the truths of the train
memories, which are made where they are missing.
"""

from __future__ import annotations

import argparse
import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from creative_nao import load_agent, storage
from creative_nao.agents import CellPolicy, FlippedSwappedAxes, PolicyAgent
from creative_nao.agents.cells import CellDistribution
from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.training import Simulator, SupervisedMap, losses
from creative_nao.agents.learned_map.truth import bank_truths
from creative_nao.agents.play import Score, evaluate_agent
from creative_nao.envs import SB3VecEnv, Track
from creative_nao.envs.observation import split
from creative_nao.model import split_memories

ENV = "CreativeNao/BoxingMental-v1"
RESOLUTION = 12
"""Cells along an axis of the PB space, of which one is chosen and a point drawn within it."""
TEMPERATURE = 0.1
"""First divisor of what a cell is expected to earn, in units of the reward."""


class MapNetwork(nn.Module):
    """Logits of the cells from a learned map, and features of the value: what it expects of them, and the time."""

    def __init__(self, start: AttentiveMap) -> None:
        super().__init__()
        self.map = copy.deepcopy(start)
        line = (torch.arange(RESOLUTION) + 0.5) * (2.0 / RESOLUTION) - 1.0
        y, x = torch.meshgrid(line, line, indexing="ij")  # the first unit's index runs fastest
        self.register_buffer("places", torch.stack([x.flatten(), y.flatten()], dim=1), persistent=False)
        self.log_temperature = nn.Parameter(torch.tensor(float(np.log(TEMPERATURE))))
        self.value = nn.Sequential(nn.Linear(6, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = RESOLUTION**2, 32

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits (n, n_cells) and value features (n, 32)."""
        told: Any = split(observations, self.map.parts, self.map.columns)  # pyright: ignore[reportArgumentType]
        rows = told["tries"][:, : max(int(told["tries"][..., 0].sum(dim=1).max()), 1)]
        points = told["points"].unflatten(1, (self.map.n_basic, -1))
        asked = self.places.expand(len(observations), *self.places.shape)
        usable, far, _ = expected(self.map(points, rows, rows[..., 0], asked))
        worth = usable * far
        earned = rows[..., self.map.columns[3].start]
        best = worth.topk(2, dim=1).values
        summary = [worth.mean(dim=1), worth.std(dim=1), *best.unbind(dim=1), earned.mean(dim=1)]
        value = self.value(torch.stack([*summary, told["step"][:, 0]], dim=1).detach())
        return worth / self.log_temperature.exp(), value

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """Return logits."""
        return self(observations)[0]

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """Return value features."""
        return self(observations)[1]


class MapPolicy(CellPolicy):
    """PPO's policy over the cells, out of a learned map; `start` is the map to begin with."""

    def __init__(
        self, observation_space: Any, action_space: Any, lr_schedule: Any, start: AttentiveMap, use_sde: bool = False
    ) -> None:
        self.begin_with = (start,)  # a module may only be set once the policy is one
        super().__init__(observation_space, action_space, lr_schedule, use_sde=use_sde)

    def make_network(self, space: Any, actions: Any) -> tuple[Any, CellDistribution]:
        """Return the network and its distribution."""
        return MapNetwork(self.begin_with[0]), CellDistribution(2, RESOLUTION)


class Auxiliary(BaseCallback):
    """Leaves the map alone until the value has been learned, then goes on teaching it the truth after each rollout."""

    def __init__(self, simulator: Simulator | None, n_batches: int, n_warm_up: int, seed: int) -> None:
        super().__init__()
        self.simulator, self.n_batches, self.n_warm_up = simulator, n_batches, n_warm_up
        self.random = np.random.default_rng(seed)
        self.n_rollouts = 0

    def _on_rollout_end(self) -> None:
        policy: Any = self.model.policy
        network = policy.mlp_extractor
        self.n_rollouts += 1
        for one in (*network.map.parameters(), network.log_temperature):
            one.requires_grad_(self.n_rollouts > self.n_warm_up)
        for _ in range(self.n_batches if self.simulator is not None and self.n_rollouts > self.n_warm_up else 0):
            known, (asked, *truth) = self.simulator.batch(self.random)  # pyright: ignore[reportOptionalMemberAccess]
            terms = losses(network.map(*known, asked), *truth)
            policy.optimizer.zero_grad()
            (terms[0] + terms[1] + self.simulator.recipe.basic_weight * terms[2]).backward()  # pyright: ignore[reportOptionalMemberAccess]
            nn.utils.clip_grad_norm_(network.map.parameters(), 1.0)
            policy.optimizer.step()

    def _on_step(self) -> bool:
        return True


def judged(policy: Any, memories: tuple[str, ...], seeds: range) -> dict[str, Score]:
    """Return the scores of a policy on memories, by the way it plays."""
    return {
        way: Score(ENV, way == "likeliest", evaluate_agent(
            PolicyAgent(policy, deterministic=way == "likeliest", track=Track.TRAJECTORIES), ENV, memories, seeds
        ))
        for way in ("drawn", "likeliest")
    }  # fmt: skip


def main() -> None:
    """Train and print the scores."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", help="bundle, or shipped name, of a learned map")
    parser.add_argument("--truths", type=Path, help="folder of the train memories' truths, for --auxiliary")
    parser.add_argument("--auxiliary", type=int, default=0, help="batches of the supervised loss after each rollout")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timesteps", type=int, default=19_200)
    parser.add_argument("--warm-up", type=int, default=2, help="rollouts in which the value alone learns")
    parser.add_argument("--learning-rate", type=float, default=2e-4)
    parser.add_argument("--judged", default="validation", help="part of the bank")
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    start: Any = load_agent(asked.map).policy
    names = split_memories("train")
    simulator = None
    if asked.auxiliary:
        simulator = Simulator(bank_truths(names, asked.truths), SupervisedMap(imagined_share=0.0))
    envs = FlippedSwappedAxes(SB3VecEnv(ENV, 32, n_threads=1, memory="train"))
    model = PPO(
        MapPolicy, envs, n_steps=30, batch_size=120, n_epochs=3, gamma=0.9, gae_lambda=0.9, clip_range=0.1,
        learning_rate=asked.learning_rate, seed=asked.seed, device="cpu", policy_kwargs={"start": start},
    )  # fmt: skip
    memories, seeds = split_memories(asked.judged), range(100, 100 + asked.episodes)
    found = {"before": judged(model.policy, memories, seeds)}
    model.learn(asked.timesteps, callback=Auxiliary(simulator, asked.auxiliary, asked.warm_up, asked.seed))
    found["after"] = judged(model.policy, memories, seeds)
    envs.close()
    for when, scores in found.items():
        for way, score in scores.items():
            low, high = score.interval
            print(f"{when}, {way}: {score.mean:.2f} ({low:.2f} to {high:.2f})")
    if asked.out is not None:
        values = {when: {way: one.as_json() for way, one in scores.items()} for when, scores in found.items()}
        storage.write_text(asked.out, json.dumps({"settings": {**vars(asked), "truths": None, "out": None}, **values}))


if __name__ == "__main__":
    main()
