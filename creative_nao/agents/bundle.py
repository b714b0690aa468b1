"""Agent bundles: a trained policy in one file, safetensors weights with a JSON header. Nothing is unpickled.

The header says what made the policy: agent, settings, environment, memory, seed, spaces and versions. A bundle loaded
again predicts the same bits.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.ppo import PPOSettings, build_policy, settings_from
from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.provenance import versions
from creative_nao.tensorfile import load_tensors, save_tensors

if TYPE_CHECKING:
    from stable_baselines3.common.policies import ActorCriticPolicy

KIND = "agent bundle"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class BundleHeader:
    """What a bundle says of itself."""

    agent: str
    settings: PPOSettings
    env: str
    """Environment it was trained on."""
    memory: str
    """Memory it was trained on."""
    seed: int
    n_actions_training: int
    """Actions generated in training."""
    observation_space: Box
    action_space: Box
    versions: dict[str, str] = dataclasses.field(default_factory=versions)
    """Python and packages that trained it."""


class TrainedPolicy:
    """A policy read from a bundle, with the `predict` of Stable-Baselines3."""

    def __init__(self, header: BundleHeader, policy: ActorCriticPolicy):
        self.header = header
        self.policy = policy

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions, shape (2,) or (n, 2), for observations of shape (n_values,) or (n, n_values), and `state`."""
        return self.policy.predict(observation, state, episode_start, deterministic)


def save_bundle(path: str | Path, header: BundleHeader, policy: ActorCriticPolicy) -> Path:
    """Write a policy and its header to `path` in one step and return the path."""
    weights = {name: tensor.detach().cpu().numpy() for name, tensor in policy.state_dict().items()}
    described = {
        "format_version": FORMAT_VERSION,
        "agent": header.agent,
        "settings": dataclasses.asdict(header.settings),
        "env": header.env,
        "memory": header.memory,
        "seed": header.seed,
        "n_actions_training": header.n_actions_training,
        "observation_space": _describe_box(header.observation_space),
        "action_space": _describe_box(header.action_space),
        "normalisation": None,  # observations already lie in [-1, 1]
        "versions": header.versions,
    }
    return save_tensors(path, kind=KIND, header=described, tensors=weights)


def load_bundle(path: str | Path) -> TrainedPolicy:
    """Read an agent bundle.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If a part of it is damaged or missing; the message names the part.
    """
    import torch

    path = Path(path)
    described, arrays = load_tensors(path, kind=KIND)
    if described.get("format_version") != FORMAT_VERSION:
        raise FileFormatError(
            f"agent bundle {path}: header part `format_version` should be {FORMAT_VERSION}, "
            f"but is {described.get('format_version')!r}"
        )
    weights = {name: torch.from_numpy(array) for name, array in arrays.items()}
    header = _header(path, described)
    policy = build_policy(header.observation_space, header.action_space, header.settings)
    expected_weights = policy.state_dict()
    for name, tensor in expected_weights.items():
        found = weights.get(name)
        if found is None:
            raise FileFormatError(f"agent bundle {path}: weights `{name}` are missing")
        if found.shape != tensor.shape or found.dtype != tensor.dtype:
            raise FileFormatError(
                f"agent bundle {path}: weights `{name}` should be {tensor.dtype} of shape {tuple(tensor.shape)}, "
                f"but are {found.dtype} of shape {tuple(found.shape)}"
            )
        if not bool(found.isfinite().all()):
            raise FileFormatError(f"agent bundle {path}: weights `{name}` hold values that are not finite")
    if extra := sorted(set(weights) - set(expected_weights)):
        raise FileFormatError(f"agent bundle {path}: weights `{extra[0]}` belong to no part of the policy")
    policy.load_state_dict(weights)
    policy.set_training_mode(False)
    return TrainedPolicy(header, policy)


def _header(path: Path, described: dict[str, Any]) -> BundleHeader:
    part = "settings"
    try:
        settings = settings_from(described["settings"])
        part = "observation_space"
        observation_space = _read_box(described[part])
        part = "action_space"
        action_space = _read_box(described[part])
        values: dict[str, Any] = {}
        for part, kind in (("agent", str), ("env", str), ("memory", str), ("seed", int), ("n_actions_training", int)):
            values[part] = described[part]
            if not isinstance(values[part], kind):
                raise TypeError(f"should be {kind.__name__}, but is {values[part]!r}")
        part = "versions"
        found = {str(name): str(value) for name, value in described[part].items()}
    except KeyError:
        raise FileFormatError(f"agent bundle {path}: header part `{part}` is missing or incomplete") from None
    except (CreativeNaoError, TypeError, ValueError, AttributeError, AssertionError) as error:
        raise FileFormatError(f"agent bundle {path}: header part `{part}`: {error}") from error
    return BundleHeader(
        settings=settings, observation_space=observation_space, action_space=action_space, versions=found, **values
    )


def _describe_box(space: Box) -> dict[str, Any]:
    return {
        "shape": list(space.shape),
        "dtype": str(space.dtype),
        "low": space.low.ravel().tolist(),
        "high": space.high.ravel().tolist(),
    }


def _read_box(described: dict[str, Any]) -> Box:
    shape, dtype = tuple(described["shape"]), np.dtype(described["dtype"])
    low = np.array(described["low"], dtype=dtype).reshape(shape)
    high = np.array(described["high"], dtype=dtype).reshape(shape)
    return Box(low, high, dtype=dtype.type)
