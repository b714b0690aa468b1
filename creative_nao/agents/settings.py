"""Hyperparameters in RL Zoo's format: one YAML file an algorithm, keyed by environment, checked before use.

RL Zoo evaluates text such as ``dict(net_arch=[64, 64])``. Here it is parsed, and only numbers, strings, truth values,
None, lists, tuples, dictionaries, `dict(...)`, `float("1e-3")` and the names of torch's activations are understood.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from creative_nao.agents.algorithms import ACTIVATIONS, Widths, check_policy_settings, find_algorithm, policy_name
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name, shown
from creative_nao.schema import Field, JsonObject, Positive, UnitInterval, checked, record
from creative_nao.storage import MAX_YAML_BYTES, as_yaml, read_text

FOLDER = Path(__file__).parent / "hyperparams"
AUGMENTATION = "creative_nao.agents.augmentation.FlippedSwappedAxes"
"""The one `vec_env_wrapper` there is, as RL Zoo reads it: training episodes with flipped and swapped PB axes."""
MAX_ROLLOUT = 10_000_000
"""Decisions of all copies between two updates; they are kept in memory."""
_OWN_KEYS = (
    "n_timesteps", "n_envs", "policy", "policy_kwargs", "env_kwargs", "normalize", "noise_type", "noise_std",
    "vec_env_wrapper",
)  # fmt: skip


def _plain(value: Any) -> Any:
    """Return a number written as text, such as "1e-3", as a number, and 64.0 as a whole one."""
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


def _whole(least: int, most: int) -> Any:
    return Annotated[int, BeforeValidator(_plain), Field(ge=least, le=most)]


Timesteps = Annotated[int, BeforeValidator(_plain), Field(ge=1, le=10**10)]
Copies = Annotated[int, BeforeValidator(_plain), Field(ge=1, le=4_096)]
_Number, _Rate = Annotated[float, BeforeValidator(_plain)], Annotated[Positive, BeforeValidator(_plain)]
_Share = Annotated[UnitInterval, BeforeValidator(_plain)]
_ARGUMENTS: dict[str, Any] = {
    **dict.fromkeys(("learning_rate", "clip_range", "clip_range_vf"), _Rate),
    **dict.fromkeys(("gamma", "gae_lambda", "tau"), _Share),
    "n_steps": _whole(0, 10**6),
    "buffer_size": _whole(0, 10**7),
    "batch_size": _whole(0, 10**7),
    "n_epochs": _whole(0, 10**4),
    "gradient_steps": _whole(-1, 10**6),
    "sde_sample_freq": _whole(-1, 10**9),
}
_BY_DEFAULT: dict[type, Any] = {bool: bool, int: _whole(0, 10**9)}
"""Kinds of all other settings of an algorithm, by the kind of its default; the rest are numbers."""
_PREFIXES = {
    "lin_": ("learning_rate", "clip_range", "clip_range_vf"),  # falls linearly from the number that follows
    "auto": ("ent_coef", "target_entropy"),  # is learned, starting with the number that may follow
}


@record
class Hyperparameters:
    """How an agent is trained.

    Attributes:
        algorithm: Name of the algorithm.
        n_timesteps: Decisions in training, over all copies of the environment.
        n_envs: Copies of the environment.
        policy: Name of the policy class, such as `MlpPolicy`.
        policy_kwargs: Its settings; an activation is a name such as ``nn.ReLU``.
        env_kwargs: Settings of the training environment.
        arguments: Settings of the algorithm; a rate that falls to zero is written ``lin_0.001``.
        noise_std: Standard deviation of the normal noise added to actions in training, or None.
        augment: Whether training episodes flip and swap the axes of the PB space.
    """

    algorithm: str
    n_timesteps: Timesteps = 100_000
    n_envs: Copies = 1
    policy: str = "MlpPolicy"
    policy_kwargs: JsonObject = dataclasses.field(default_factory=dict)
    env_kwargs: JsonObject = dataclasses.field(default_factory=dict)
    arguments: JsonObject = dataclasses.field(default_factory=dict)
    noise_std: Annotated[Positive, BeforeValidator(_plain)] | None = None
    augment: bool = False

    def as_zoo(self) -> dict[str, Any]:
        """Return them as an entry of RL Zoo's format."""
        found: dict[str, Any] = {"n_timesteps": self.n_timesteps, "n_envs": self.n_envs, "policy": self.policy}
        if self.env_kwargs:
            found["env_kwargs"] = self.env_kwargs
        if self.augment:
            found["vec_env_wrapper"] = AUGMENTATION
        if self.noise_std is not None:
            found |= {"noise_type": "normal", "noise_std": self.noise_std}
        found |= self.arguments
        if self.policy_kwargs:
            found["policy_kwargs"] = self.policy_kwargs
            if "activation_fn" in self.policy_kwargs:  # RL Zoo reads a class only from text
                inner = ", ".join(
                    f"{name}={value if name == 'activation_fn' else repr(value)}"
                    for name, value in self.policy_kwargs.items()
                )
                found["policy_kwargs"] = f"dict({inner})"
        return found

    def replace(self, **changes: Any) -> Hyperparameters:
        """Return a copy with other values.

        Raises:
            SettingsError: If one is out of range.
        """
        return check_entry(self.algorithm, dataclasses.replace(self, **changes).as_zoo(), "hyperparameters")


