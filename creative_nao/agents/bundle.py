"""Agent bundles: a trained policy in one file, safetensors weights with a JSON header; and those that ship.

Nothing is unpickled or imported because a file names it.
"""

from __future__ import annotations

import dataclasses
import math
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from gymnasium.spaces import Box
from pydantic import BeforeValidator

from creative_nao.agents.play import Score, evaluate_policy, told_track
from creative_nao.agents.settings import Hyperparameters, check_entry, find_algorithm, nets_of
from creative_nao.agents.training import PPOSettings
from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take
from creative_nao.envs import Track
from creative_nao.errors import (
    CreativeNaoError,
    FileFormatError,
    MissingDependencyError,
    NotFoundError,
    SettingsError,
    nearest_name,
    shown,
)
from creative_nao.model.config import check_kind
from creative_nao.runtime import versions
from creative_nao.schema import Field, Index, LongText, Version1, Versions, parse, record

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy

PRETRAINED = Path(__file__).parent / "pretrained"
KIND = "agent bundle"
MAX_VALUES = 10_000
"""Of an observation or an action."""
MAX_WEIGHT, MAX_LOG_STD = 1e6, 20.0
"""Largest weight, and logarithm of a standard deviation: exp(20) still is a number of float32, its square too."""
_Bound = Annotated[float, Field(ge=-1e30, le=1e30)]  # float32 ends at 3e38
_Side = Annotated[tuple[_Bound, ...], Field(max_length=MAX_VALUES)]


def shipped_agents() -> tuple[str, ...]:
    """Return the names of the shipped agents, algorithm and environment: ``ppo/BoxingMental-v0``, ..."""
    return tuple(sorted(path.stem.replace("-", "/", 1) for path in PRETRAINED.glob("*-*.safetensors")))


def find_bundle(name: str | os.PathLike[str]) -> Path:
    """Return the path of a bundle, given by a shipped name or its path; a `NotFoundError` offers the nearest name."""
    if not isinstance(name, str | os.PathLike):
        raise SettingsError(f"a bundle should be a shipped name or a path, but is {shown(name)}")
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


@record
class _BoxRecord:
    """A space in a header."""

    shape: tuple[Annotated[int, Field(ge=1, le=MAX_VALUES)]]
    dtype: Literal["float32"]
    low: _Side
    high: _Side

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == self.shape[0]:
            raise SettingsError(f"`low` and `high` should hold {self.shape[0]} numbers each")
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise SettingsError("`low` should be below `high`, but is not")


def _as_box(value: Any) -> Box:
    if isinstance(value, Box):
        return value
    if not isinstance(value, dict):
        raise ValueError("a JSON object")
    sides = _BoxRecord(**value)
    return Box(np.array(sides.low, np.float32), np.array(sides.high, np.float32), dtype=np.float32)


def _describe_box(space: Box) -> dict[str, Any]:
    low, high = space.low.ravel().tolist(), space.high.ravel().tolist()
    return {"shape": list(space.shape), "dtype": str(space.dtype), "low": low, "high": high}


_Space = Annotated[Any, BeforeValidator(_as_box)]


@record(closed=False)
class BundleHeader:
    """What a bundle says of itself."""

    agent: LongText
    settings: PPOSettings | Hyperparameters
    env: LongText
    """Environment it was trained on."""
    memory: LongText
    """Memory it was trained on."""
    seed: Index
    n_actions_training: Index
    """Actions generated in training."""
    observation_space: _Space
    action_space: _Space
    versions: Versions = dataclasses.field(default_factory=versions)
    """Python and packages that trained it."""
    command: LongText = ""
    """The command that trains it again."""
    score: Score | None = None
    """The score it was recorded with; `replay` plays it again."""
    machine: LongText = ""
    """Kind of processor and instructions that the score was played with; others may round a last bit differently."""

    @property
    def deterministic(self) -> bool:
        """Whether its most likely actions are played, or drawn ones."""
        if isinstance(self.settings, PPOSettings):
            return self.settings.deterministic
        return self.score is None or self.score.deterministic

    @property
    def hyperparameters(self) -> Hyperparameters:
        """How it was trained, in the format of all algorithms."""
        return self.settings.as_hyperparameters() if isinstance(self.settings, PPOSettings) else self.settings

    @property
    def acting(self) -> str:
        """Prefix of the weights that choosing actions needs; empty where the file holds the whole policy."""
        return "" if isinstance(self.settings, PPOSettings) else find_algorithm(self.settings.algorithm).acting

    def make_policy(self) -> BasePolicy:
        """Return the untrained policy network that it describes."""
        chosen = self.hyperparameters
        return find_algorithm(chosen.algorithm).policy_class(chosen.policy)(
            self.observation_space, self.action_space, lambda _: 0.0, **chosen.sb3_policy_kwargs()
        )


@record(closed=False)
class _Versioned:
    format_version: Version1


