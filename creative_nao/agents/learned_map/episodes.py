"""Simulated episodes over the truth of memories: what a learned map is shown, and what it is asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.truth import MemoryTruth
from creative_nao.envs.observation import try_columns
from creative_nao.measures.outcome import ALL_OUTCOMES

N_ACTIONS = 30
"""Movements performed in a simulated episode, at most."""
CANDIDATES = (1, 1, 2, 4, 8, 16, 64)
"""Of how many movements the best is performed, where nothing imagined is kept: one of these is drawn."""
PLANNED = (1, 2, 4, 8)
"""How many movements are imagined for each one performed, where all are kept."""
N_MODES = 3
"""Waves along each axis of a warp."""
Warp = Callable[[np.ndarray], np.ndarray]
"""From PB points to PB points, (..., n_pb)."""


def random_warp(n_pb: int, rng: np.random.Generator, strength: float = 0.0) -> Warp:
    """Draw a smooth map of the PB space onto itself: axes flipped and swapped, then waves that vanish at the border.

    Point x moves along axis k by sum_i g_ki sin(i u_k) + sum_ij a_kij sin(i u_k) sin(j u_k+1), u = (x + 1) pi / 2, with
    g and a normal of standard deviation `strength` / i and `strength` / (i j). Points of several PB vectors, one after
    the other, are mapped vector by vector.
    """
    turn = (np.eye(n_pb) * rng.choice([-1.0, 1.0], n_pb))[rng.permutation(n_pb)]
    modes = np.arange(1, N_MODES + 1)
    own = rng.normal(0.0, 1.0, (n_pb, N_MODES)) * strength / modes
    both = rng.normal(0.0, 1.0, (n_pb, N_MODES, N_MODES)) * strength / (modes[:, None] * modes)

    def warp(pb: np.ndarray) -> np.ndarray:
        turned = pb.reshape(-1, n_pb) @ turn.T
        waves = np.sin((turned[..., None] + 1.0) * (np.pi / 2.0) * modes)
        moved = np.einsum("...ki,ki->...k", waves, own)
        moved += np.einsum("...ki,kij,...kj->...k", waves, both, np.roll(waves, -1, axis=-2))
        return np.clip(turned + moved, -1.0, 1.0).astype(np.float32).reshape(pb.shape)

    return warp


@dataclass(eq=False)
class SimulatedEpisode:
    """An episode over the truth of a memory: what was tried, and what every point would earn now.

    Attributes:
        truth: The memory.
        warp: Where its points lie for the network.
        order: Which basic action stands at each place for the network, (n_basic,).
        performed: Places of the points performed, in the order of time.
        earned: What each of them earned.
        imagined: Places of points imagined and not performed.
        known_distance: Distance of every point to the nearest movement known now, (n,), float32.
    """

    truth: MemoryTruth
    warp: Warp
    order: np.ndarray
    performed: list[int] = field(default_factory=list)
    earned: list[float] = field(default_factory=list)
    imagined: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        self.known_distance = self.truth.distances.min(axis=1)

    def worth(self, places: np.ndarray) -> np.ndarray:
        """Return what performing each of these points would earn now."""
        return np.where(self.truth.appropriate[places], self.known_distance[places], 0.0)

    def perform(self, place: int) -> None:
        """Perform the movement of a point."""
        self.earned.append(float(self.worth(np.array([place]))[0]))
        self.performed.append(int(place))
        if self.truth.appropriate[place]:
            self.known_distance = np.minimum(self.known_distance, self.truth.gaps[place])

    def perform_best(self, n: int, k: int, rng: np.random.Generator) -> None:
        """Perform `n` movements, each the best of `k` drawn."""
        for _ in range(n):
            drawn = rng.integers(len(self.truth.pb), size=k)
            self.perform(drawn[self.worth(drawn).argmax()])

    def perform_planned(self, n: int, rng: np.random.Generator) -> None:
        """Perform `n` movements, each the best of all imagined so far: some evenly spread first, others around it."""
        pb, k = self.truth.pb, int(rng.choice(PLANNED))
        share, sigma = rng.choice([0.0, 0.25, 0.5]), rng.choice([0.1, 0.2, 0.3])
        pool: np.ndarray = rng.integers(len(pb), size=(round(share * k * N_ACTIONS),))
        n_each = max(1, int((1.0 - share) * k))
        for _ in range(n):
            new = rng.integers(len(pb), size=n_each)
            if len(pool) and rng.random() < 0.7:
                near = pb[pool[self.worth(pool).argmax()]] + rng.normal(0.0, sigma, (n_each, pb.shape[1]))
                new = ((near[:, None] - pb) ** 2).sum(axis=-1).argmin(axis=1)
            pool = np.concatenate([pool, new])
            pool = pool[~np.isin(pool, self.performed)]
            self.perform(pool[self.worth(pool).argmax()] if len(pool) else int(rng.integers(len(pb))))
        self.imagined = np.setdiff1d(pool, self.performed)

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all tries as rows of the -v1 observation, (n, width), float32, and whether each was performed."""
        tried = np.concatenate([self.imagined, np.array(self.performed, np.int64)])
        reward = np.concatenate([self.worth(self.imagined), self.earned])[:, None]
        far = self.truth.distances[tried][:, self.order]
        outcome = np.eye(len(ALL_OUTCOMES), dtype=np.float32)[self.truth.outcome[tried]]
        pb = self.warp(self.truth.pb[tried])
        columns = np.ones((len(tried), 1)), pb, outcome, reward / (reward + 1.0), far / (far + 1.0)
        return np.concatenate(columns, axis=1, dtype=np.float32), np.arange(len(tried)) >= len(self.imagined)


