"""Settings of a policy network out of a file: kinds and sizes checked before anything is built of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from creative_nao.errors import SettingsError
from creative_nao.fields import shown

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
