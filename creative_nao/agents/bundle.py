"""Agent bundles: a trained policy in one file, safetensors weights with a JSON header. Nothing is unpickled.

The header says what made the policy: agent, settings, environment, memory, seed, spaces and versions, and where one was
played, its score with every episode. A bundle loaded again predicts the same bits. No statistics of observations are
kept beside the weights: observations already lie in [-1, 1].
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.algorithms import find_algorithm
from creative_nao.agents.hyperparameters import Hyperparameters, check_entry, resolve_policy_kwargs
from creative_nao.agents.judging import Score
from creative_nao.agents.ppo import PPOSettings, build_policy, settings_from
from creative_nao.agents.shipped import find_bundle
from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.provenance import versions
from creative_nao.tensorfile import load_tensors, save_tensors

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy

KIND = "agent bundle"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class BundleHeader:
    """What a bundle says of itself."""

    agent: str
    settings: PPOSettings | Hyperparameters
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
    command: str = ""
    """The command that trains it again."""
    score: Score | None = None
    """The score it was recorded with; `replay` plays it again."""
    machine: str = ""
    """Kind of processor and instructions that the score was played with; others may round a last bit differently."""

    @property
    def deterministic(self) -> bool:
        """Whether its most likely actions are played, or drawn ones."""
        if isinstance(self.settings, PPOSettings):
            return self.settings.deterministic
        return self.score is None or self.score.deterministic


class TrainedPolicy:
    """A policy read from a bundle, with the `predict` of Stable-Baselines3."""

    def __init__(self, header: BundleHeader, policy: BasePolicy):
        self.header = header
        self.policy = policy

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions, shape (2,) or (n, 2), for observations of shape (n_values,) or (n, n_values), and `state`."""
        return self.policy.predict(observation, state, episode_start, deterministic)


def save_bundle(path: str | Path, header: BundleHeader, policy: BasePolicy) -> Path:
    """Write a policy and its header to `path` in one step and return the path."""
    acting = _acting(header.settings)
    weights = {
        name: tensor.detach().cpu().numpy() for name, tensor in policy.state_dict().items() if name.startswith(acting)
    }
    described = {
        "format_version": FORMAT_VERSION,
        "agent": header.agent,
        **_describe_settings(header.settings),
        "env": header.env,
        "memory": header.memory,
        "seed": header.seed,
        "n_actions_training": header.n_actions_training,
        "observation_space": _describe_box(header.observation_space),
        "action_space": _describe_box(header.action_space),
        "normalisation": None,  # observations already lie in [-1, 1]
        "versions": header.versions,
    }
    if header.score is not None:
        described |= {"command": header.command, "machine": header.machine, "score": header.score.as_json()}
    return save_tensors(path, kind=KIND, header=described, tensors=weights)


def load_bundle(path: str | Path) -> TrainedPolicy:
    """Read an agent bundle.

    Args:
        path: A shipped name such as ``ppo/BoxingMental-v0``, or the path of a file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
        FileFormatError: If a part of it is damaged or missing; the message names the part.
        MissingDependencyError: If its algorithm needs a package that is not installed.
    """
    import torch

    path = find_bundle(path)
    described, arrays = load_tensors(path, kind=KIND)
    if described.get("format_version") != FORMAT_VERSION:
        raise FileFormatError(
            f"agent bundle {path}: header part `format_version` should be {FORMAT_VERSION}, "
            f"but is {described.get('format_version')!r}"
        )
    weights = {name: torch.from_numpy(array) for name, array in arrays.items()}
    header = _header(path, described)
    policy = _build(path, header)
    acting = _acting(header.settings)
    expected_weights = {name: tensor for name, tensor in policy.state_dict().items() if name.startswith(acting)}
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
    policy.load_state_dict(weights, strict=not acting)  # critics are of no use for acting, and not in the file
    policy.set_training_mode(False)
    return TrainedPolicy(header, policy)


def _header(path: Path, described: dict[str, Any]) -> BundleHeader:
    part = "settings"
    try:
        settings = _read_settings(described)
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
        part = "score"
        score = Score.from_json(described[part]) if part in described else None
    except KeyError:
        raise FileFormatError(f"agent bundle {path}: header part `{part}` is missing or incomplete") from None
    except (CreativeNaoError, TypeError, ValueError, AttributeError, AssertionError) as error:
        raise FileFormatError(f"agent bundle {path}: header part `{part}`: {error}") from error
    return BundleHeader(
        settings=settings, observation_space=observation_space, action_space=action_space, versions=found, score=score,
        command=str(described.get("command", "")), machine=str(described.get("machine", "")), **values,
    )  # fmt: skip


def _describe_settings(settings: PPOSettings | Hyperparameters) -> dict[str, Any]:
    if isinstance(settings, PPOSettings):
        return {"settings": dataclasses.asdict(settings)}
    return {"algorithm": settings.algorithm, "settings": settings.as_zoo()}


def _read_settings(described: dict[str, Any]) -> PPOSettings | Hyperparameters:
    if "algorithm" in described:
        return check_entry(str(described["algorithm"]), described["settings"], "settings")
    return settings_from(described["settings"])


def _acting(settings: PPOSettings | Hyperparameters) -> str:
    """Return the prefix of the weights that choosing actions needs; empty for all."""
    return "" if isinstance(settings, PPOSettings) else find_algorithm(settings.algorithm).acting


def _build(path: Path, header: BundleHeader) -> Any:
    """Make the untrained policy that the header describes."""
    settings = header.settings
    if isinstance(settings, PPOSettings):
        return build_policy(header.observation_space, header.action_space, settings)
    policy_class = find_algorithm(settings.algorithm).policy_class(settings.policy)
    try:
        return policy_class(
            header.observation_space,
            header.action_space,
            lambda _: 0.0,
            **resolve_policy_kwargs(settings.policy_kwargs),
        )
    except (TypeError, ValueError, AssertionError, RuntimeError) as error:
        raise FileFormatError(f"agent bundle {path}: header part `settings`: no policy can be made: {error}") from error


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