def network_inputs(episodes: Sequence[SimulatedEpisode]) -> list[Tensor]:
    """Return what the network is told in b episodes: learned points (b, n_basic, n_pb), rows, whether performed."""
    told = [one.rows() for one in episodes]
    n_pb, n_basic = episodes[0].truth.form
    longest = max(max(len(rows) for rows, _ in told), 1)
    all_rows = np.zeros((len(told), longest, try_columns(n_basic, n_pb)[-1].stop), np.float32)
    performed = np.zeros((len(told), longest), np.float32)
    for k, (rows, flags) in enumerate(told):
        all_rows[k, : len(rows)], performed[k, : len(rows)] = rows, flags
    points = np.stack([one.warp(one.truth.learned_pb)[one.order] for one in episodes])
    return [torch.from_numpy(one) for one in (points, all_rows, performed)]


def queries_and_targets(episodes: Sequence[SimulatedEpisode], n_queries: int, rng: np.random.Generator) -> list[Tensor]:
    """Draw points to ask, (b, q, n_pb), and return them with the truth there.

    Whether appropriate (b, q), the distance to everything known (b, q), and that to each basic action (b, q, n_basic).
    """
    told = []
    for one in episodes:
        truth, places = one.truth, rng.integers(len(one.truth.pb), size=n_queries)
        usable, far = truth.appropriate[places].astype(np.float32), truth.distances[places][:, one.order]
        told.append((one.warp(truth.pb[places]), usable, one.known_distance[places], far))
    return [torch.from_numpy(np.stack(part)) for part in zip(*told, strict=True)]


def play_greedily(
    policy: AttentiveMap, episodes: Sequence[SimulatedEpisode], rng: np.random.Generator, n_asked: int | None = None,
    optimism: float = 0.0, noise: float = 0.0,
) -> None:  # fmt: skip
    """Perform all movements of the episodes, side by side, each at the point from which the map expects most.

    Args:
        policy: The map.
        episodes: They are played in place.
        rng: Draws the points asked, and the noise.
        n_asked: How many points are asked before each movement; None asks all.
        optimism: Weight of the spread.
        noise: Scale of the noise (Gumbel) on the values.
    """
    points = np.stack([one.warp(one.truth.pb) for one in episodes])
    with torch.inference_mode():
        for _ in range(N_ACTIONS):
            known = policy.encode(*network_inputs(episodes))
            n = points.shape[1]
            places = np.tile(np.arange(n), (len(episodes), 1))
            if n_asked is not None:
                places = rng.integers(n, size=(len(episodes), n_asked))
            queries = torch.from_numpy(np.take_along_axis(points, places[..., None], 1))
            probability, distance, spread = expected(policy.decode(known, queries))
            values = (probability * (distance + optimism * spread)).numpy()
            values = values + noise * rng.gumbel(size=values.shape) if noise else values
            for one, drawn, value in zip(episodes, places, values, strict=True):
                value[np.isin(drawn, one.performed)] = -np.inf
                one.perform(int(drawn[value.argmax()]))
