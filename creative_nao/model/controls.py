"""Controls: memories without a recurrent network, behind the same interface, that tell what the network adds.

All are made from the basic actions alone, brought to one duration (the first ticks together and the last ones), and
generate a movement from every point of the PB space; between the actions they blend:

- `interpolation`: postures and durations, weighted by the inverse squared distance of the point to the actions' own
  PB points, those of a trained memory (Shepard 1968). An action's own point gives the action.
- `splines`: the same for each joint by itself. Every joint is a cubic spline, and measures distance in the PB space by
  a metric of its own, so that at one point the joints follow different actions.
- `vae`: a variational autoencoder (Kingma and Welling 2014) over whole trajectories with as many latent values as the
  PB space has; where the actions lie is its own choice.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import SettingsError, shown
from creative_nao.model.config import check_kind
from creative_nao.model.generation import pb_points
from creative_nao.model.memory import Memory
from creative_nao.schema import Count, checked

ControlKind = Literal["interpolation", "splines", "vae"]
CONTROLS: tuple[ControlKind, ...] = ("interpolation", "splines", "vae")
TICKS_A_KNOT = 2  # of a spline: a knot every second tick of the longest action
STRETCH = 3.0  # how much longer a joint's own direction of the PB space is to it than the one across
HIDDEN, N_STEPS, LEARNING_RATE, KL_WEIGHT = 32, 3000, 5e-3, 0.02  # of the autoencoder: units, Adam's steps, beta
LATENT_EDGE = 2.0  # the latent value at the edge of the PB space, at least: two standard deviations of the prior


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ControlMemory:
    """A memory that mixes its basic actions; make one with `control_memory`.

    Attributes:
        control: Which control it is.
        demonstrations: Its basic actions.
        pb: PB value of each, shape (n_actions, n_pb) in [-1, 1].
        weights: The decoder of `vae`: weights and biases of its two layers, and the latent value at the edge of the PB
            space; empty for the others.
        name: What it is called in results.
    """

    control: ControlKind
    demonstrations: Demonstrations
    pb: np.ndarray
    weights: tuple[np.ndarray, ...] = ()
    name: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Name of each joint."""
        return self.demonstrations.joints

    @property
    def dt_s(self) -> float:
        """Time from one posture to the next [s]."""
        return self.demonstrations.dt_s

    @property
    def n_steps(self) -> int:
        """Ticks of the longest basic action."""
        return max(map(len, self.demonstrations.trajectories))

    @functools.cached_property
    def _curves(self) -> np.ndarray:
        return aligned(self.demonstrations, smooth=self.control == "splines")

    def generate(self, pb: ArrayLike, n_steps: int | None = None) -> np.ndarray:
        """Return a movement from each PB point (n, n_pb) [rad], (n, n_steps, n_joints); the errors of `Memory`.

        Row 0 is the mean first posture of the basic actions; past its end a movement stays in its last posture.
        """
        points = pb_points(pb, self.pb.shape[1], "pb")
        n_ticks = self.n_steps if n_steps is None else checked(Count, n_steps, "n_steps")
        out = np.empty((len(points), n_ticks, len(self.joints)))
        for place, point in enumerate(points):  # one at a time: the same bits alone and in any batch
            curve, duration = self._decode(point) if self.control == "vae" else self._blend(point)
            at = np.minimum(np.arange(n_ticks) / duration, 1.0) * (len(curve) - 1)
            before = np.minimum(at.astype(int), len(curve) - 2)
            share = (at - before)[:, None]
            out[place] = curve[before] * (1.0 - share) + curve[before + 1] * share
        out[:, 0] = self.demonstrations.initial_posture
        return out

    def _blend(self, point: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the blended curve at a point, (n_phases, n_joints), and its duration [ticks]."""
        gaps = self.pb - point
        durations = np.array([len(one) - 1.0 for one in self.demonstrations.trajectories])
        overall = _shares((gaps**2).sum(axis=1))
        if self.control == "interpolation":
            return np.tensordot(overall, self._curves, 1), float(overall @ durations)
        n_joints, n_pb = len(self.joints), self.pb.shape[1]
        angle = np.pi * np.arange(n_joints) / n_joints
        own = np.zeros((n_joints, n_pb))  # the direction of the PB space that counts more to each joint
        own[:, 0], own[:, 1 % n_pb] = np.cos(angle), np.sin(angle)
        squared = (gaps**2).sum(axis=1) + (STRETCH**2 - 1.0) * (own @ gaps.T) ** 2  # (n_joints, n_actions)
        shares = np.array([_shares(row) for row in squared])
        return np.einsum("ja,atj->tj", shares, self._curves), float(overall @ durations)

    def _decode(self, point: np.ndarray) -> tuple[np.ndarray, float]:
        w1, b1, w2, b2, edge = self.weights
        told = w2 @ np.tanh(w1 @ (point * edge) + b1) + b2
        low, high = (bound(np.concatenate(self.demonstrations.trajectories), axis=0) for bound in (np.min, np.max))
        curve = np.clip(told[:-1].reshape(-1, len(self.joints)), low, high)
        return curve, float(np.clip(told[-1], 1.0, self.n_steps - 1.0))

    def __repr__(self) -> str:
        return f"ControlMemory({self.control}: {self.demonstrations.n_actions} actions of {len(self.joints)} joints)"


def control_memory(memory: Memory, control: ControlKind, seed: int = 0) -> ControlMemory:
    """Return a control of a trained memory: the same basic actions, and for blends the same PB points.

    Args:
        memory: The memory.
        control: `interpolation`, `splines` or `vae`.
        seed: Of the autoencoder's initial weights and noise; the blends have nothing random.
    """
    check_kind(memory, Memory, "memory")
    if control not in CONTROLS:
        raise SettingsError(f"`control` should be one of {', '.join(CONTROLS)}, but is {shown(control)}")
    demos, name = memory.demonstrations, f"{control} of {memory.name}"
    if control == "vae":
        return ControlMemory(control, demos, *train_autoencoder(demos, memory.network.n_pb, seed), name)
    return ControlMemory(control, demos, memory.pb, name=name)


def aligned(demonstrations: Demonstrations, *, smooth: bool = False) -> np.ndarray:
    """Return the basic actions at as many phases, from beginning to end, as the longest has ticks.

    Shape (n_actions, n_phases, n_joints) [rad]. A shorter one is read between its ticks by a cubic spline; `smooth`
    keeps of all of them the spline through every second phase.
    """
    phases = np.linspace(0.0, 1.0, max(map(len, demonstrations.trajectories)))
    curves = [
        one if len(one) == len(phases) else CubicSpline(np.linspace(0.0, 1.0, len(one)), one)(phases)
        for one in demonstrations.trajectories
    ]
    if not smooth:
        return np.array(curves)
    knots = np.linspace(0.0, 1.0, max(4, 1 + len(phases) // TICKS_A_KNOT))
    return np.array([CubicSpline(knots, CubicSpline(phases, curve)(knots))(phases) for curve in curves])


def _shares(squared: np.ndarray) -> np.ndarray:
    """Return the shares of the actions at squared distances, (n_actions,), inverse to them; at an action it has all."""
    near = 1.0 / np.maximum(squared, 1e-12)
    return near / near.sum()


def train_autoencoder(
    demonstrations: Demonstrations, n_latent: int, seed: int
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Train the autoencoder on all actions at once; return their PB values and `weights` of its decoder."""
    rng = np.random.default_rng([seed, n_latent])
    curves = aligned(demonstrations)
    durations = [[len(one) - 1.0] for one in demonstrations.trajectories]
    told = np.concatenate([curves.reshape(len(curves), -1), durations], axis=1)
    mean = told.mean(axis=0)
    scale = np.full(told.shape[1], max((told - mean)[:, :-1].std(), 1e-9))
    scale[-1] = max((told - mean)[:, -1].std(), 1e-9)
    data = (told - mean) / scale
    sizes = ((HIDDEN, told.shape[1]), (2 * n_latent, HIDDEN), (HIDDEN, n_latent), (told.shape[1], HIDDEN))
    layers = [value for size in sizes for value in (rng.normal(0.0, size[1] ** -0.5, size), np.zeros(size[0]))]
    first, second = ([np.zeros_like(value) for value in layers] for _ in range(2))  # moments of Adam
    for step in range(1, N_STEPS + 1):
        for value, slope, m, v in zip(layers, _slopes(layers, data, rng), first, second, strict=True):
            m += 0.1 * (slope - m)
            v += 0.001 * (slope**2 - v)
            value -= LEARNING_RATE * (m / (1 - 0.9**step)) / (np.sqrt(v / (1 - 0.999**step)) + 1e-8)
    centre = _encode(layers, data)[1][:, :n_latent]
    w1, b1, w2, b2 = layers[4:]
    edge = np.array(max(LATENT_EDGE, 1.1 * np.abs(centre).max()))
    return centre / edge, (w1, b1, w2 * scale[:, None], b2 * scale + mean, edge)


def _encode(layers: list[np.ndarray], data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the activity of the encoder's hidden units, and the means and logarithms of variance of the latent."""
    w1, b1, w2, b2 = layers[:4]
    hidden = np.tanh(data @ w1.T + b1)
    return hidden, hidden @ w2.T + b2


def _slopes(layers: list[np.ndarray], data: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the derivatives of mean squared error plus weighted divergence from the prior, layer by layer."""
    hidden, latent = _encode(layers, data)
    centre, log_variance = np.split(latent, 2, axis=1)
    noise = rng.standard_normal(centre.shape) * np.exp(0.5 * log_variance)
    drawn = centre + noise
    w1, b1, w2, b2 = layers[4:]
    active = np.tanh(drawn @ w1.T + b1)
    d_told = 2.0 * (active @ w2.T + b2 - data) / data.size
    d_active = (d_told @ w2) * (1.0 - active**2)
    d_drawn = d_active @ w1
    weight = KL_WEIGHT / len(data)
    d_centre = d_drawn + weight * centre
    d_spread = 0.5 * (d_drawn * noise + weight * (np.exp(log_variance) - 1.0))
    d_latent = np.concatenate([d_centre, d_spread], axis=1)
    d_hidden = (d_latent @ layers[2]) * (1.0 - hidden**2)
    pairs = ((d_hidden, data), (d_latent, hidden), (d_active, drawn), (d_told, active))
    return [value for slope, below in pairs for value in (slope.T @ below, slope.sum(axis=0))]