class TrainedPolicy:
    """A policy read from a bundle, with the `predict` of Stable-Baselines3."""

    def __init__(self, header: BundleHeader, policy: BasePolicy):
        self.header = header
        self.policy = policy

    def __repr__(self) -> str:
        header = self.header
        score = "" if header.score is None else f", recorded reward {header.score.mean:.2f}"
        way = "most likely" if header.deterministic else "drawn"
        made = f"{header.n_actions_training} training actions{score}"
        return f"<trained {header.agent} for {header.env}, {made}, plays {way} actions>"

    @property
    def judged_deterministic(self) -> bool:
        """Whether it was judged by its most likely actions, or by drawn ones."""
        return self.header.deterministic

    @property
    def track(self) -> Track:
        """What its observations tell: those of -v0 outcomes alone, later ones what it was trained with."""
        return told_track(self.header.env, self.header.hyperparameters.env_kwargs)

    @property
    def observation_space(self) -> Box:
        """What it observes."""
        return self.header.observation_space

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool | None = None
    ) -> tuple[np.ndarray, Any]:
        """Return actions for observations.

        Args:
            observation: Shape (n_values,) or (n, n_values).
            state: That of a recurrent policy; handed back.
            episode_start: Shape (n,); where True a recurrent policy forgets its state.
            deterministic: Its most likely actions, or drawn ones; None plays the way it was judged.

        Returns:
            Actions of shape (n_pb,) or (n, n_pb), and `state`.
        """
        way = self.judged_deterministic if deterministic is None else deterministic
        return self.policy.predict(observation, state, episode_start, way)


def save_bundle(path: str | Path, header: BundleHeader, policy: BasePolicy) -> Path:
    """Write a policy and its header to `path` in one step and return the path."""
    settings = check_kind(header, BundleHeader, "header").settings
    described: dict[str, Any] = {"format_version": 1, "agent": header.agent}
    if isinstance(settings, PPOSettings):
        described |= {"settings": dataclasses.asdict(settings)}
    else:
        described |= {"algorithm": settings.algorithm, "settings": settings.as_zoo()}
    described |= {name: getattr(header, name) for name in ("env", "memory", "seed", "n_actions_training")}
    described |= {name: _describe_box(getattr(header, name)) for name in ("observation_space", "action_space")}
    described |= {"normalisation": None, "versions": header.versions}  # observations already lie in [-1, 1]
    if header.score is not None:
        described |= {"command": header.command, "machine": header.machine, "score": header.score.as_json()}
    weights = {name: tensor.detach().cpu().numpy() for name, tensor in _weights_of(policy, header).items()}
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
    path = find_bundle(path)
    described, arrays = load_tensors(path, kind=KIND)
    where = f"agent bundle {path}"
    header = _header(f"{where}: header", described)
    _check_sizes(path, header, arrays)
    try:
        policy = header.make_policy()
    except MissingDependencyError:
        raise
    except Exception as error:  # whatever a class of another package says to settings out of a stranger's file
        raise FileFormatError(f"{where}: header: `settings`: no policy can be made: {error}") from error
    expected = _weights_of(policy, header)
    only_arrays(where, arrays, expected)
    for name, tensor in expected.items():
        dtype = np.dtype(str(tensor.dtype).removeprefix("torch."))
        most = math.inf if dtype.kind != "f" else MAX_LOG_STD if name.endswith("log_std") else MAX_WEIGHT
        take(where, arrays, name, tuple(tensor.shape), dtype.type, kinds="fiu", least=-most, most=most)
    import torch

    weights = {name: torch.from_numpy(array) for name, array in arrays.items()}
    policy.load_state_dict(weights, strict=not header.acting)  # critics are of no use for acting, and not in the file
    policy.set_training_mode(False)
    return TrainedPolicy(header, policy)


load_agent = load_bundle


def _header(where: str, described: dict[str, Any]) -> BundleHeader:
    parse(_Versioned, described, where)
    values = {"versions": None, **described}
    if "settings" in values:
        try:
            if "algorithm" in values:
                values["settings"] = check_entry(str(values["algorithm"]), values["settings"], "`settings`")
            else:
                values["settings"] = parse(PPOSettings, values["settings"], "`settings`")
        except MissingDependencyError:
            raise
        except CreativeNaoError as error:
            raise FileFormatError(f"{where}: {error}") from error
    return parse(BundleHeader, values, where)


def _weights_of(policy: BasePolicy, header: BundleHeader) -> dict[str, Any]:
    return {name: tensor for name, tensor in policy.state_dict().items() if name.startswith(header.acting)}


def _check_sizes(path: Path, header: BundleHeader, arrays: dict[str, np.ndarray]) -> None:
    """Refuse a file whose weights do not have the sizes that its header declares, before a policy is built of them."""
    for name, array in arrays.items():
        if array.dtype.kind not in "fi":
            raise FileFormatError(
                f"agent bundle {path}: weights `{name[:60]}` should be numbers, but are {array.dtype}"
            )
    sizes = {size for array in arrays.values() for size in array.shape}
    declared = header.hyperparameters.policy_kwargs
    widths = [*nets_of(declared.get("net_arch")).get("pi", ())]
    for width in [*widths, *(declared[name] for name in ("lstm_hidden_size", "width") if name in declared)]:
        if width not in sizes:
            raise FileFormatError(
                f"agent bundle {path}: header: `settings`: a layer of {width} units is declared, but no weights have "
                "that size"
            )


def replay(trained: TrainedPolicy, progress: Callable[[int], None] | None = None) -> Score:
    """Return the score of the bundle now; it equals `trained.header.score` on the machine that recorded it."""
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
