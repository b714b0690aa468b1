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
    header, tensors = load_tensors(path, kind=KIND)
    expected = _identity(demonstrations, network, training)
    for part in ("network", "training"):
        found = header.get(part)
        if not isinstance(found, dict):
            raise FileFormatError(f"{path}: the header of the checkpoint lacks `{part}`")
        for field, value in expected[part].items():
            came = found.get(field)
            came = tuple(came) if isinstance(came, list) else came
            if came != value and field != "n_epochs":
                raise SettingsError(f"{path}: made with {field}={came!r}, but {field}={value!r} is asked for")
    if header.get("demonstrations") != expected["demonstrations"]:
        raise SettingsError(f"{path}: made with other demonstrations than those given")
    n_codes = demonstrations.n_joints * network.n_softmax_units
    size = n_parameters(parameter_shapes(network, n_codes, demonstrations.n_actions))
    vectors = {name: take(path, tensors, name, (size,)).astype(np.float32) for name in _VECTORS}
    history = take(path, tensors, "loss_history", (None,)).astype(np.float64)
    try:
        best_loss = math.inf if header["best_loss"] is None else float(header["best_loss"])
        best_epoch = int(header["best_epoch"])
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: the header of the checkpoint lacks or breaks a field: {error}") from error
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
