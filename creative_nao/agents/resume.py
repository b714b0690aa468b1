"""Exact resume of a training: its state as arrays and plain values, and the checkpoint file that holds it.

Weights, optimisers, replay buffer, the environments' exact state, and the generators of Python, NumPy, torch and the
action space. A training put back into such a state continues with the same bits; nothing is pickled. What is read of
Stable-Baselines3 beyond its public interface is listed in `PRIVATE_NAMES`; a test tells when one of them is gone.
"""

from __future__ import annotations

import dataclasses
import operator
import random
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from creative_nao import schema
from creative_nao.agents.settings import RELEASED_NAMES
from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take
from creative_nao.envs.state import EnvState, generator_from
from creative_nao.errors import FileFormatError, SettingsError, shown
from creative_nao.schema import Field, JsonObject, Version1, parse

KIND = "agent checkpoint"
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
PRIVATE_NAMES = (
    *_COUNTERS, "_get_torch_save_params", "_last_obs", "_last_episode_starts", "_stats_window_size", "ep_info_buffer"
)  # fmt: skip
"""Attributes of Stable-Baselines3's models that are no part of its documented interface; `_last_lstm_states` too."""
_NOISE_MATRICES = ("exploration_mat", "exploration_matrices")


@dataclass(frozen=True, eq=False)
class ResumeState:
    """The state of a training between two rollouts: what JSON can hold, and the rest by name."""

    values: dict[str, Any]
    arrays: dict[str, np.ndarray]


def capture(model: Any) -> ResumeState:
    """Return the exact state of a model of Stable-Baselines3, of its environments and of what it has logged."""
    values: dict[str, Any] = {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)}
    arrays: dict[str, np.ndarray] = {}
    values["parameters"] = pack(model.get_parameters(), "parameters", arrays)
    for name, tensor in _variables(model).items():
        arrays[f"variable.{name}"] = _copied(tensor)
    arrays["last_obs"] = model._last_obs.copy()
    arrays["last_episode_starts"] = np.array(model._last_episode_starts, dtype=bool)
    values["episodes"] = [[float(one["r"]), int(one["l"]), float(one["t"])] for one in model.ep_info_buffer]
    # Their mean is logged, and a mean of single precision has other bits.
    values["single_precision"] = any(getattr(one["r"], "dtype", None) == np.float32 for one in model.ep_info_buffer)
    if (states := getattr(model, "_last_lstm_states", None)) is not None:
        arrays |= {f"lstm.{place}": _copied(tensor) for place, tensor in enumerate((*states.pi, *states.vf))}
    if (buffer := getattr(model, "replay_buffer", None)) is not None:
        values["buffer"] = {"pos": buffer.pos, "full": buffer.full}
        arrays |= {f"buffer.{name}": array[: buffer.size()].copy() for name, array in _buffer_arrays(buffer).items()}
    _capture_random(model, values, arrays)
    monitor, augmented, native = _layers(model)
    states = native.get_state()
    values["envs"] = [{"kind": one.kind, "values": one.values, "arrays": sorted(one.arrays)} for one in states]
    for place, one in enumerate(states):
        arrays |= {f"env.{place}.{name}": np.array(array) for name, array in one.arrays.items()}
    values["monitor"] = int(monitor.episode_count)
    arrays |= {"monitor.returns": monitor.episode_returns.copy(), "monitor.lengths": monitor.episode_lengths.copy()}
    if augmented is not None:
        values["turned"], arrays["turned"] = augmented.get_state()
    # As text, since what is logged may be no number, which JSON does not know.
    logger = model.logger
    values["logged"] = {
        name: [repr(value), logger.name_to_count.get(name, 0), list(logger.name_to_excluded.get(name, ()))]
        for name, value in plain_numbers(logger.name_to_value).items()
    }
    return ResumeState(values, arrays)


