"""Keep the state of a training run in a file, so that a killed run goes on with the same bits."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.fields import Fields, only_arrays, shown
from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.engine import TrainingState
from creative_nao.model.parameters import n_parameters, parameter_shapes
from creative_nao.tensorfile import load_tensors, save_tensors, take

KIND = "checkpoint"
_VECTORS = ("vector", "first_moment", "second_moment", "best_vector")


def save_checkpoint(
    path: str | os.PathLike[str],
    state: TrainingState,
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
) -> Path:
    """Write the state and what it belongs to, in one step."""
    header = {
        **_identity(demonstrations, network, training),
        "best_loss": state.best_loss if math.isfinite(state.best_loss) else None,
        "best_epoch": state.best_epoch,
    }
    tensors = {name: getattr(state, name) for name in _VECTORS}
    return save_tensors(path, kind=KIND, header=header, tensors={**tensors, "loss_history": state.loss_history})


def load_checkpoint(
    path: str | os.PathLike[str], demonstrations: Demonstrations, network: NetworkSettings, training: TrainingSettings
) -> TrainingState:
    """Read a state back.

    Raises:
        SettingsError: If it belongs to other settings or demonstrations; the message names the field. Only the number
            of epochs may differ, so that a finished run can be continued.
        FileFormatError: If the file is torn or foreign.
    """
    values, tensors = load_tensors(path, kind=KIND)
    header = Fields(values, f"{path}: header")
    expected = _identity(demonstrations, network, training)
    for part in ("network", "training"):
        found = header.object(part).values
        for field, value in expected[part].items():
            came = found.get(field)
            came = tuple(came) if isinstance(came, list) else came
            if (came != value or isinstance(came, bool) is not isinstance(value, bool)) and field != "n_epochs":
                raise SettingsError(f"{path}: made with {field}={shown(came)}, but {field}={value!r} is asked for")
    if header.any("demonstrations") != expected["demonstrations"]:
        raise SettingsError(f"{path}: made with other demonstrations than those given")
    n_codes = demonstrations.n_joints * network.n_softmax_units
    size = n_parameters(parameter_shapes(network, n_codes, demonstrations.n_actions))
    only_arrays(path, tensors, [*_VECTORS, "loss_history"])
    vectors = {name: take(path, tensors, name, (size,), np.float32) for name in _VECTORS}
    if (vectors["second_moment"] < 0).any():
        raise FileFormatError(f"{path}: the array `second_moment` should hold means of squares, but some are below 0")
    history = take(path, tensors, "loss_history", (None,), np.float64)
    best_loss = math.inf if header.any("best_loss") is None else header.number("best_loss")
    best_epoch = header.whole("best_epoch", least=0, most=len(history))
    return TrainingState(**vectors, loss_history=history, best_loss=best_loss, best_epoch=best_epoch)


def _identity(demonstrations: Demonstrations, network: NetworkSettings, training: TrainingSettings) -> dict[str, Any]:
    digest = hashlib.sha256(repr((demonstrations.names, demonstrations.joints, demonstrations.dt_s)).encode())
    for trajectory in demonstrations.trajectories:
        digest.update(np.ascontiguousarray(trajectory).tobytes())
    return {
        "network": dataclasses.asdict(network),
        "training": dataclasses.asdict(training),
        "demonstrations": digest.hexdigest(),
    }
