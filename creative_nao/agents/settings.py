"""Algorithms, and their hyperparameters in RL Zoo's format: one YAML file an algorithm, checked before use.

RL Zoo evaluates text such as ``dict(net_arch=[64, 64])``. Here it is parsed, and only numbers, strings, truth values,
None, lists, tuples, dictionaries, `dict(...)`, `float("1e-3")` and the names of torch's activations are understood.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import functools
import inspect
import itertools
import operator
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, load_extra, nearest_name, shown
from creative_nao.schema import Field, JsonObject, Positive, UnitInterval, checked, record
from creative_nao.storage import MAX_YAML_BYTES, as_yaml, read_text

CELL_POLICY, TRY_POLICY = "creative_nao.agents.CellPolicy", "creative_nao.agents.TryPolicy"
"""PPO's policies over the cells of the PB space and over every try, by dotted paths as RL Zoo reads them."""
CELL_SAC_POLICY = "creative_nao.agents.CellSACPolicy"
"""The first of them for SAC."""
AUGMENTATION = "creative_nao.agents.FlippedSwappedAxes"
"""The one `vec_env_wrapper` there is: training episodes with flipped and swapped PB axes."""
RELEASED_NAMES = {
    "creative_nao.agents.augmentation.FlippedSwappedAxes": AUGMENTATION,
    "creative_nao.agents.cell_policy.CellPolicy": CELL_POLICY,
    "creative_nao.agents.cell_sac.CellSACPolicy": CELL_SAC_POLICY,
}
"""Names in files of release 0.1.0; a name is looked up here, and nothing is imported by it."""


@dataclasses.dataclass(frozen=True)
class Algorithm:
    """One learning algorithm.

    Attributes:
        on_policy: Whether it learns from whole rollouts of its present policy, and keeps no replay buffer.
        policies: Names of policies it may have; the first is the default.
        acting: Prefix of the weights that choosing an action needs; a bundle keeps these only.
        supervised: Whether it learns from the truth of memories, not in environments.
    """

    name: str
    package: str
    class_name: str
    on_policy: bool
    policies: tuple[str, ...] = ("MlpPolicy",)
    acting: str = ""
    supervised: bool = False

    def load(self) -> Any:
        """Return the class, or raise a `MissingDependencyError` where its package is not installed."""
        return getattr(load_extra(self.package, "agents", f"agent `{self.name}`"), self.class_name)

    def policy_class(self, policy: str) -> Any:
        """Return the class of a policy, one of `policies`."""
        if policy in (CELL_POLICY, CELL_SAC_POLICY, TRY_POLICY):
            from creative_nao import agents

            return getattr(agents, policy.rpartition(".")[2])
        return self.load().policy_aliases[policy]

    def parameters(self, policy: str | None = None) -> dict[str, inspect.Parameter]:
        """Return the settings of its constructor, or of a policy's, by name; those that are made here are left out."""
        maker = self.load() if policy is None else self.policy_class(policy)
        settings = inspect.signature(maker).parameters
        return {k: one for k, one in settings.items() if k not in _MADE_HERE and one.kind is not one.VAR_KEYWORD}


_SB3, _LEARNED_MAP = "stable_baselines3", "creative_nao.agents.learned_map.training"
ALGORITHMS = {
    one.name: one
    for one in (
        Algorithm("ppo", _SB3, "PPO", on_policy=True, policies=("MlpPolicy", CELL_POLICY, TRY_POLICY)),
        Algorithm("sac", _SB3, "SAC", on_policy=False, policies=("MlpPolicy", CELL_SAC_POLICY), acting="actor."),
        Algorithm("td3", _SB3, "TD3", on_policy=False, acting="actor."),
        Algorithm("recurrent_ppo", "sb3_contrib", "RecurrentPPO", on_policy=True, policies=("MlpLstmPolicy",)),
        Algorithm("tqc", "sb3_contrib", "TQC", on_policy=False, acting="actor."),
        Algorithm("crossq", "sb3_contrib", "CrossQ", on_policy=False, acting="actor."),
        Algorithm("learned_map", _LEARNED_MAP, "SupervisedMap", False, policies=("AttentiveMap",), supervised=True),
    )
}
"""Every algorithm by name. RL Zoo calls RecurrentPPO `ppo_lstm`; `find_algorithm` knows both."""

_ALIASES = {"ppo_lstm": "recurrent_ppo"}
_MADE_HERE = (
    "self", "policy", "env", "policy_kwargs", "action_noise", "replay_buffer_class", "replay_buffer_kwargs",
    "rollout_buffer_class", "rollout_buffer_kwargs", "optimize_memory_usage", "stats_window_size", "tensorboard_log",
    "verbose", "seed", "device", "_init_setup_model", "observation_space", "action_space", "lr_schedule",
)  # fmt: skip


