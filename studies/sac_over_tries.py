"""SAC over every try of an episode, for `BoxingMental-v1`: what PPO's `TryPolicy` is, as actor and critics.

`python studies/sac_over_tries.py --seed 0 --out FILE.json` trains on train memories and prints the reward of the last
weights on validation memories. With `--env CreativeNao/BoxingRehearsal-v0` each cell has two values, with a commit and
without. It is a study and no algorithm of the package, because it earns no more than PPO.
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
from torch import nn
from torch.distributions import Categorical

from creative_nao import storage
from creative_nao.agents import CellSACPolicy, FlippedSwappedAxes
from creative_nao.agents.cells import CARRIED, CellActor, CellCritic, CellDistribution, cells_at
from creative_nao.agents.tries import TryFeatures, TryWeights
from creative_nao.envs import SB3VecEnv
from creative_nao.envs.observation import N_CELLS
from creative_nao.model import split_memories

N_STEPS = 8
"""In rehearsal a value is learned from what the next so many steps earn and the value after them: rewards are rare."""


class Scores(nn.Module):
    """Scores of the cells; in rehearsal without a commit, then with one."""

    def __init__(self, features: TryFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        self.parts = nn.ModuleList(TryWeights(features, width, n_layers) for _ in range(1 + features.rehearsal))

    def forward(self, *known: Any) -> Any:
        """Return them, (n, n_cells), in rehearsal (n, 2 * n_cells)."""
        return torch.cat([part(*known)[0] for part in self.parts], dim=1)


class JointCells(CellDistribution):
    """Draws one of the cells, in rehearsal together with whether to commit, then a point of it."""

    def proba_distribution(self, logits: torch.Tensor) -> JointCells:
        """Take the logits of `Scores`."""
        self.categorical, self.bernoulli = Categorical(logits=logits), None
        return self

    def sample(self) -> torch.Tensor:
        """Draw actions, (n, n_pb) or (n, n_pb + 1)."""
        drawn = self.categorical.sample()
        return self._actions(drawn, torch.rand(len(drawn), self.n_pb))

    def mode(self) -> torch.Tensor:
        """Return the centres of the likeliest cells, in rehearsal with or without a commit."""
        likeliest = self.categorical.logits.argmax(dim=1)
        return self._actions(likeliest, torch.full((len(likeliest), self.n_pb), 0.5))

    def _actions(self, places: torch.Tensor, within: torch.Tensor) -> torch.Tensor:
        points = self._corner(places) + (2.0 / self.resolution) * within
        return self._with_commit(points, places >= self.resolution**self.n_pb if self.commits else None)


class TryActor(CellActor):
    """Draws points of the PB space."""

    def __init__(self, spaces: Any, width: int, n_layers: int) -> None:
        BasePolicy.__init__(self, *spaces, squash_output=True)
        self.features = TryFeatures(spaces[0], N_CELLS)
        self.weights = Scores(self.features, width, n_layers)
        self.action_dist = JointCells(self.features.n_pb, commits=self.features.rehearsal)


class TryCritic(CellCritic):
    """Values every cell, with two networks."""

    def __init__(self, spaces: Any, width: int, n_layers: int) -> None:
        BaseModel.__init__(self, *spaces)
        self.features = TryFeatures(spaces[0], N_CELLS)
        self.values = nn.ModuleList(Scores(self.features, width, n_layers) for _ in range(2))

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return each network's values (n, 1), as `CellCritic` does."""
        if not self.features.rehearsal or hasattr(actions, CARRIED):
            return super().forward(obs, actions)
        n_pb, inputs = self.features.n_pb, self.features(obs)
        places = cells_at(actions[:, :n_pb]) + N_CELLS**n_pb * (actions[:, n_pb] > 0.0)
        return tuple(values(*inputs).gather(1, places[:, None]) for values in self.values)


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
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--env", default="CreativeNao/BoxingMental-v1", help="it, or CreativeNao/BoxingRehearsal-v0")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timesteps", type=int, default=24_000)
    parser.add_argument("--gradient-steps", type=int, default=2, help="after each step of all 16 copies")
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--judged", nargs="+", default=["validation"], help="parts of the bank")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    differing: dict[str, Any] = {"gamma": 0.9, "batch_size": 128}
    if "Rehearsal" in asked.env:
        differing = {"gamma": 1.0, "batch_size": 64, "n_steps": N_STEPS}
    envs = FlippedSwappedAxes(SB3VecEnv(asked.env, 16, n_threads=1, memory="train"))
    model = SAC(
        TrySACPolicy, envs, buffer_size=asked.timesteps, learning_starts=1000, train_freq=1,
        gradient_steps=asked.gradient_steps, learning_rate=1e-3, ent_coef="auto_0.1", target_entropy=0.0,
        tau=0.01, seed=asked.seed, device="cpu", policy_kwargs={"width": 16, "n_layers": 2}, **differing,
    )  # fmt: skip
    began = time.process_time()
    model.learn(asked.timesteps)
    print(f"trained in {time.process_time() - began:.0f} s of a core", flush=True)
    model.policy.set_training_mode(False)
    values: dict[str, Any] = {"settings": {**vars(asked), "out": None}}
    seeds = range(100, 100 + asked.episodes)
    for part in asked.judged:
        values[part] = {}
        for way, score in judged(model.policy, asked.env, split_memories(part), seeds).items():
            values[part][way] = score.as_json()
            low, high = score.interval
            print(f"{part}, {way}: {score.mean:.2f} ({low:.2f} to {high:.2f})", flush=True)
    if asked.out is not None:
        storage.write_text(asked.out, json.dumps(values))


if __name__ == "__main__":
    main()