def restore(model: Any, state: ResumeState) -> None:
    """Put a model made with the same settings into a state of `capture`; a `FileFormatError` names what fails."""
    import torch

    values, arrays = state.values, state.arrays
    part = "counters"
    try:
        for name in _COUNTERS:
            if name in values:
                setattr(model, name, _counted(name, values[name]))
        part = "parameters"
        settings = {name: _group_settings(one) for name, one in _optimisers(model).items()}
        model.set_parameters(unpack(values["parameters"], arrays), exact_match=True, device="cpu")
        _check_optimisers(model, settings)
        part = "variables"
        for name, tensor in _variables(model).items():
            tensor.data.copy_(torch.from_numpy(_like(arrays, f"variable.{name}", _copied(tensor))))
        part = "episodes"
        space = model.observation_space
        seen = _like(arrays, "last_obs", np.empty((model.n_envs, *space.shape), space.dtype))
        if not ((space.low <= seen) & (seen <= space.high)).all():
            raise ValueError("`last_obs` leaves the observation space")
        model._last_obs = seen
        model._last_episode_starts = _like(arrays, "last_episode_starts", np.empty(model.n_envs, bool))
        number = np.float32 if values.get("single_precision") else float
        ended = [{"r": number(r), "l": int(length), "t": float(t)} for r, length, t in values["episodes"]]
        model.ep_info_buffer = deque(ended, maxlen=model._stats_window_size)
        model.ep_success_buffer = deque(maxlen=model._stats_window_size)
        if (states := getattr(model, "_last_lstm_states", None)) is not None:
            present = enumerate((*states.pi, *states.vf))
            tensors = [torch.from_numpy(_like(arrays, f"lstm.{place}", _copied(one))) for place, one in present]
            model._last_lstm_states = type(states)((tensors[0], tensors[1]), (tensors[2], tensors[3]))
        part = "replay buffer"
        if (buffer := getattr(model, "replay_buffer", None)) is not None:
            _restore_buffer(buffer, values, arrays)
        part = "environments"
        _restore_envs(model, values, arrays)
        part = "random generators"
        restore_random(model, state)
    except (KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError, OverflowError) as error:
        if isinstance(error, SettingsError) and part not in ("environments", "random generators"):
            raise
        raise FileFormatError(f"training state: its {part} do not fit this training: {error}") from error


def restore_random(model: Any, state: ResumeState) -> None:
    """Put the random generators, and the matrices of state-dependent noise, into a state of `capture`.

    Algorithms draw such matrices just before a rollout begins; a resumed training therefore calls this once more when
    its first rollout has begun, the moment at which the state was captured.
    """
    import torch

    values, arrays = state.values, state.arrays
    drawn = parse(_RandomStates, values["random"], "`random`")
    version, gauss = drawn.python
    random.setstate((version, tuple(arrays["random.python"].tolist()), gauss))
    kind, place, has_gauss, cached = drawn.numpy
    keys = _like(arrays, "random.numpy", np.empty(624, np.uint32))
    np.random.set_state((kind, keys, place, has_gauss, cached))  # noqa: NPY002 - theirs is global
    torch.set_rng_state(torch.from_numpy(_torch_state(arrays)))
    if (generator := generator_from(drawn.action_space)) is None:
        raise ValueError("`action_space` should be a state of numpy's PCG64")
    model.action_space.np_random.bit_generator.state = generator.bit_generator.state
    for name in _NOISE_MATRICES:
        if f"noise.{name}" in arrays:
            present = getattr(_distribution(model), name, None)
            found = arrays[f"noise.{name}"].copy()
            if present is not None and present.ndim == 3:  # a matrix for each copy; a new model has one
                present = present[:1].expand(len(found) if len(found) in (1, model.n_envs) else 1, -1, -1)
            if present is not None:
                _like(arrays, f"noise.{name}", _copied(present))
            setattr(_distribution(model), name, torch.from_numpy(found))


@schema.record
class _RandomStates:
    """The generators of Python, NumPy and the action space; what else there is of them are arrays."""

    python: tuple[Literal[3], float | None]
    numpy: tuple[Literal["MT19937"], Annotated[int, Field(ge=0, le=624)], Literal[0, 1], float]
    """Kind, place in the key, whether a second normal number is cached, and that number."""
    action_space: JsonObject