@record
class PPOSettings:
    """How PPO is trained on the spot. The defaults learn within half a minute on one core.

    They were chosen on the shipped memory `half/0` in the mental environment, on one or two seeds each: many updates
    of a small network at a high learning rate matter; discounts from 0 to 0.9 make no difference beyond the spread of
    the seeds, for an action is rewarded at once. Drawn actions earn more than the most likely ones (16.4 against 13.9
    over eight policies): repeating an action earns nothing, and a policy without chance is prone to repeat itself.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    n_timesteps: Timesteps = 60_000
    """Actions generated in training; rounded up to whole rollouts of n_envs * n_steps."""
    n_envs: Copies = 16
    """Copies of the environment that are stepped in turn."""
    n_steps: Annotated[int, Field(ge=1, le=10**6)] = 30
    """Steps of each copy between two updates: one episode."""
    batch_size: Annotated[int, Field(ge=1, le=10**7)] = 480
    """Size of a minibatch."""
    n_epochs: Annotated[int, Field(ge=1, le=10**4)] = 12
    """Passes over the data of an update."""
    learning_rate: Annotated[float, Field(gt=0, le=1e6)] = 4e-3
    """Step size of Adam."""
    gamma: UnitInterval = 0.5
    """Discount per action."""
    gae_lambda: UnitInterval = 0.9
    """Weight of longer looks ahead in the advantage."""
    clip_range: Annotated[float, Field(gt=0, le=1e6)] = 0.2
    """Largest change of an action's probability ratio that an update rewards."""
    ent_coef: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """Weight of the entropy bonus."""
    log_std_init: Annotated[float, Field(ge=-20, le=20)] = -0.5
    """Logarithm of the policy's first standard deviation; the square is 2 wide."""
    hidden: Annotated[Widths, Field(min_length=1)] = (64, 64)
    """Hidden units of the policy and of the value network, layer by layer."""
    deterministic: bool = False
    """Judge the policy's most likely actions instead of drawn ones."""

    def __post_init__(self) -> None:
        with _naming("`hidden`"):
            check_policy_settings(self.as_hyperparameters().policy_kwargs)
        _check_rollout(self.n_envs, self.n_steps, self.batch_size)

    @property
    def n_generated(self) -> int:
        """Actions generated in training, in whole rollouts."""
        rollout = self.n_envs * self.n_steps
        return -(-self.n_timesteps // rollout) * rollout

    def as_hyperparameters(self) -> Hyperparameters:
        """Return them as those of the algorithm `ppo`."""
        names = ("n_steps", "batch_size", "n_epochs", "learning_rate", "gamma", "gae_lambda", "clip_range", "ent_coef")
        widths = list(self.hidden)
        return Hyperparameters(
            "ppo",
            n_timesteps=self.n_timesteps,
            n_envs=self.n_envs,
            policy_kwargs={"net_arch": {"pi": widths, "vf": widths}, "log_std_init": self.log_std_init},
            arguments={name: getattr(self, name) for name in names},
        )


def read_hyperparameters(
    algorithm: str, env_id: str, conf_file: str | os.PathLike[str] | None = None
) -> Hyperparameters:
    """Read the hyperparameters of an algorithm for an environment.

    Args:
        algorithm: Name of the algorithm.
        env_id: Name of the environment.
        conf_file: YAML file of RL Zoo's format; default: the shipped one.

    Raises:
        NotFoundError: If algorithm, file or entry does not exist; the message offers the nearest name.
        FileFormatError: If the file is no YAML mapping.
        SettingsError: If a key is unknown or a value out of range.
    """
    known = find_algorithm(algorithm)
    path = FOLDER / f"{known.name}.yml" if conf_file is None else Path(conf_file)
    if not os.path.isfile(path):
        raise NotFoundError(f"no hyperparameter file at {path}; the shipped ones are in {FOLDER}")
    entries = as_yaml(read_text(path, "hyperparameter file", MAX_YAML_BYTES), str(path), 20_000)
    if not isinstance(entries, dict) or not all(isinstance(name, str) for name in entries):
        raise FileFormatError(f"{path}: should map names of environments to settings, but holds {shown(entries)}")
    if env_id not in entries:
        raise NotFoundError(
            f"{path.name}: no entry `{env_id}`{nearest_name(env_id, entries)}; there are {', '.join(entries)}"
        )
    return check_entry(known.name, entries[env_id], f"{path.name}: {env_id}")


def check_entry(algorithm: str, entry: Any, where: str) -> Hyperparameters:
    """Return the hyperparameters of one entry of RL Zoo's format.

    Raises:
        SettingsError: If a key is unknown or a value out of range; the message names the entry and the key.
    """
    with _naming(where):
        return _checked_entry(algorithm, entry)


def _checked_entry(algorithm: str, entry: Any) -> Hyperparameters:
    known = find_algorithm(algorithm)
    if not isinstance(entry, Mapping):
        raise SettingsError(f"should be a mapping of names to values, but is {shown(entry)}")
    parameters = known.parameters()
    keys = (*_OWN_KEYS, *parameters)
    for key in entry:
        if key not in keys:
            raise SettingsError(f"no setting `{key}`{nearest_name(str(key), keys)} of {known.class_name}")
    if entry.get("normalize", False) is not False:
        raise SettingsError(
            f"`normalize` should be false, but is {shown(entry['normalize'])}: observations already lie in [-1, 1], "
            "and a bundle holds no running statistics"
        )
    wrapper = entry.get("vec_env_wrapper")
    if wrapper not in (None, AUGMENTATION):
        raise SettingsError(f"`vec_env_wrapper` should be {AUGMENTATION}, or left out, but is {shown(wrapper)}")
    policy = policy_name(str(entry.get("policy", known.policies[0])))
    if policy not in known.policies:
        raise SettingsError(f"`policy` should be {' or '.join(known.policies)}, but is {shown(policy)}")
    noise = entry.get("noise_type"), entry.get("noise_std")
    if noise != (None, None):
        if known.on_policy:
            raise SettingsError(f"`noise_type` is for algorithms with a replay buffer, not for {known.class_name}")
        if noise[0] != "normal" or noise[1] is None:
            raise SettingsError(
                f'`noise_type` should be "normal" with a `noise_std`, but is {shown(noise[0])} with {shown(noise[1])}'
            )
    policy_kwargs = _mapping(entry.get("policy_kwargs", {}), "policy_kwargs")
    with _naming("`policy_kwargs`"):
        names = known.policy_parameters(policy)
        for key in policy_kwargs:
            if key not in names:
                raise SettingsError(f"no setting `{key}`{nearest_name(key, names)} of {policy}")
        if "activation_fn" in policy_kwargs:
            policy_kwargs["activation_fn"] = activation_name(str(policy_kwargs["activation_fn"]), "`activation_fn`")
        check_policy_settings(policy_kwargs)
    arguments = {k: _argument(k, v, parameters[k].default) for k, v in entry.items() if k in parameters}
    given = {name: entry[name] for name in ("n_timesteps", "n_envs") if name in entry}
    made = Hyperparameters(
        known.name,
        policy=policy,
        policy_kwargs=policy_kwargs,
        env_kwargs=_mapping(entry.get("env_kwargs", {}), "env_kwargs"),
        arguments=arguments,
        noise_std=noise[1],
        augment=wrapper is not None,
        **given,
    )
    if known.on_policy:
        n_steps, batch_size = (arguments.get(name, parameters[name].default) for name in ("n_steps", "batch_size"))
        _check_rollout(made.n_envs, n_steps, batch_size)
    return made


@contextlib.contextmanager
def _naming(where: str) -> Iterator[None]:
    try:
        yield
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from error


def _argument(key: str, value: Any, default: Any) -> Any:
    """Return the value of a setting of the algorithm, checked against its kind and range."""
    if value is None and default is None:
        return None
    for prefix, keys in _PREFIXES.items():
        if key in keys and isinstance(value, str) and value.startswith(prefix):
            number = value.removeprefix(prefix).removeprefix("_")
            return value if value == "auto" else f"{prefix.rstrip('_')}_{checked(_Rate, number, key)!r}"
    if key == "train_freq" and isinstance(value, list):
        return list(checked(tuple[_whole(1, 10**9), Literal["step", "episode"]], value, key))
    return checked(_ARGUMENTS.get(key, _BY_DEFAULT.get(type(default), _Number)), value, key)


def _mapping(value: Any, name: str) -> dict[str, Any]:
    found = parse_literal(value, f"`{name}`") if isinstance(value, str) else value
    if not isinstance(found, Mapping) or not all(isinstance(key, str) for key in found):
        raise SettingsError(f"`{name}` should be a mapping of names to values, but is {shown(value)}")
    return dict(found)


def _check_rollout(n_envs: int, n_steps: int, batch_size: int) -> None:
    """Refuse minibatches that do not divide the rollout: the last one would be smaller than asked for."""
    size = n_envs * n_steps
    if size > MAX_ROLLOUT:
        raise SettingsError(f"n_envs * n_steps should be at most {MAX_ROLLOUT}, but is {size}")
    if not batch_size or size % batch_size:
        raise SettingsError(f"`batch_size` should divide n_envs * n_steps = {size}, but is {batch_size}")


def schedule(value: Any) -> Any:
    """Return what the algorithms take for a rate: a number, or for ``lin_x`` a function falling from x to 0."""
    if not isinstance(value, str) or not value.startswith("lin_"):
        return value
    start = float(value.removeprefix("lin_"))
    falling: Callable[[float], float] = lambda remaining: start * remaining  # noqa: E731 - it is a value here
    return falling


def resolve_policy_kwargs(policy_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Return `policy_kwargs` with the activation's class in place of its name."""
    found = dict(policy_kwargs)
    if "activation_fn" in found:
        import torch

        found["activation_fn"] = getattr(torch.nn, found["activation_fn"].removeprefix("nn."))
    return found


def parse_literal(text: str, where: str) -> Any:
    """Return the value that `text` describes; an activation as its name with the prefix ``nn.``.

    Args:
        text: A Python expression of the kinds named at the top.
        where: What it is the value of, for the error.

    Raises:
        SettingsError: If it is anything else.

    Example:
        >>> parse_literal("dict(net_arch=[64, 64], activation_fn=nn.ReLU)", "policy_kwargs")
        {'net_arch': [64, 64], 'activation_fn': 'nn.ReLU'}
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body, where)
    except SettingsError:
        raise
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise SettingsError(
            f"{where} should be a value such as dict(net_arch=[64, 64]), but is {text!r:.80}"
        ) from error


def activation_name(name: str, where: str) -> str:
    """Return ``nn.X`` for ``X`` or ``nn.X``.

    Raises:
        SettingsError: If there is no such activation.
    """
    bare = name.rpartition(".")[2]
    if bare not in ACTIVATIONS or name not in (bare, f"nn.{bare}", f"th.nn.{bare}", f"torch.nn.{bare}"):
        raise SettingsError(
            f"{where}: no activation `{name}`{nearest_name(bare, ACTIVATIONS)}; there are {', '.join(ACTIVATIONS)}"
        )
    return f"nn.{bare}"


def _value(node: ast.expr, where: str) -> Any:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_value(part, where) for part in parts]
        case ast.Dict(keys=keys, values=values) if None not in keys:
            return {_value(key, where): _value(part, where) for key, part in zip(keys, values, strict=True) if key}
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords) if all(k.arg for k in keywords):
            return {str(k.arg): _value(k.value, where) for k in keywords}
        case ast.Call(func=ast.Name(id="float"), args=[ast.Constant(value=int() | float() | str() as value)]):
            return float(value)
        case ast.Attribute() | ast.Name():
            return activation_name(ast.unparse(node), where)
    raise SettingsError(
        f"{where} holds `{ast.unparse(node):.60}`, which is not read: only numbers, strings, lists, dict(...) and "
        "activations such as nn.ReLU are, since nothing in a settings file is executed"
    )
