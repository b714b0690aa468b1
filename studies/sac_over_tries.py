"""SAC over every try of an episode, for `BoxingMental-v1`: what PPO's `TryPolicy` is, as actor and critics.

`python studies/sac_over_tries.py --seed 0 --out FILE.json` trains on train memories and prints the reward of the last
weights on validation memories. It is a study and no algorithm of the package, because it earns no more than PPO.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import torch
from ppo_from_map import judged
from stable_baselines3 import SAC
from stable_baselines3.common.policies import BaseModel, BasePolicy

from creative_nao import storage
from creative_nao.agents import CellSACPolicy, FlippedSwappedAxes
from creative_nao.agents.cells import CellActor, CellCritic, CellDistribution
from creative_nao.agents.tries import TryFeatures, TryWeights
from creative_nao.envs import SB3VecEnv
from creative_nao.envs.observation import N_CELLS
from creative_nao.model import split_memories

ENV = "CreativeNao/BoxingMental-v1"


class Scores(TryWeights):
    """Scores of the cells, and nothing beside."""

    def forward(self, *known: Any) -> Any:
        """Return them, (n, n_cells)."""
        return super().forward(*known)[0]


class TryActor(CellActor):
    """Draws points of the PB space."""

    def __init__(self, spaces: Any, width: int, n_layers: int) -> None:
        BasePolicy.__init__(self, *spaces, squash_output=True)
        self.features = TryFeatures(spaces[0], N_CELLS)
        self.weights = Scores(self.features, width, n_layers)
        self.action_dist = CellDistribution(self.features.n_pb)


class TryCritic(CellCritic):
    """Values every cell, with two networks."""

    def __init__(self, spaces: Any, width: int, n_layers: int) -> None:
        BaseModel.__init__(self, *spaces)
        self.features = TryFeatures(spaces[0], N_CELLS)
        self.values = torch.nn.ModuleList(Scores(self.features, width, n_layers) for _ in range(2))


class TrySACPolicy(CellSACPolicy):
    """Actor and critics."""

    def make_actor(self, features_extractor: Any = None) -> Any:
        """Return an untrained actor."""
        return TryActor((self.observation_space, self.action_space), self.width, self.n_layers)

    def make_critic(self, features_extractor: Any = None) -> Any:
        """Return untrained critics."""
        return TryCritic((self.observation_space, self.action_space), self.width, self.n_layers)


def main() -> None:
    """Train and print the scores."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timesteps", type=int, default=24_000)
    parser.add_argument("--gradient-steps", type=int, default=2, help="after each step of all 16 copies")
    parser.add_argument("--judged", nargs="+", default=["validation"], help="parts of the bank")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    envs = FlippedSwappedAxes(SB3VecEnv(ENV, 16, n_threads=1, memory="train"))
    model = SAC(
        TrySACPolicy, envs, buffer_size=asked.timesteps, learning_starts=1000, batch_size=128, train_freq=1,
        gradient_steps=asked.gradient_steps, learning_rate=1e-3, gamma=0.9, ent_coef="auto_0.1", target_entropy=0.0,
        tau=0.01, seed=asked.seed, device="cpu", policy_kwargs={"width": 16, "n_layers": 2},
    )  # fmt: skip
    began = time.process_time()
    model.learn(asked.timesteps)
    print(f"trained in {time.process_time() - began:.0f} s of a core", flush=True)
    model.policy.set_training_mode(False)
    values: dict[str, Any] = {"settings": {**vars(asked), "out": None}}
    for part in asked.judged:
        values[part] = {}
        for way, score in judged(model.policy, ENV, split_memories(part), range(100, 105)).items():
            values[part][way] = score.as_json()
            low, high = score.interval
            print(f"{part}, {way}: {score.mean:.2f} ({low:.2f} to {high:.2f})", flush=True)
    if asked.out is not None:
        storage.write_text(asked.out, json.dumps(values))


if __name__ == "__main__":
    main()
