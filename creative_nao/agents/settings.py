"""Values written as Python in a settings file, such as ``dict(net_arch=[64, 64])``: read, never executed.

RL Zoo evaluates such strings. Here they are parsed, and only numbers, strings, truth values, None, lists, tuples,
dictionaries, `dict(...)`, `float("1e-3")` and the names of torch's activations are understood.

Also here:
- Settings of a policy network out of a file: kinds and sizes checked before anything is built of them.
- Hyperparameters in RL Zoo's format: one YAML file an algorithm, keyed by environment, checked before use.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from creative_nao.agents.algorithms import Algorithm, find_algorithm, policy_name
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.fields import shown
from creative_nao.storage import read_text

ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Softplus")
"""Activations that a policy may have, classes of `torch.nn`."""


def parse_literal(text: str, where: str) -> Any:
    """Return the value that `text` describes; an activation as its name with the prefix ``nn.``.

    Args:
        text: A Python expression of the kinds named above.
        where: What it is the value of, for the error.

    Raises:
        SettingsError: If it is anything else.

    Example:
        >>> parse_literal("dict(net_arch=[64, 64], activation_fn=nn.ReLU)", "policy_kwargs")
        {'net_arch': [64, 64], 'activation_fn': 'nn.ReLU'}
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body, where)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        if isinstance(error, SettingsError):
            raise
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


MAX_LAYERS = 16
MAX_WIDTH = 4096
MAX_WEIGHTS = 20_000_000
"""Of all networks of a policy together, targets included: 80 MB."""
_COUNTS = {
    "n_critics": 10, "n_quantiles": 1_000, "lstm_hidden_size": 2048, "n_lstm_layers": 8, "renorm_warmup_steps": 10**9,
    "width": 512, "n_layers": 16,
}  # fmt: skip
_NUMBERS = {
    "log_std_init": 20.0, "clip_mean": 1e6, "batch_norm_momentum": 1.0, "batch_norm_eps": 1.0,
}  # fmt: skip
_NETS = ("pi", "vf", "qf")


def check_policy_settings(settings: Mapping[str, Any], where: str) -> None:
    """Refuse settings of a policy that are of the wrong kind or ask for a network beyond reason.

    Args:
        settings: By name, as the policies of Stable-Baselines3 take them; an activation as its name.
        where: Beginning of the message.

    Raises:
        SettingsError: Naming the setting.
    """
    for name, value in settings.items():
        named = f"{where}: `{name}`"
        if name in _COUNTS:
            most = _COUNTS[name]
            if type(value) is not int or not 1 <= value <= most:
                raise SettingsError(f"{named} should be a whole number from 1 to {most}, but is {shown(value)}")
        elif name in _NUMBERS:
            if type(value) not in (int, float) or not abs(value) <= _NUMBERS[name]:
                raise SettingsError(f"{named} should be a number of at most {_NUMBERS[name]:g}, but is {shown(value)}")
        elif name == "net_arch":
            nets_of(value, named)
        elif name == "optimizer_kwargs":
            if not isinstance(value, Mapping) or not all(type(one) in (int, float, bool) for one in value.values()):
                raise SettingsError(f"{named} should be a mapping of names to numbers, but is {shown(value)}")
        elif name.endswith(("_class", "_kwargs")):
            if value is not None:
                raise SettingsError(f"{named} cannot be set in a file, where nothing names code, but is {shown(value)}")
        elif name != "activation_fn" and not isinstance(value, bool):
            raise SettingsError(f"{named} should be true or false, but is {shown(value)}")
    if (n_weights := _n_weights(settings, where)) > MAX_WEIGHTS:
        raise SettingsError(f"{where} ask for {n_weights:,} weights, expected at most {MAX_WEIGHTS:,}")


def nets_of(value: Any, where: str) -> dict[str, list[int]]:
    """Return the widths of the layers of each network that `net_arch` describes.

    Raises:
        SettingsError: If it is no list of widths, and no mapping of `pi`, `vf` and `qf` to such lists.
    """
    nets = dict.fromkeys(_NETS, value) if isinstance(value, list | tuple) else value
    if value is None:
        return {}
    if not isinstance(nets, Mapping) or not set(nets) <= set(_NETS):
        raise SettingsError(f"{where} should be a list of widths or map pi, vf and qf to lists, but is {shown(value)}")
    for widths in nets.values():
        check_widths(widths, where)
    return {name: list(widths) for name, widths in nets.items()}


