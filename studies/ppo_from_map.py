"""PPO that starts from a learned map, whose supervised loss may be kept as an auxiliary one (after arXiv 2305.15930).

`python studies/ppo_from_map.py MAP.safetensors --truths FOLDER --auxiliary 8 --out FILE.json` trains the map's network
as a policy: what it expects a cell of a grid to earn, divided by a temperature that is learned too, is the logit of
choosing that cell. With `--env CreativeNao/BoxingRehearsal-v0` it chooses where to imagine: the logit is the logarithm
of what it expects beyond the candidate, divided by the temperature; a network that begins with a commit at every eighth
movement imagined decides when to stop. With `--env CreativeNao/BoxingModulation-v1` and a map of several PB vectors it
chooses the next of them: the logit of a point spread over all is what it earns after what the movement has begun with.
It prints the reward on validation memories; `--timesteps 0` judges the start.
FOLDER keeps the truths of the train memories, which are made where they are missing.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn
from torch.distributions import Categorical

from creative_nao import load_agent, storage
from creative_nao.agents import CellPolicy, FlippedSwappedAxes, PolicyAgent
from creative_nao.agents.cells import CellDistribution
from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.training import Simulator, SupervisedMap, losses
from creative_nao.agents.learned_map.truth import bank_truths
from creative_nao.agents.play import Score, evaluate_agent
from creative_nao.envs import SB3VecEnv, Track
from creative_nao.envs.observation import split, tries_of
from creative_nao.model import split_memories

RESOLUTION = {False: 12, True: 8}
"""Cells along an axis of the PB space, of which one is chosen and a point drawn within it; True: in rehearsal."""
TEMPERATURE = {False: 0.1, True: 0.3}
"""First divisor of what a cell is expected to earn, in units of the reward, in rehearsal of its logarithm."""
N_SHOWN = 48
"""Most tries that the map is shown: those performed, then the latest imagined."""


class MapNetwork(nn.Module):
    """Logits of the cells from a learned map, and features of the value: what it expects of them, and the time."""

    places: torch.Tensor

    def __init__(self, start: AttentiveMap, space: Any) -> None:
        super().__init__()
        self.map = copy.deepcopy(start)
        self.parts, self.columns = tries_of(space)
        self.rehearsal = self.columns[-1].name == "candidate"
        self.resolution = RESOLUTION[self.rehearsal]
        line = (torch.arange(self.resolution) + 0.5) * (2.0 / self.resolution) - 1.0
        y, x = torch.meshgrid(line, line, indexing="ij")  # the first unit's index runs fastest
        self.register_buffer("places", torch.stack([x.flatten(), y.flatten()], dim=1), persistent=False)
        self.log_temperature = nn.Parameter(torch.tensor(float(np.log(TEMPERATURE[self.rehearsal]))))
        n_told = 10 if self.rehearsal else 6
        self.value = nn.Sequential(nn.Linear(n_told, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = self.resolution**2 + self.rehearsal, 32
        if self.rehearsal:
            self.commit = nn.Sequential(nn.Linear(n_told, 32), nn.Tanh(), nn.Linear(32, 1))
            nn.init.zeros_(self.commit[-1].weight)
            nn.init.zeros_(self.commit[-1].bias)

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits (n, n_cells), in rehearsal of the commit too, and value features (n, 32)."""
        told: Any = split(observations, self.parts, self.columns)  # pyright: ignore[reportArgumentType]
        rows = told["tries"][:, : max(int(told["tries"][..., 0].sum(dim=1).max()), 1)]
        earned, performed, best = rows[..., self.columns[3].start], rows[..., 0], 0.0
        if self.rehearsal:
            performed, candidate = rows[..., -2], rows[..., -1]
            waiting = (earned * candidate).sum(dim=1)
            best = (waiting / (1.0 - waiting).clamp(min=1e-3))[:, None]
            latest = torch.arange(rows.shape[1]) * rows[..., 0] + 1000.0 * performed
            shown = latest.topk(min(N_SHOWN, rows.shape[1]), dim=1).indices
            performed = performed.gather(1, shown)
            rows = rows.gather(1, shown[..., None].expand(-1, -1, rows.shape[2]))[..., : self.map.columns[-1].stop]
        points = told["points"].unflatten(1, (self.map.n_basic, -1))
        asked = self.places.expand(len(observations), *self.places.shape)
        usable, far, spread = expected(self.map(points, rows, performed, asked))
        if self.rehearsal:
            z = (far - best) / spread
            far = spread * (z * torch.special.ndtr(z) + torch.exp(-(z**2) / 2.0) / np.sqrt(2.0 * np.pi))
        worth = usable * far
        top = worth.topk(2, dim=1).values
        summary = [worth.mean(dim=1), worth.std(dim=1), *top.unbind(dim=1), earned.mean(dim=1), told["step"][:, 0]]
        if not self.rehearsal:
            return worth / self.log_temperature.exp(), self.value(torch.stack(summary, dim=1).detach())
        imagined = told["imagined"][:, 0]
        pace = 24.0 * (30.0 * (imagined - summary[-1]) - 0.8125)  # above 0 at every eighth
        summary += [waiting, candidate.sum(dim=1), imagined, pace / 24.0]
        known = torch.stack(summary, dim=1).detach()
        logits = (worth + 1e-3).log() / self.log_temperature.exp()
        # The step size is that of the map; what begins untrained takes larger steps.
        commit = pace.clamp(-8.0, 8.0)[:, None] + 10.0 * self.commit(known)
        return torch.cat([logits, commit], dim=1), 10.0 * self.value(known)

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """Return logits."""
        return self(observations)[0]

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """Return value features."""
        return self(observations)[1]