def _torch_state(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Return the state of torch's generator; it has a place in a key too, which torch bounds one by one only."""
    import torch

    found = _like(arrays, "random.torch", torch.get_rng_state().numpy())
    left, place = int(found[8:12].view(np.int32)[0]), int(found[16:24].view(np.uint64)[0])
    if not (1 <= left <= 624 and place + left <= 625):
        raise ValueError(f"`random.torch`: place {place} with {left} left in a key of 624 numbers")
    return found


def restore_log(logger: Any, state: ResumeState) -> None:
    """Log again what was logged since the last row of the log; the next row tells it."""
    for name, (text, count, excluded) in state.values.get("logged", {}).items():
        logger.name_to_value[name] = int(text) if text.lstrip("-").isdigit() else float(text)
        logger.name_to_excluded[name] = tuple(excluded)
        if count:
            logger.name_to_count[name] = count


def plain_numbers(logged: dict[str, Any]) -> dict[str, int | float]:
    """Return the numbers among what was logged, as Python's own."""
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in logged.items()}
    return {name: value for name, value in plain.items() if isinstance(value, int | float)}


def _capture_random(model: Any, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    import torch

    version, words, gauss = random.getstate()
    kind, keys, place, has_gauss, cached = np.random.get_state()  # noqa: NPY002 - the algorithms draw from it
    arrays["random.python"] = np.array(words, dtype=np.uint64)
    arrays["random.numpy"] = np.array(keys, dtype=np.uint32)
    arrays["random.torch"] = torch.get_rng_state().numpy().copy()
    values["random"] = {
        "python": [version, gauss],
        "numpy": [kind, int(place), int(has_gauss), float(cached)],
        "action_space": model.action_space.np_random.bit_generator.state,
    }
    for name in _NOISE_MATRICES:
        if model.use_sde and (matrix := getattr(_distribution(model), name, None)) is not None:
            arrays[f"noise.{name}"] = _copied(matrix)


def _distribution(model: Any) -> Any:
    return getattr(model, "actor", model.policy).action_dist


def _variables(model: Any) -> dict[str, Any]:
    """Return the tensors that a model learns outside its networks, such as SAC's entropy coefficient."""
    return {name: operator.attrgetter(name)(model) for name in model._get_torch_save_params()[1]}


def _optimisers(model: Any) -> dict[str, Any]:
    named = {name: operator.attrgetter(name)(model) for name in model._get_torch_save_params()[0]}
    return {name: one for name, one in named.items() if hasattr(one, "param_groups")}


def _group_settings(optimiser: Any) -> list[dict[str, Any]]:
    return [{name: one for name, one in group.items() if name != "params"} for group in optimiser.param_groups]


def _check_optimisers(model: Any, settings: dict[str, list[dict[str, Any]]]) -> None:
    """Refuse what torch took into its optimisers unseen: settings of other kinds, moments of other shapes."""
    for name, optimiser in _optimisers(model).items():
        for had, has in zip(settings[name], _group_settings(optimiser), strict=True):
            for key in had.keys() | has.keys():
                if _kind(had.get(key)) != _kind(has.get(key)):
                    raise ValueError(f"`{key}` of {name} should be like {had.get(key)}, but is {shown(has.get(key))}")
        for parameter, moments in optimiser.state.items():
            if any(_kind(one) is not float and one.shape not in ((), parameter.shape) for one in moments.values()):
                raise ValueError(f"{name} holds moments of another shape than the weights, {tuple(parameter.shape)}")


def _kind(value: Any) -> Any:
    """Return what tells kinds of settings apart; whole numbers may stand for others."""
    return float if type(value) is int else tuple(map(_kind, value)) if isinstance(value, tuple) else type(value)


def _buffer_arrays(buffer: Any) -> dict[str, np.ndarray]:
    return {
        name: value
        for name, value in vars(buffer).items()
        if isinstance(value, np.ndarray) and value.shape[:1] == (buffer.buffer_size,)
    }


def _restore_buffer(buffer: Any, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    place, full = values["buffer"]["pos"], values["buffer"]["full"]
    if type(place) is not int or not 0 <= place < buffer.buffer_size or not isinstance(full, bool):
        raise ValueError(f"place {shown(place)} in a buffer of {buffer.buffer_size}")
    buffer.pos, buffer.full = place, full
    filled = buffer.size()
    for name, array in _buffer_arrays(buffer).items():
        array[:filled] = _like(arrays, f"buffer.{name}", array[:filled])


def _layers(model: Any) -> tuple[Any, Any, Any]:
    """Return the monitor, the wrapper that flips and swaps PB axes or None, and the native vector environment."""
    from creative_nao.agents.augmentation import FlippedSwappedAxes

    monitor = model.get_env()
    adapter = getattr(monitor, "venv", None)
    augmented = adapter if isinstance(adapter, FlippedSwappedAxes) else None
    native = getattr(adapter if augmented is None else augmented.venv, "venv", None)
    if not hasattr(native, "get_state"):
        raise SettingsError(
            f"{monitor}: its environments have no `get_state`, so no checkpoint can be written; "
            "train on one of this project's"
        )
    return monitor, augmented, native


def _restore_envs(model: Any, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    monitor, augmented, native = _layers(model)
    native.set_state(
        [
            EnvState(one["kind"], one["values"], {name: arrays[f"env.{place}.{name}"] for name in one["arrays"]})
            for place, one in enumerate(values["envs"])
        ]
    )
    monitor.episode_returns = _like(arrays, "monitor.returns", monitor.episode_returns)
    monitor.episode_lengths = _like(arrays, "monitor.lengths", monitor.episode_lengths)
    monitor.episode_count = _counted("monitor", values["monitor"])
    if augmented is not None:
        augmented.set_state(values["turned"], _like(arrays, "turned", augmented.get_state()[1]))


def _like(arrays: dict[str, np.ndarray], name: str, example: np.ndarray | None) -> np.ndarray:
    """Return a copy of an array that has the kind and shape of the one it replaces."""
    found = arrays[name]
    if example is not None and (found.shape != example.shape or found.dtype != example.dtype):
        shapes = f"{example.dtype} of shape {example.shape}, but is {found.dtype} of {found.shape}"
        raise ValueError(f"`{name}` should be {shapes}")
    return found.copy()


def _counted(name: str, value: Any) -> Any:
    share = name == "_current_progress_remaining"  # below 0 when the last rollout goes beyond the end
    if type(value) not in ((int, float) if share else (int,)) or not (-1e9 if share else 0) <= value <= 10**15:
        raise ValueError(f"`{name}` should be a number of at least 0, but is {shown(value)}")
    return value


def _copied(tensor: Any) -> np.ndarray:
    return tensor.detach().cpu().numpy().copy()


def pack(value: Any, path: str, arrays: dict[str, np.ndarray]) -> Any:
    """Return `value` as plain values; its tensors go to `arrays` under their path."""
    import torch

    if isinstance(value, torch.Tensor):
        arrays[path] = _copied(value)
        return {"tensor": path}
    if isinstance(value, dict):
        return {"items": [[key, pack(one, f"{path}.{key}", arrays)] for key, one in value.items()]}
    if isinstance(value, list | tuple):
        parts = [pack(one, f"{path}.{place}", arrays) for place, one in enumerate(value)]
        return {"list" if isinstance(value, list) else "tuple": parts}
    return {"value": value}


def unpack(packed: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    """Return the value that `pack` gave as plain values and `arrays`."""
    import torch

    (kind, inside), *_ = packed.items()
    if kind == "tensor":
        return torch.from_numpy(arrays[inside].copy())
    if kind == "items":
        return {key: unpack(one, arrays) for key, one in inside}
    if kind in ("list", "tuple"):
        parts = [unpack(one, arrays) for one in inside]
        return parts if kind == "list" else tuple(parts)
    return inside


@dataclass
class TrainingRecord:
    """The record of a training; it grows while the training runs.

    Attributes:
        episode_ends: Decisions made, over all copies, when each training episode ended.
        episode_rewards: Reward of each.
        evaluation_ends: Decisions made when each evaluation took place.
        evaluations: Rewards of the episodes of each evaluation.
        best_weights: Weights of the policy at the best evaluation. The one before any training does not count: where
            no training helps, an untrained policy should not pass for a trained one.
    """

    episode_ends: list[int] = field(default_factory=list)
    episode_rewards: list[float] = field(default_factory=list)
    evaluation_ends: list[int] = field(default_factory=list)
    evaluations: list[tuple[float, ...]] = field(default_factory=list)
    best_weights: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def best_mean(self) -> float:
        """Highest mean reward of an evaluation after training began, minus infinity before the first."""
        ends = zip(self.evaluation_ends, self.evaluations, strict=True)
        return max((float(np.mean(one)) for end, one in ends if end > 0), default=-np.inf)

    def evaluated(self, n_decisions: int, rewards: tuple[float, ...], weights: dict[str, np.ndarray]) -> None:
        """Take an evaluation in, and its weights if it is the best so far."""
        if not self.best_weights or float(np.mean(rewards)) > self.best_mean:
            self.best_weights = weights
        self.evaluation_ends.append(n_decisions)
        self.evaluations.append(rewards)


@schema.record
class _Header:
    """Of a checkpoint."""

    format_version: Version1
    plan: JsonObject
    state: JsonObject


_COLUMNS = {"episode_ends": np.int64, "episode_rewards": np.float64, "evaluation_ends": np.int64}


def save_checkpoint(path: Path, plan: dict[str, Any], record: TrainingRecord, state: ResumeState) -> None:
    """Write record and state of a training in one step."""
    arrays = {f"state.{name}": array for name, array in state.arrays.items()}
    arrays |= {f"best.{name}": array for name, array in record.best_weights.items()}
    arrays |= {f"record.{name}": np.array(getattr(record, name), dtype) for name, dtype in _COLUMNS.items()}
    arrays["record.evaluations"] = np.array(record.evaluations, np.float64)
    header = {"format_version": 1, "plan": plan, "state": state.values}
    save_tensors(path, kind=KIND, header=header, tensors=arrays)


def load_checkpoint(path: Path, plan: dict[str, Any]) -> tuple[TrainingRecord, ResumeState]:
    """Read a file of `save_checkpoint`; that it is of another plan is a `SettingsError` that names the setting."""
    values, arrays = load_tensors(path, kind=KIND)
    header = parse(_Header, values, f"{path}: header")
    if isinstance(settings := header.plan.get("hyperparameters"), dict):
        policy = str(settings.get("policy"))
        settings["policy"] = RELEASED_NAMES.get(policy, policy)
    if (name := _difference(header.plan, plan)) is not None:
        raise SettingsError(
            f"{path} is of a training with another `{name}`; give the same settings to go on, or another --out"
        )
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise FileFormatError(f"{path}: the array `{name[:60]}` should hold finite numbers, but does not")
    ends, rewards, evaluation_ends = (
        take(path, arrays, f"record.{name}", (None,), dtype, kinds="if") for name, dtype in _COLUMNS.items()
    )
    n_axes = 2 if len(evaluation_ends) else 1  # an empty list is written as an array of shape (0,)
    evaluations = take(path, arrays, "record.evaluations", (None,) * n_axes, np.float64)
    if len(ends) != len(rewards) or len(evaluation_ends) != len(evaluations):
        lengths = {f"record.{name}": len(arrays[f"record.{name}"]) for name in (*_COLUMNS, "evaluations")}
        raise FileFormatError(f"{path}: the arrays of the record have different lengths: {lengths}")
    known = [f"record.{one.name}" for one in dataclasses.fields(TrainingRecord)]
    only_arrays(path, [name for name in arrays if not name.startswith(("state.", "best."))], known)
    state, best = (
        {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
        for prefix in ("state.", "best.")
    )
    rows = [tuple(row) for row in evaluations.tolist()] if len(evaluations) else []
    record = TrainingRecord(ends.tolist(), rewards.tolist(), evaluation_ends.tolist(), rows, best)
    return record, ResumeState(header.state, state)


def check_weights(weights: dict[str, np.ndarray], policy: Any) -> None:
    """Refuse weights that a policy cannot take: a `FileFormatError` names the first of them."""
    expected = {name: tuple(tensor.shape) for name, tensor in policy.state_dict().items()}
    shapes = {name: array.shape for name, array in weights.items()}
    for name in sorted(expected.keys() | shapes.keys()) if weights else ():
        if (should_be := expected.get(name)) != (shape := shapes.get(name)):
            raise FileFormatError(
                f"training state: its best weights `{name[:60]}` should have shape {should_be}, but have {shape}"
            )


def _difference(one: dict[str, Any], other: dict[str, Any], prefix: str = "") -> str | None:
    for name in sorted(one.keys() | other.keys()):
        left, right = one.get(name), other.get(name)
        if isinstance(left, dict) and isinstance(right, dict):
            if (found := _difference(left, right, f"{prefix}{name}.")) is not None:
                return found
        elif left != right:
            return prefix + name
    return None