def check_widths(widths: Any, where: str) -> None:
    """Refuse what is no list of widths of layers.

    Raises:
        SettingsError: Saying what it should be.
    """
    listed = isinstance(widths, list | tuple) and len(widths) <= MAX_LAYERS
    if not listed or any(type(width) is not int or not 1 <= width <= MAX_WIDTH for width in widths):
        raise SettingsError(
            f"{where} should list at most {MAX_LAYERS} widths from 1 to {MAX_WIDTH}, but is {shown(widths)}"
        )


def _n_weights(settings: Mapping[str, Any], where: str) -> int:
    """Return about how many weights the networks have, but for those that read the observation."""
    nets = nets_of(settings.get("net_arch"), where)
    judges = 2 * settings.get("n_critics", 2)
    memory = 8 * settings.get("lstm_hidden_size", 0) ** 2 * settings.get("n_lstm_layers", 1)
    return 2 * memory + sum(_between(widths) * (1 if name == "pi" else judges) for name, widths in nets.items())


def _between(widths: Sequence[int]) -> int:
    return sum(one * other for one, other in itertools.pairwise(widths))


FOLDER = Path(__file__).parent / "hyperparams"
_OWN_KEYS = ("n_timesteps", "n_envs", "policy", "policy_kwargs", "env_kwargs", "normalize", "noise_type", "noise_std",
             "vec_env_wrapper")  # fmt: skip
AUGMENTATION = "creative_nao.agents.augmentation.FlippedSwappedAxes"
"""The one `vec_env_wrapper` there is, as RL Zoo reads it: training episodes with flipped and swapped PB axes."""
_MAX_BYTES = 200_000
_MAX_VALUES = 20_000
MAX_ENVS = 4_096
MAX_ROLLOUT = 10_000_000
"""Decisions of all copies between two updates; they are kept in memory."""
_LARGEST = {
    "n_timesteps": 10**10, "n_envs": MAX_ENVS, "n_steps": 10**6, "buffer_size": 10**7, "batch_size": 10**7,
    "n_epochs": 10**4, "gradient_steps": 10**6,
}  # fmt: skip
_LARGEST_OTHER = 10**9


@dataclass(frozen=True)
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
    n_timesteps: int = 100_000
    n_envs: int = 1
    policy: str = "MlpPolicy"
    policy_kwargs: dict[str, Any] = field(default_factory=dict)
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    arguments: dict[str, Any] = field(default_factory=dict)
    noise_std: float | None = None
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
    entries = _read_yaml(path)
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
    known = find_algorithm(algorithm)
    if not isinstance(entry, Mapping):
        raise SettingsError(f"{where}: should be a mapping of names to values, but is {shown(entry)}")
    parameters = known.parameters()
    keys = (*_OWN_KEYS, *parameters)
    for key in entry:
        if key not in keys:
            raise SettingsError(f"{where}: no setting `{key}`{nearest_name(str(key), keys)} of {known.class_name}")
    if entry.get("normalize", False) is not False:
        raise SettingsError(
            f"{where}: `normalize` should be false, but is {entry['normalize']!r}: observations already lie in "
            "[-1, 1], and a bundle holds no running statistics"
        )
    wrapper = entry.get("vec_env_wrapper")
    if wrapper not in (None, AUGMENTATION):
        raise SettingsError(f"{where}: `vec_env_wrapper` should be {AUGMENTATION}, or left out, but is {wrapper!r}")
    policy = policy_name(str(entry.get("policy", known.policies[0])))
    if policy not in known.policies:
        raise SettingsError(f"{where}: `policy` should be {' or '.join(known.policies)}, but is {shown(policy)}")
    made = Hyperparameters(
        algorithm=known.name,
        n_timesteps=_whole(entry.get("n_timesteps", Hyperparameters.n_timesteps), where, "n_timesteps"),
        n_envs=_whole(entry.get("n_envs", Hyperparameters.n_envs), where, "n_envs"),
        policy=policy,
        policy_kwargs=_policy_kwargs(known, policy, entry.get("policy_kwargs", {}), f"{where}: `policy_kwargs`"),
        env_kwargs=_mapping(entry.get("env_kwargs", {}), f"{where}: `env_kwargs`"),
        arguments={key: _argument(key, value, parameters[key].default, where) for key, value in entry.items()
                   if key in parameters},
        noise_std=_noise(entry, where, known),
        augment=wrapper is not None,
    )  # fmt: skip
    _check_rollout(made, known, where)
    return made


