"""The softmax code in which the network reads and writes joint angles (Eq. 6 and 7)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.model.config import NetworkSettings

MIN_SPAN_RAD = 1e-9  # a joint that moves less is still: all its references are the one angle that it keeps
TARGET_FLOOR = 1e-12  # smallest target probability, so that its logarithm is finite


class SoftmaxEncoding:
    """Each joint is a population of `n_units` softmax units with evenly spaced reference angles.

    The references of a joint run from its smallest to its largest angle in the demonstrations. `sigma` is in units of
    the squared spacing of those references (docs/decisions.md says why) or, with ``sigma_unit="rad2"``, in rad^2. The
    code is lossy near the ends of the range: with ten units and sigma 0.5, the end of a 2 rad range decodes 0.03 rad
    short. A joint that never moves has one angle as every reference: its code is even, and it decodes to that angle.

    Args:
        low, high: Smallest and largest angle of each joint [rad], shape (n_joints,).
        n_units, sigma, sigma_unit: As `n_softmax_units`, `sigma` and `sigma_unit` of `NetworkSettings`.

    Raises:
        SettingsError: If `low` and `high` do not fit.

    Example:
        >>> encoding = SoftmaxEncoding(low=[-1.0], high=[1.0], n_units=3, sigma=0.5)
        >>> encoding.encode(np.array([0.0])).round(3)
        array([0.107, 0.787, 0.107])
        >>> encoding.decode(encoding.encode(np.array([0.25]))).round(3)
        array([0.224])
    """

    def __init__(
        self,
        low: np.ndarray | list[float],
        high: np.ndarray | list[float],
        n_units: int = 10,
        sigma: float = 0.5,
        sigma_unit: Literal["spacing2", "rad2"] = "spacing2",
    ) -> None:
        self.low = np.asarray(low, dtype=np.float64)
        self.high = np.asarray(high, dtype=np.float64)
        if self.low.ndim != 1 or self.low.shape != self.high.shape:
            raise SettingsError(
                f"`low` and `high` should both have shape (n_joints,), but have {self.low.shape} and {self.high.shape}"
            )
        if not (self.high >= self.low).all():
            raise SettingsError("`high` should be at least `low` for each joint, but is not")
        self.n_units = n_units
        still = self.high - self.low <= MIN_SPAN_RAD
        low, high = (np.where(still, (self.low + self.high) / 2, end) for end in (self.low, self.high))
        self.references = np.linspace(low, high, n_units, axis=1)  # (n_joints, n_units)
        spacing = self.references[:, 1] - self.references[:, 0]
        self._width = sigma * spacing**2 if sigma_unit == "spacing2" else np.full_like(spacing, sigma)
        self._width[still] = 1.0  # every unit of such a joint has the same reference, so its code is even

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.low)

    @property
    def n_codes(self) -> int:
        """Length of the code of one posture: n_joints * n_units."""
        return self.references.size

    def encode(self, angles: np.ndarray) -> np.ndarray:
        """Turn joint angles into the softmax code the network reads (Eq. 6).

        Args:
            angles: Joint angles [rad], shape (..., n_joints).

        Returns:
            Shape (..., n_joints * n_units), joint by joint; each group is non-negative and sums to 1. Angles whose
            last axis has another length are a ShapeError.
        """
        angles = np.asarray(angles, dtype=np.float64)
        if angles.ndim < 1 or angles.shape[-1] != self.n_joints:
            raise ShapeError(f"`angles` should have shape (..., {self.n_joints}), but has {angles.shape}")
        exponent = -((self.references - angles[..., None]) ** 2) / self._width[:, None]
        code = np.exp(exponent - exponent.max(axis=-1, keepdims=True))
        code /= code.sum(axis=-1, keepdims=True)
        return code.reshape(*angles.shape[:-1], self.n_codes)

    def decode(self, codes: np.ndarray) -> np.ndarray:
        """Turn softmax codes back into joint angles [rad] (Eq. 7): shape (..., n_codes) into (..., n_joints).

        Codes whose last axis has another length are a ShapeError.
        """
        codes = np.asarray(codes)
        if codes.ndim < 1 or codes.shape[-1] != self.n_codes:
            raise ShapeError(f"`codes` should have shape (..., {self.n_codes}), but has {codes.shape}")
        grouped = codes.reshape(*codes.shape[:-1], self.n_joints, self.n_units)
        return (grouped * self.references).sum(axis=-1)


def encoding_of(demonstrations: Demonstrations, network: NetworkSettings) -> SoftmaxEncoding:
    """Return the softmax code whose references span each joint's range in the demonstrations (Eq. 6).

    Demonstrations in which no joint moves are a SettingsError.
    """
    angles = np.concatenate(demonstrations.trajectories)
    if not (np.ptp(angles, axis=0) > MIN_SPAN_RAD).any():
        raise SettingsError(f"the demonstrations should move, but {', '.join(demonstrations.joints)} never moves")
    return SoftmaxEncoding(
        angles.min(axis=0), angles.max(axis=0), network.n_softmax_units, network.sigma, network.sigma_unit
    )


def target_codes(
    encoding: SoftmaxEncoding,
    trajectories: list[np.ndarray],
    first_input: Literal["own", "mean"] = "own",
    ending: Literal["free", "held"] = "free",
) -> tuple[np.ndarray, np.ndarray]:
    """Encode actions of any lengths, each (n_steps, n_joints) [rad], for training.

    Args:
        encoding: The code.
        trajectories: The actions.
        first_input, ending: As in `TrainingSettings`.

    Returns:
        Codes, shape (n_actions, longest, n_codes) float32, the rows past an action's end filled with its last posture;
        and the number of steps that count, shape (n_actions,).
    """
    lengths = np.array([len(trajectory) for trajectory in trajectories])
    codes = np.array([
        encoding.encode(np.pad(trajectory, [(0, lengths.max() - len(trajectory)), (0, 0)], mode="edge"))
        for trajectory in trajectories
    ])  # fmt: skip
    if first_input == "mean":  # row 0 is read and never predicted
        codes[:, 0] = encoding.encode(np.mean([trajectory[0] for trajectory in trajectories], axis=0))
    if ending == "held":
        lengths[:] = lengths.max()
    return np.maximum(codes, TARGET_FLOOR).astype(np.float32), lengths
