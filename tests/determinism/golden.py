"""The golden numbers: a little of everything that must not depend on threads, and the versions it depends on.

Run as a program, it prints what this process computes as JSON; a first argument pins it to so many processor cores.
"""

import json
import os
import sys
from importlib.metadata import version
from pathlib import Path

import gymnasium as gym
import llvmlite.binding
import numpy as np
import torch

import creative_nao as cn
from creative_nao.model import NetworkSettings, TrainingSettings, train_network

FILE = Path(__file__).parents[1] / "reference" / "golden.json"
DECIDING = ("mujoco", "numba", "numpy", "torch")

TOLERANCES = {
    "generated": (0.0, 1e-3),
    "distances": (1e-3, 0.0),
    "map_counts": (0.0, 4.0),
    "mental_rewards": (1e-3, 1e-3),
    "performed": (0.0, 1e-3),
    "training_losses": (1e-3, 0.0),
    "reference_losses": (1e-3, 0.0),
}
"""Relative and absolute tolerance of each quantity on another processor or other versions (docs/determinism.md)."""


def key() -> str:
    """Return what the bits depend on: the versions and the processor that code is compiled for."""
    versions = " ".join(f"{name}-{version(name)}" for name in DECIDING)
    return f"{versions} {os.environ.get('NUMBA_CPU_NAME') or llvmlite.binding.get_host_cpu_name()}"


def compute() -> dict[str, list]:
    """Return every golden quantity as lists of plain numbers."""
    memory, demos = cn.load_memory("half/0"), cn.load_demonstrations()
    points = np.random.default_rng(0).uniform(-1, 1, (24, 2))
    generated = memory.generate(points)
    chart = cn.pb_map(memory, resolution=40)
    found = {
        "generated": generated[:, 9::10].ravel(),  # posture at ticks 9, 19, ... [rad]
        "distances": cn.measures.dtw_matrix(list(generated), demos.trajectories).ravel(),
        "map_counts": [np.sum(chart.outcome == name) for name in ("learned", "unlearned", "fluctuating", "non_moving")],
        "mental_rewards": _play("CreativeNao/BoxingMental-v0", points.reshape(3, 8, 2))[0],
        "performed": _play("CreativeNao/Boxing-v0", points[:3].reshape(1, 3, 2))[1][:, 9::10].ravel(),
        "training_losses": np.concatenate(
            [one.loss_history for one in cn.train(demos, seeds=[0, 1], n_epochs=20, closed_loop_ratio=0.5)]
        ),
        "reference_losses": train_network(
            demos,
            TrainingSettings(n_epochs=2, seed=0, engine="reference"),
            NetworkSettings(layer_sizes=(12, 6, 3)),
            command="golden",
        ).loss_history,
    }
    return {name: np.asarray(values, dtype=float).tolist() for name, values in found.items()}


def _play(name: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rewards of a vector environment and the trajectories that were scored in its last step."""
    envs = gym.make_vec(name, points.shape[1], vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    rewards, info = [], {}
    for actions in points:
        _, reward, _, _, info = envs.step(actions.astype(np.float32))
        rewards.append(reward)
    envs.close()
    return np.concatenate(rewards), np.stack(list(info["trajectory"]))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        cores = sorted(os.sched_getaffinity(0))[: int(sys.argv[1])]
        os.sched_setaffinity(0, cores)
        torch.set_num_threads(int(sys.argv[1]))
    json.dump({"key": key(), "values": compute()}, sys.stdout)