def schedule(value: Any) -> Any:
    """Return what the algorithms take for a rate: a number, or for ``lin_x`` a function falling from x to 0."""
    if not isinstance(value, str) or not value.startswith("lin_"):
        return value
    start = float(value.removeprefix("lin_"))
    falling: Callable[[float], float] = lambda remaining: start * remaining  # noqa: E731 - it is a value here
    return falling


def resolve_policy_kwargs(policy_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Return `policy_kwargs` with the activation's class in place of its name."""
    import torch

    found = dict(policy_kwargs)
    if "activation_fn" in found:
        found["activation_fn"] = getattr(torch.nn, found["activation_fn"].removeprefix("nn."))
    return found


def _read_yaml(path: Path) -> dict[str, Any]:
    import yaml

    if not os.path.isfile(path):
        raise NotFoundError(f"no hyperparameter file at {path}; the shipped ones are in {FOLDER}")
    text = read_text(path, "hyperparameter file", _MAX_BYTES)
    try:
        loader = yaml.SafeLoader(text)
        tree = loader.get_single_node()
        if tree is not None and (twice := _said_twice(tree, set())) is not None:
            raise FileFormatError(f"{path}: line {twice.start_mark.line + 1}: `{twice.value[:60]}` is there already")
        if tree is not None and _expanded(tree, {}) > _MAX_VALUES:
            raise FileFormatError(f"{path}: its anchors and aliases unfold to more than {_MAX_VALUES} values")
        found = None if tree is None else loader.construct_document(tree)
    except FileFormatError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError, TypeError, AttributeError, KeyError, IndexError) as error:
        raise FileFormatError(f"{path}: is no YAML that can be read: {' '.join(str(error).split())}") from error
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise FileFormatError(f"{path}: should map names of environments to settings, but holds {shown(found)}")
    return found


def _said_twice(node: Any, seen: set[int]) -> Any:
    """Return the first key of a YAML mapping that stands in it twice, or None; YAML would take the last silently."""
    if id(node) in seen or not isinstance(node.value, list):
        return None
    seen.add(id(node))
    keys: set[str] = set()
    for one in node.value:
        for part in one if isinstance(one, tuple) else (one,):
            if (found := _said_twice(part, seen)) is not None:
                return found
        if isinstance(one, tuple) and isinstance(one[0].value, str) and one[0].value != "<<":
            if one[0].value in keys:
                return one[0]
            keys.add(one[0].value)
    return None


def _expanded(node: Any, sizes: dict[int, float]) -> float:
    """Return how many values a YAML node holds once its aliases are written out; one that holds itself is endless."""
    if id(node) not in sizes:
        sizes[id(node)] = float("inf")
        inner = node.value if isinstance(node.value, list) else []
        parts = [part for one in inner for part in (one if isinstance(one, tuple) else (one,))]
        sizes[id(node)] = 1.0 + sum(_expanded(part, sizes) for part in parts)
    return sizes[id(node)]


def _number(value: Any, where: str) -> float:
    """Return a number; YAML reads 1e-3, without a point, as text."""
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e300:
        raise SettingsError(f"{where} should be a number, but is {shown(value)}")
    return value


