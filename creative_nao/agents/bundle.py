"""The trained agents that come with the package, and finding a bundle by name or path.

Also here:
- Agent bundles: a trained policy in one file, safetensors weights with a JSON header. Nothing is unpickled.
- Play the recorded score of a bundle again.
"""

from __future__ import annotations

import dataclasses
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.algorithms import find_algorithm
from creative_nao.agents.play import Score, evaluate_policy
from creative_nao.agents.ppo import PPOSettings, build_policy, settings_from
from creative_nao.agents.settings import Hyperparameters, check_entry, nets_of, resolve_policy_kwargs
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.fields import Fields, shown
from creative_nao.runtime import versions
from creative_nao.schema import parse

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy


PRETRAINED = Path(__file__).parent / "pretrained"


def shipped_agents() -> tuple[str, ...]:
    """Return the names of the shipped agents, algorithm and environment: ``ppo/BoxingMental-v0``, ..."""
    return tuple(sorted(path.stem.replace("-", "/", 1) for path in PRETRAINED.glob("*-*.safetensors")))


def find_bundle(name: str | os.PathLike[str]) -> Path:
    """Return the path of a bundle.

    Args:
        name: A shipped name such as ``ppo/BoxingMental-v0``, or the path of a file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
    """
    text = os.fspath(name)
    names = shipped_agents()
    if text in names:
        return PRETRAINED / f"{text.replace('/', '-', 1)}.safetensors"
    if os.path.isfile(text):
        return Path(text)
    raise NotFoundError(
        f"no agent bundle file at {text}{nearest_name(text, names)}: neither a file nor a shipped name; "
        f"shipped are {', '.join(names) or 'none'}"
    )


KIND = "agent bundle"
FORMAT_VERSION = 1
MAX_VALUES = 10_000
"""Of an observation or an action."""
MAX_WEIGHT, MAX_LOG_STD = 1e6, 20.0
"""Largest weight, and logarithm of a standard deviation: exp(20) still is a number of float32, its square too."""
MAX_BOUND = 1e30
"""Largest bound of a space; float32 ends at 3e38."""


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
    if type(described.get("format_version")) is not int or described["format_version"] != FORMAT_VERSION:
        raise FileFormatError(
            f"agent bundle {path}: header part `format_version` should be {FORMAT_VERSION}, "
            f"but is {shown(described.get('format_version'))}"
        )
    header = _header(path, described)
    _check_sizes(path, header, arrays)
    weights = {name: torch.from_numpy(array) for name, array in arrays.items()}
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
        most = MAX_LOG_STD if name.endswith("log_std") else MAX_WEIGHT
        if found.is_floating_point() and found.numel() and float(found.abs().max()) > most:
            raise FileFormatError(f"agent bundle {path}: weights `{name}` should be at most {most:g}, but are not")
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
            if type(values[part]) is not kind:
                raise TypeError(f"should be {kind.__name__}, but is {shown(values[part])}")
            if kind is int and values[part] < 0:
                raise ValueError(f"should be at least 0, but is {values[part]}")
        for part in ("command", "machine"):
            values[part] = described.get(part, "")
            if not isinstance(values[part], str):
                raise TypeError(f"should be text, but is {shown(values[part])}")
        part = "versions"
        found = {str(name): str(value) for name, value in described[part].items()}
        part = "score"
        score = parse(Score, described[part], "it") if part in described else None
    except KeyError:
        raise FileFormatError(f"agent bundle {path}: header part `{part}` is missing or incomplete") from None
    except (CreativeNaoError, TypeError, ValueError, AttributeError, AssertionError, OverflowError) as error:
        raise FileFormatError(f"agent bundle {path}: header part `{part}`: {error}") from error
    return BundleHeader(
        settings=settings, observation_space=observation_space, action_space=action_space, versions=found, score=score,
        **values,
    )  # fmt: skip


def _check_sizes(path: Path, header: BundleHeader, arrays: dict[str, np.ndarray]) -> None:
    """Refuse a file whose weights do not have the sizes that its header declares, before a policy is built of them."""
    settings, where = header.settings, f"agent bundle {path}: header part `settings`"
    for name, array in arrays.items():
        if array.dtype.kind not in "fi":
            raise FileFormatError(
                f"agent bundle {path}: weights `{name[:60]}` should be numbers, but are {array.dtype}"
            )
    sizes = {size for array in arrays.values() for size in array.shape}
    if isinstance(settings, PPOSettings):
        declared = list(settings.hidden)
    else:
        declared = nets_of(settings.policy_kwargs.get("net_arch"), "`net_arch`").get("pi", [])
        named = ("lstm_hidden_size", "width")
        declared += [settings.policy_kwargs[name] for name in named if name in settings.policy_kwargs]
    for width in declared:
        if width not in sizes:
            raise FileFormatError(f"{where}: a layer of {width} units is declared, but no weights have that size")


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
    except Exception as error:  # whatever a class of another package says to settings out of a stranger's file
        raise FileFormatError(f"agent bundle {path}: header part `settings`: no policy can be made: {error}") from error


def _describe_box(space: Box) -> dict[str, Any]:
    return {
        "shape": list(space.shape),
        "dtype": str(space.dtype),
        "low": space.low.ravel().tolist(),
        "high": space.high.ravel().tolist(),
    }


def _read_box(described: Any) -> Box:
    found = Fields(described, "it")
    shape, dtype = found.listed("shape", most=1), found.text("dtype")
    if len(shape) != 1 or type(shape[0]) is not int or not 1 <= shape[0] <= MAX_VALUES:
        raise found.refuse("shape", f"one number from 1 to {MAX_VALUES}")
    if dtype != "float32":
        raise found.refuse("dtype", "float32")
    sides = []
    for name in ("low", "high"):
        side = found.listed(name, most=shape[0])
        if len(side) != shape[0] or any(type(one) not in (int, float) or not abs(one) <= MAX_BOUND for one in side):
            raise found.refuse(name, f"{shape[0]} numbers of at most {MAX_BOUND:g}")
        sides.append(np.array(side, dtype=np.float32))
    if not (sides[0] < sides[1]).all():
        raise ValueError("`low` should be below `high`, but is not")
    return Box(*sides, dtype=np.float32)


def replay(trained: TrainedPolicy, progress: Callable[[int], None] | None = None) -> Score:
    """Return the score that the bundle reaches now; it equals `trained.header.score` on the machine that recorded it.

    Raises:
        SettingsError: If the bundle records no score.
    """
    recorded = trained.header.score
    if recorded is None:
        raise SettingsError("this bundle records no score to replay; agents trained with `creative-nao agent train` do")
    return evaluate_policy(
        trained, recorded.env, recorded.memories, recorded.seeds, recorded.deterministic, progress=progress
    )


def machine() -> str:
    """Return what decides how torch rounds: the kind of processor and the instructions that it uses."""
    import torch

    return f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}"