def find_algorithm(name: str) -> Algorithm:
    """Return the algorithm of this name, or raise a `NotFoundError` that offers the nearest."""
    name = _ALIASES.get(name, name)
    if name not in ALGORITHMS:
        known = ", ".join(ALGORITHMS)
        raise NotFoundError(f"no learning agent `{name}`{nearest_name(name, ALGORITHMS)}; there are {known}")
    return ALGORITHMS[name]


ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Softplus")
"""Activations that a policy may have, classes of `torch.nn`."""
MAX_WEIGHTS = 20_000_000
"""Of all networks of a policy together, targets included: 80 MB."""
Widths = Annotated[tuple[Annotated[int, Field(ge=1, le=4096)], ...], Field(max_length=16)]
"""Units of the hidden layers of a network, layer by layer."""
_LARGEST = {
    "n_critics": 10, "n_quantiles": 1_000, "lstm_hidden_size": 2048, "n_lstm_layers": 8, "renorm_warmup_steps": 10**9,
    "width": 512, "n_layers": 16, "resolution": 64, "n_heads": 64,
    "n_asked": 9999, "n_refined": 9999, "n_expected": 9999, "n_segments": 10,
}  # fmt: skip
_LARGEST_SIZE = {"log_std_init": 20.0, "clip_mean": 1e6}
_LARGEST_SIZE |= dict.fromkeys(("batch_norm_momentum", "batch_norm_eps", "dropout", "first_share"), 1.0)
_POLICY_SETTINGS: dict[str, Any] = {
    "activation_fn": str,
    "optimizer_kwargs": dict[str, float | bool],
    **{name: Annotated[int, Field(ge=1, le=most)] for name, most in _LARGEST.items()},
    **{name: Annotated[float, Field(ge=-most, le=most)] for name, most in _LARGEST_SIZE.items()},
}


def check_policy_settings(settings: Mapping[str, Any]) -> None:
    """Refuse settings of a policy that are of the wrong kind or ask for a network beyond reason: a `SettingsError`."""
    for name, value in settings.items():
        if name == "net_arch":
            nets_of(value)
        elif name in _POLICY_SETTINGS:
            checked(_POLICY_SETTINGS[name], value, name)
        elif not name.endswith(("_class", "_kwargs")):
            checked(bool, value, name)
        elif value is not None:
            raise SettingsError(f"`{name}` cannot be set in a file, where nothing names code")
    nets = nets_of(settings.get("net_arch"))
    n_weights = 16 * settings.get("lstm_hidden_size", 0) ** 2 * settings.get("n_lstm_layers", 1)
    for name, widths in nets.items():  # but for the layers that read the observation
        between = sum(one * other for one, other in itertools.pairwise(widths))
        n_weights += between * (1 if name == "pi" else 2 * settings.get("n_critics", 2))
    if n_weights > MAX_WEIGHTS:
        raise SettingsError(f"the networks would have {n_weights:,} weights, expected at most {MAX_WEIGHTS:,}")


def nets_of(value: Any) -> dict[str, tuple[int, ...]]:
    """Return the widths of the layers of each network that `net_arch`, a list or a mapping of lists, describes."""
    if value is None:
        return {}
    if isinstance(value, Mapping):
        return checked(dict[Literal["pi", "vf", "qf"], Widths], value, "net_arch")
    return dict.fromkeys(("pi", "vf", "qf"), checked(Widths, value, "net_arch"))


FOLDER = Path(__file__).parent / "hyperparams"
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
    **dict.fromkeys(("buffer_size", "batch_size"), _whole(0, 10**7)),
    "n_epochs": _whole(0, 10**4),
    "gradient_steps": _whole(-1, 10**6),
    "sde_sample_freq": _whole(-1, 10**9),
}
_BY_DEFAULT: dict[type, Any] = {bool: bool, int: _whole(0, 10**9), tuple: tuple[_whole(0, 10**3), ...]}
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
                parts = [f"{k}={v if k == 'activation_fn' else repr(v)}" for k, v in self.policy_kwargs.items()]
                found["policy_kwargs"] = f"dict({', '.join(parts)})"
        return found

    def sb3_arguments(self) -> dict[str, Any]:
        """Return `arguments` as the algorithms take them: ``lin_x`` as a function that falls from x to 0."""
        falling = {
            name: functools.partial(operator.mul, float(value.removeprefix("lin_")))
            for name, value in self.arguments.items()
            if isinstance(value, str) and value.startswith("lin_")
        }
        pairs = {name: tuple(value) for name, value in self.arguments.items() if isinstance(value, list)}
        return {**self.arguments, **falling, **pairs}

    def sb3_policy_kwargs(self) -> dict[str, Any]:
        """Return `policy_kwargs` with the activation's class in place of its name."""
        if "activation_fn" not in self.policy_kwargs:
            return dict(self.policy_kwargs)
        import torch

        activation = getattr(torch.nn, self.policy_kwargs["activation_fn"].removeprefix("nn."))
        return {**self.policy_kwargs, "activation_fn": activation}

    def replace(self, **changes: Any) -> Hyperparameters:
        """Return a copy with other values, checked."""
        return check_entry(self.algorithm, dataclasses.replace(self, **changes).as_zoo(), "hyperparameters")


