"""Settings of a reproduction: where its networks come from and how finely their maps are scored."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from creative_nao.errors import SettingsError
from creative_nao.model import NetworkSettings

Source = Literal["shipped", "retrain", "quick"]


@dataclass(frozen=True)
class PaperSettings:
    """What is reproduced.

    Raises:
        SettingsError: If a count is too small; the message names the field.
    """

    source: Source = "shipped"
    """`shipped`: the bank of the package; `retrain`: networks trained in the run folder; `quick`: few and short."""
    seed: int = 0
    """Seed of all draws; networks that are trained have this seed and those after it."""
    n_seeds: int = 10
    """Networks trained per condition; has no meaning for the shipped ones."""
    n_epochs: int = 100_000
    """Epochs of each; has no meaning for the shipped ones."""
    resolution: int = 200
    """Points along each axis of a map."""
    network: NetworkSettings = field(default_factory=NetworkSettings)
    """Network that is trained; has no meaning for the shipped ones."""

    def __post_init__(self) -> None:
        for name, least in {"seed": 0, "n_seeds": 1, "n_epochs": 1, "resolution": 2}.items():
            if getattr(self, name) < least:
                raise SettingsError(f"`{name}` should be at least {least}, but is {getattr(self, name)}")

    @property
    def trains(self) -> bool:
        """Whether networks are trained for it."""
        return self.source != "shipped"


QUICK_SEEDS, QUICK_EPOCHS = 3, 20_000


def paper_settings(*, quick: bool = False, retrain: bool = False, seed: int = 0) -> PaperSettings:
    """Return the settings that the command's flags ask for.

    Raises:
        SettingsError: If both `quick` and `retrain` are asked for.
    """
    if quick and retrain:
        raise SettingsError("--quick trains its own few networks; leave out --retrain, or --quick")
    if quick:
        return PaperSettings("quick", seed, QUICK_SEEDS, QUICK_EPOCHS)
    return PaperSettings("retrain" if retrain else "shipped", seed)