class SegmentNetwork(MapNetwork):
    """Logits of spread points of several PB vectors from a learned map, and features of the value, as `MapNetwork`.

    Behind the logits stand the PB vector held now and the place of the one that begins, or -1 where none does.
    """

    points: torch.Tensor

    def __init__(self, start: AttentiveMap) -> None:
        nn.Module.__init__(self)
        self.map = copy.deepcopy(start)
        self.parts, self.columns = start.parts, start.columns
        self.n_pb = start.action_space.shape[0]
        self.register_buffer("points", torch.from_numpy(start.candidates), persistent=False)
        self.log_temperature = nn.Parameter(torch.tensor(float(np.log(TEMPERATURE[False]))))
        self.value = nn.Sequential(nn.Linear(7, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = len(self.points) + self.n_pb + 1, 32

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits, the vector held and the place (n, n_points + n_pb + 1), and value features (n, 32)."""
        n, n_pb, learned = len(observations), self.n_pb, self.map
        told: Any = split(observations, self.parts, self.columns)  # pyright: ignore[reportArgumentType]
        rows = told["tries"][:, : max(int(told["tries"][..., 0].sum(dim=1).max()), 1)]
        starts, stop = learned.segment_starts, self.columns[1].stop
        vectors = rows[..., 1:stop].unflatten(2, (learned.n_decisions, n_pb))[:, :, starts].flatten(2)
        rows = torch.cat([rows[..., :1], vectors, rows[..., stop:]], dim=2)
        decision = (told["phase"][:, 0] * learned.n_decisions).round().long()
        path = told["path"].unflatten(1, (learned.n_decisions, n_pb))
        n_begun = (decision[:, None] > torch.tensor(starts)).sum(dim=1)
        held = path[torch.arange(n), (decision - 1).clamp(min=0)]
        begins = (decision[:, None] == torch.tensor(starts)).any(dim=1)
        done = (torch.arange(learned.n_segments) < n_begun[:, None]).repeat_interleave(n_pb, dim=1)[:, None]
        asked = torch.where(done, path[:, starts].flatten(1)[:, None], self.points)
        known = told["points"].unflatten(1, (learned.n_basic, n_pb)).repeat(1, 1, learned.n_segments)
        usable, far, _ = expected(learned(known, rows, rows[..., 0], asked))
        worth = usable * far
        top, earned = worth.topk(2, dim=1).values, rows[..., self.columns[3].start - stop + vectors.shape[2] + 1]
        summary = [worth.mean(dim=1), worth.std(dim=1), *top.unbind(dim=1), earned.mean(dim=1)]
        summary += [told["step"][:, 0], told["phase"][:, 0]]
        place = torch.where(begins, n_begun, -1)[:, None]
        latent = torch.cat([worth / self.log_temperature.exp(), held, place.float()], dim=1)
        return latent, self.value(torch.stack(summary, dim=1).detach())


class SegmentDistribution(CellDistribution):
    """Draws one of the points (n_points, n_segments * n_pb) where a PB vector begins, else holds the last.

    An action is the drawn point's PB vector of this place; no two points have one in common.
    """

    def __init__(self, points: torch.Tensor, n_pb: int) -> None:
        super().__init__(n_pb)
        self.vectors = points.unflatten(1, (-1, n_pb)).transpose(0, 1)

    def proba_distribution(self, logits: torch.Tensor) -> SegmentDistribution:
        """Take what `SegmentNetwork` returns."""
        n_points = self.vectors.shape[1]
        self.categorical = Categorical(logits=logits[:, :n_points])
        self.held, self.place = logits[:, n_points:-1], logits[:, -1].long()
        return self

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the probability of actions (n, n_pb), shape (n,); 0 where nothing begins."""
        gaps = (self.vectors[self.place.clamp(min=0)] - actions[:, None]).abs().sum(dim=2)
        return self.categorical.log_prob(gaps.argmin(dim=1)) * (self.place >= 0)

    def entropy(self) -> torch.Tensor:
        """Return the entropy, shape (n,)."""
        return self.categorical.entropy() * (self.place >= 0)

    def sample(self) -> torch.Tensor:
        """Draw PB vectors, shape (n, n_pb)."""
        return self._actions(self.categorical.sample())

    def mode(self) -> torch.Tensor:
        """Return those of the likeliest points, shape (n, n_pb)."""
        return self._actions(self.categorical.logits.argmax(dim=1))

    def _actions(self, drawn: torch.Tensor) -> torch.Tensor:
        return torch.where(self.place[:, None] >= 0, self.vectors[self.place.clamp(min=0), drawn], self.held)


class MapPolicy(CellPolicy):
    """PPO's policy over the cells, out of a learned map; `start` is the map to begin with."""

    def __init__(
        self, observation_space: Any, action_space: Any, lr_schedule: Any, start: AttentiveMap, use_sde: bool = False
    ) -> None:
        self.begin_with = (start,)  # a module may only be set once the policy is one
        super().__init__(observation_space, action_space, lr_schedule, use_sde=use_sde)

    def make_network(self, space: Any, actions: Any) -> tuple[Any, CellDistribution]:
        """Return the network and its distribution."""
        if self.begin_with[0].n_segments > 1:
            segments = SegmentNetwork(self.begin_with[0])
            return segments, SegmentDistribution(segments.points, segments.n_pb)
        network = MapNetwork(self.begin_with[0], space)
        return network, CellDistribution(2, network.resolution, network.rehearsal)


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


def judged(policy: Any, env: str, memories: tuple[str, ...], seeds: range) -> dict[str, Score]:
    """Return the scores of a policy on memories, by the way it plays."""
    return {
        way: Score(env, way == "likeliest", evaluate_agent(
            PolicyAgent(policy, deterministic=way == "likeliest", track=Track.TRAJECTORIES), env, memories, seeds
        ))
        for way in ("drawn", "likeliest")
    }  # fmt: skip


def main() -> None:
    """Train and print the scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("map", help="bundle, or shipped name, of a learned map")
    parser.add_argument(
        "--env", default="CreativeNao/BoxingMental-v1", help="it, or BoxingRehearsal-v0, BoxingModulation-v1"
    )
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
    began = time.process_time()
    start: Any = load_agent(asked.map).policy
    names = split_memories("train")
    simulator = None
    if asked.auxiliary:
        truths = bank_truths(names, asked.truths, start.n_segments)
        simulator = Simulator(truths, SupervisedMap(imagined_share=0.0))
    modulated, rehearsal = start.n_segments > 1, "Rehearsal" in asked.env
    envs: Any = SB3VecEnv(asked.env, 8 if modulated else 32, n_threads=1, memory="train")
    envs = envs if modulated else FlippedSwappedAxes(envs)  # that wrapper turns tries of one PB vector each
    # Of a decision; a movement has one, or ten where it is modulated.
    gamma, gae_lambda = (1.0, 0.95) if rehearsal else (0.99, 0.97) if modulated else (0.9, 0.9)
    model = PPO(
        MapPolicy, envs, n_steps=300 if modulated else 30, batch_size=120, n_epochs=3, clip_range=0.1,
        gamma=gamma, gae_lambda=gae_lambda,
        learning_rate=asked.learning_rate, seed=asked.seed, device="cpu", policy_kwargs={"start": start},
    )  # fmt: skip
    memories, seeds = split_memories(asked.judged), range(100, 100 + asked.episodes)
    if asked.timesteps:
        model.learn(asked.timesteps, callback=Auxiliary(simulator, asked.auxiliary, asked.warm_up, asked.seed))
    print(f"trained in {time.process_time() - began:.0f} s of a core", flush=True)
    found = judged(model.policy, asked.env, memories, seeds)
    envs.close()
    for way, score in found.items():
        low, high = score.interval
        print(f"{way}: {score.mean:.2f} ({low:.2f} to {high:.2f})")
    if asked.out is not None:
        values = {way: one.as_json() for way, one in found.items()}
        storage.write_text(asked.out, json.dumps({"settings": {**vars(asked), "truths": None, "out": None}, **values}))


if __name__ == "__main__":
    main()
