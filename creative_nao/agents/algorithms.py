"""The algorithms of Stable-Baselines3 and sb3-contrib that can be trained here, and the settings of their policies."""

from __future__ import annotations

import importlib
import inspect
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name
from creative_nao.schema import Field, checked

CELL_POLICY = "creative_nao.agents.CellPolicy"
"""PPO's policy over the cells of the PB space, by a dotted path as RL Zoo reads it."""
CELL_SAC_POLICY = "creative_nao.agents.CellSACPolicy"
"""The same for SAC."""
_RELEASED_NAMES = {
    "creative_nao.agents.cell_policy.CellPolicy": CELL_POLICY,
    "creative_nao.agents.cell_sac.CellSACPolicy": CELL_SAC_POLICY,
}
"""Names of policies in files of release 0.1.0; a name is looked up here, and nothing is imported by it."""


@dataclass(frozen=True)
class Algorithm:
    """One learning algorithm.

    Attributes:
        name: As RL Zoo calls it.
        package: `stable_baselines3` or `sb3_contrib`.
        class_name: Its class there.
        on_policy: Whether it learns from whole rollouts of its present policy, and keeps no replay buffer.
        policies: Names of policies it may have; the first is the default.
        acting: Prefix of the weights that choosing an action needs; a bundle keeps these only.
    """

    name: str
    package: str
    class_name: str
    on_policy: bool
    policies: tuple[str, ...] = ("MlpPolicy",)
    acting: str = ""

    def load(self) -> Any:
        """Return the class.

        Raises:
            MissingDependencyError: If its package is not installed.
        """
        try:
            return getattr(importlib.import_module(self.package), self.class_name)
        except ImportError as error:
            raise MissingDependencyError(
                f"agent `{self.name}` needs {self.package.replace('_', '-')}, which is not installed; "
                'install it with: pip install "creative-nao[agents]"'
            ) from error

    def policy_class(self, policy: str) -> Any:
        """Return the class of a policy, one of `policies`."""
        if policy in (CELL_POLICY, CELL_SAC_POLICY):
            from creative_nao.agents import cells

            return cells.CellPolicy if policy == CELL_POLICY else cells.CellSACPolicy
        return self.load().policy_aliases[policy]

    def parameters(self) -> dict[str, inspect.Parameter]:
        """Return the settings of its constructor by name, those left out that are made here and not set by a user."""
        return _settable(self.load(), _MADE_HERE)

    def policy_parameters(self, policy: str) -> dict[str, inspect.Parameter]:
        """Return the settings of a policy's constructor by name."""
        return _settable(self.policy_class(policy), ("self", "observation_space", "action_space", "lr_schedule"))


ALGORITHMS = {
    one.name: one
    for one in (
        Algorithm("ppo", "stable_baselines3", "PPO", on_policy=True, policies=("MlpPolicy", CELL_POLICY)),
        Algorithm(
            "sac", "stable_baselines3", "SAC", on_policy=False, policies=("MlpPolicy", CELL_SAC_POLICY), acting="actor."
        ),
        Algorithm("td3", "stable_baselines3", "TD3", on_policy=False, acting="actor."),
        Algorithm("recurrent_ppo", "sb3_contrib", "RecurrentPPO", on_policy=True, policies=("MlpLstmPolicy",)),
        Algorithm("tqc", "sb3_contrib", "TQC", on_policy=False, acting="actor."),
        Algorithm("crossq", "sb3_contrib", "CrossQ", on_policy=False, acting="actor."),
    )
}
"""Every algorithm by name. RL Zoo calls RecurrentPPO `ppo_lstm`; `find_algorithm` knows both."""

_ALIASES = {"ppo_lstm": "recurrent_ppo"}
_MADE_HERE = (
    "self", "policy", "env", "policy_kwargs", "action_noise", "replay_buffer_class", "replay_buffer_kwargs",
    "rollout_buffer_class", "rollout_buffer_kwargs", "optimize_memory_usage", "stats_window_size", "tensorboard_log",
    "verbose", "seed", "device", "_init_setup_model",
)  # fmt: skip


def find_algorithm(name: str) -> Algorithm:
    """Return the algorithm of this name.

    Raises:
        NotFoundError: If there is none; the message offers the nearest name.
    """
    name = _ALIASES.get(name, name)
    if name not in ALGORITHMS:
        raise NotFoundError(
            f"no learning agent `{name}`{nearest_name(name, ALGORITHMS)}; there are {', '.join(ALGORITHMS)}"
        )
    return ALGORITHMS[name]


def policy_name(name: str) -> str:
    """Return the present name of a policy that a file names."""
    return _RELEASED_NAMES.get(name, name)


def _settable(of: Any, left_out: tuple[str, ...]) -> dict[str, inspect.Parameter]:
    found = inspect.signature(of.__init__).parameters
    return {name: one for name, one in found.items() if name not in left_out and one.kind is not one.VAR_KEYWORD}


ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Softplus")
"""Activations that a policy may have, classes of `torch.nn`."""
MAX_WEIGHTS = 20_000_000
"""Of all networks of a policy together, targets included: 80 MB."""
Widths = Annotated[tuple[Annotated[int, Field(ge=1, le=4096)], ...], Field(max_length=16)]
"""Units of the hidden layers of a network, layer by layer."""
_NETS = ("pi", "vf", "qf")
_POLICY_SETTINGS: dict[str, Any] = {
    "activation_fn": str,
    "n_critics": Annotated[int, Field(ge=1, le=10)],
    "n_quantiles": Annotated[int, Field(ge=1, le=1_000)],
    "lstm_hidden_size": Annotated[int, Field(ge=1, le=2048)],
    "n_lstm_layers": Annotated[int, Field(ge=1, le=8)],
    "renorm_warmup_steps": Annotated[int, Field(ge=1, le=10**9)],
    "width": Annotated[int, Field(ge=1, le=512)],
    "n_layers": Annotated[int, Field(ge=1, le=16)],
    "log_std_init": Annotated[float, Field(ge=-20.0, le=20.0)],
    "clip_mean": Annotated[float, Field(ge=-1e6, le=1e6)],
    "batch_norm_momentum": Annotated[float, Field(ge=-1.0, le=1.0)],
    "batch_norm_eps": Annotated[float, Field(ge=-1.0, le=1.0)],
    "optimizer_kwargs": dict[str, float | bool],
}


def check_policy_settings(settings: Mapping[str, Any]) -> None:
    """Refuse settings of a policy that are of the wrong kind or ask for a network beyond reason.

    Args:
        settings: By name, as the policies of Stable-Baselines3 take them; an activation as its name.

    Raises:
        SettingsError: Naming the setting.
    """
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
    """Return the widths of the layers of each network that `net_arch` describes.

    Raises:
        SettingsError: If it is no list of widths, and no mapping of `pi`, `vf` and `qf` to such lists.
    """
    if value is None:
        return {}
    if isinstance(value, Mapping):
        return checked(dict[Literal["pi", "vf", "qf"], Widths], value, "net_arch")
    return dict.fromkeys(_NETS, checked(Widths, value, "net_arch"))