def read_hyperparameters(
    algorithm: str, env_id: str, conf_file: str | os.PathLike[str] | None = None
) -> Hyperparameters:
    """Read the hyperparameters of an algorithm for an environment, out of the shipped file or a `conf_file`.

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
        nearest = nearest_name(env_id, entries)
        raise NotFoundError(f"{path.name}: no entry `{env_id}`{nearest}; there are {', '.join(entries)}")
    return check_entry(known.name, entries[env_id], f"{path.name}: {env_id}")


def check_entry(algorithm: str, entry: Any, where: str) -> Hyperparameters:
    """Return the hyperparameters of one entry of RL Zoo's format; a `SettingsError` names the entry and the key."""
    with naming(where):
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
    if (came := entry.get("normalize", False)) is not False:
        text = "observations already lie in [-1, 1], and a bundle holds no running statistics"
        raise SettingsError(f"`normalize` should be false, but is {shown(came)}: {text}")
    wrapper = RELEASED_NAMES.get(str(entry.get("vec_env_wrapper")), entry.get("vec_env_wrapper"))
    if wrapper not in (None, AUGMENTATION):
        raise SettingsError(f"`vec_env_wrapper` should be {AUGMENTATION}, or left out, but is {shown(wrapper)}")
    if known.supervised:
        for key in ("n_envs", "env_kwargs", "noise_type", "vec_env_wrapper"):
            if entry.get(key) not in (None, {}, 1):
                raise SettingsError(f"`{key}` is for learning in environments, but {known.name} learns from memories")
    policy = RELEASED_NAMES.get(policy := str(entry.get("policy", known.policies[0])), policy)
    if policy not in known.policies:
        raise SettingsError(f"`policy` should be {' or '.join(known.policies)}, but is {shown(policy)}")
    noise = entry.get("noise_type"), entry.get("noise_std")
    if noise != (None, None):
        if known.on_policy:
            raise SettingsError(f"`noise_type` is for algorithms with a replay buffer, not for {known.class_name}")
        if noise[0] != "normal" or noise[1] is None:
            told = f"{shown(noise[0])} with {shown(noise[1])}"
            raise SettingsError(f'`noise_type` should be "normal" with a `noise_std`, but is {told}')
    policy_kwargs = _mapping(entry.get("policy_kwargs", {}), "policy_kwargs")
    with naming("`policy_kwargs`"):
        names = known.parameters(policy)
        for key in policy_kwargs:
            if key not in names:
                raise SettingsError(f"no setting `{key}`{nearest_name(key, names)} of {policy}")
        if "activation_fn" in policy_kwargs:
            policy_kwargs["activation_fn"] = _activation(str(policy_kwargs["activation_fn"]), "`activation_fn`")
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
        check_rollout(made.n_envs, n_steps, batch_size)
    return made


@contextlib.contextmanager
def naming(where: str) -> Iterator[None]:
    """Begin the text of a `SettingsError` with the name of the part."""
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


def check_rollout(n_envs: int, n_steps: int, batch_size: int) -> None:
    """Refuse minibatches that do not divide the rollout: the last one would be smaller than asked for."""
    size = n_envs * n_steps
    if size > MAX_ROLLOUT:
        raise SettingsError(f"n_envs * n_steps should be at most {MAX_ROLLOUT}, but is {size}")
    if not batch_size or size % batch_size:
        raise SettingsError(f"`batch_size` should divide n_envs * n_steps = {size}, but is {batch_size}")


def parse_literal(text: str, where: str) -> Any:
    """Return the value that a Python expression describes; a `SettingsError` if it holds anything but the kinds above.

    Example:
        >>> parse_literal("dict(net_arch=[64, 64], activation_fn=nn.ReLU)", "policy_kwargs")
        {'net_arch': [64, 64], 'activation_fn': 'nn.ReLU'}
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body, where)
    except SettingsError:
        raise
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise SettingsError(f"{where} should be such as dict(net_arch=[64, 64]), but is {text!r:.80}") from error


def _activation(name: str, where: str) -> str:
    """Return ``nn.X`` for ``X`` or ``nn.X``."""
    bare = name.rpartition(".")[2]
    if bare in ACTIVATIONS and name in (bare, f"nn.{bare}", f"th.nn.{bare}", f"torch.nn.{bare}"):
        return f"nn.{bare}"
    known = ", ".join(ACTIVATIONS)
    raise SettingsError(f"{where}: no activation `{name}`{nearest_name(bare, ACTIVATIONS)}; there are {known}")


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
            return _activation(ast.unparse(node), where)
    raise SettingsError(
        f"{where} holds `{ast.unparse(node):.60}`, which is not read: only numbers, strings, lists, dict(...) and "
        "activations such as nn.ReLU are, since nothing in a settings file is executed"
    )