def _whole(value: Any, where: str, name: str, least: int = 1) -> int:
    named, most = f"{where}: `{name}`", _LARGEST.get(name, _LARGEST_OTHER)
    number = _number(value, named)
    if number != int(number) or number < least:
        raise SettingsError(f"{named} should be a whole number of at least {least}, but is {shown(value)}")
    if number > most:
        raise SettingsError(f"{named} should be at most {most}, but is {shown(value)}")
    return int(number)


def _argument(key: str, value: Any, default: Any, where: str) -> Any:
    """Return the value of a setting of the algorithm, checked against the kind and range of its default."""
    named = f"{where}: `{key}`"
    if key in ("learning_rate", "clip_range", "clip_range_vf"):
        if isinstance(value, str) and value.startswith("lin_"):
            return f"lin_{_positive(value.removeprefix('lin_'), named)!r}"
        return None if value is None and default is None else _positive(value, named)
    if key in ("gamma", "gae_lambda", "tau"):
        if not 0.0 <= _number(value, named) <= 1.0:
            raise SettingsError(f"{named} should be between 0 and 1, but is {value!r}")
        return float(_number(value, named))
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise SettingsError(f"{named} should be true or false, but is {value!r}")
        return value
    if isinstance(value, str) and value.startswith("auto") and key in ("ent_coef", "target_entropy"):
        start = value.removeprefix("auto").removeprefix("_")
        return value if not start else f"auto_{_positive(start, named)!r}"
    if value is None or isinstance(value, list):
        if value is default:
            return value
        if key == "train_freq" and isinstance(value, list) and len(value) == 2 and value[1] in ("step", "episode"):
            return [_whole(value[0], where, key), value[1]]
        raise SettingsError(f"{named} should be a number, but is {shown(value)}")
    if isinstance(default, int) and key not in ("ent_coef", "target_entropy"):
        return _whole(value, where, key, least=-1 if key in ("gradient_steps", "sde_sample_freq") else 0)
    return _number(value, named)


def _positive(value: Any, where: str) -> float:
    number = float(_number(value, where))
    if number <= 0.0:
        raise SettingsError(f"{where} should be above 0, but is {value!r}")
    return number


def _mapping(value: Any, where: str) -> dict[str, Any]:
    found = parse_literal(value, where) if isinstance(value, str) else value
    if not isinstance(found, Mapping) or not all(isinstance(key, str) for key in found):
        raise SettingsError(f"{where} should be a mapping of names to values, but is {shown(value)}")
    return dict(found)


def _policy_kwargs(known: Algorithm, policy: str, value: Any, where: str) -> dict[str, Any]:
    found = _mapping(value, where)
    names = known.policy_parameters(policy)
    for key in found:
        if key not in names:
            raise SettingsError(f"{where}: no setting `{key}`{nearest_name(key, names)} of {policy}")
    if "activation_fn" in found:
        found["activation_fn"] = activation_name(str(found["activation_fn"]), f"{where}: `activation_fn`")
    check_policy_settings(found, where)
    return found


def _noise(entry: Mapping[str, Any], where: str, known: Algorithm) -> float | None:
    kind, std = entry.get("noise_type"), entry.get("noise_std")
    if kind is None and std is None:
        return None
    if known.on_policy:
        raise SettingsError(f"{where}: `noise_type` is for algorithms with a replay buffer, not for {known.class_name}")
    if kind != "normal" or std is None:
        raise SettingsError(
            f'{where}: `noise_type` should be "normal" with a `noise_std`, but is {kind!r} with {std!r}'
        )
    return _positive(std, f"{where}: `noise_std`")


def _check_rollout(made: Hyperparameters, known: Algorithm, where: str) -> None:
    """Refuse minibatches that do not divide the rollout: the last one would be smaller than asked for."""
    if not known.on_policy:
        return
    defaults = known.parameters()
    size = made.n_envs * made.arguments.get("n_steps", defaults["n_steps"].default)
    batch = made.arguments.get("batch_size", defaults["batch_size"].default)
    if size > MAX_ROLLOUT:
        raise SettingsError(f"{where}: n_envs * n_steps should be at most {MAX_ROLLOUT}, but is {size}")
    if not batch or size % batch:
        raise SettingsError(f"{where}: `batch_size` should divide n_envs * n_steps = {size}, but is {batch}")
