"""One small good file of every kind that is read from users, and how it is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao.agents import BundleHeader, PPOSettings, load_agent, save_bundle
from creative_nao.agents.hyperparameters import read_hyperparameters
from creative_nao.agents.ppo import build_policy
from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.csv_format import load_trajectory, save_trajectory
from creative_nao.envs import EnvState
from creative_nao.envs.physical_chart import FIGURES, PhysicalMap
from creative_nao.evaluation.folder import read_record, write_record
from creative_nao.evaluation.results import read_results, write_results
from creative_nao.evaluation.suites import read_suite
from creative_nao.explorer.session import Favourite, Session
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, train_network
from creative_nao.model.checkpoint import load_checkpoint, save_checkpoint
from creative_nao.model.engine import TrainingState
from creative_nao.pb_space import PBMap, pb_grid

NETWORK = NetworkSettings(layer_sizes=(3,), time_constants=(2.0,), n_softmax_units=2)
TRAINING = TrainingSettings(n_epochs=1)
ENV = "CreativeNao/BoxingMental-v0"


@dataclass(frozen=True)
class Victim:
    """A good file and its loader."""

    path: Path
    load: Callable[[Path], Any]
    torn: bool = True
    """Whether every shorter beginning of it is broken."""


def taught() -> Demonstrations:
    """Two short actions of one joint."""
    rise = np.linspace(0.1, 0.5, 4)[:, None]
    return Demonstrations(("rise", "fall"), [rise, rise[::-1]], 0.1, ("RElbowYaw",))


def make_victims(folder: Path) -> dict[str, Victim]:
    """Write one good file of every kind into `folder`."""
    demos = taught()
    memory = train_network(demos, TRAINING, NETWORK, command="test")
    found = {
        "memory": Victim(memory.save(folder / "memory.safetensors"), Memory.read),
        "checkpoint": _checkpoint(folder / "checkpoint.safetensors", memory),
        "bundle": _bundle(folder / "bundle.safetensors"),
        "state": Victim(
            EnvState("Boxing", {"n": 1}, {"x": np.zeros(2)}).save(folder / "state.safetensors"), EnvState.load
        ),
        "map": Victim(_chart().save(folder / "map.npz"), PBMap.load),
        "physical": Victim(_physical().save(folder / "physical.npz"), PhysicalMap.load),
        "csv": Victim(
            save_trajectory(folder / "rise.csv", demos.trajectories[0], 0.1, demos.joints),
            lambda path: load_trajectory(path, joints=demos.joints),
            torn=False,
        ),
        "yaml": _text(folder / "ppo.yml", YAML, lambda path: read_hyperparameters("ppo", ENV, path)),
        "toml": _text(folder / "mine.toml", TOML, read_suite),
        "session": Victim(_session(folder / "explorer.json"), lambda path: Session(path)._favourites),
    }
    record = {"settings": {"suite": {"name": "quick"}, "seed": 0}, "versions": {"numpy": "2"}, "command": "x"}
    found["record"] = Victim(write_record(folder, record), _in_a_run_folder)
    results = {"suite": "quick", "rows": [{"agent": "random", "reward": 1.5}], "summary": None}
    found["results"] = Victim(write_results(folder / "results.json", results), read_results)
    return found


YAML = f"{ENV}:\n  n_timesteps: !!float 1e4\n  n_envs: 1\n  policy: MlpPolicy\n  n_steps: 64\n  batch_size: 32\n"
TOML = f'agents = ["random"]\nenvs = ["{ENV}"]\nmemories = ["half/0"]\nn_seeds = 2\nn_actions = 3\n'


def _text(path: Path, text: str, load: Callable[[Path], Any]) -> Victim:
    path.write_text(text, encoding="utf-8")
    return Victim(path, load, torn=False)


def _in_a_run_folder(path: Path) -> Any:
    """`read_record` takes the folder; a broken file of any name is put in place first."""
    target = path.with_name("run.json")
    if target != path:
        target.unlink(missing_ok=True)
        target.symlink_to(path)
    return read_record(path.parent)


def _checkpoint(path: Path, memory: Memory) -> Victim:
    n = sum(array.size for array in memory.parameters.values())
    state = TrainingState(*[np.zeros(n, dtype=np.float32)] * 4, np.ones(1), 1.0, 1)
    save_checkpoint(path, state, memory.demonstrations, NETWORK, TRAINING)
    return Victim(path, lambda path: load_checkpoint(path, memory.demonstrations, NETWORK, TRAINING))


def _bundle(path: Path) -> Victim:
    box = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    settings = PPOSettings(n_timesteps=64, n_envs=1, n_steps=64, batch_size=32, hidden=(2,))
    header = BundleHeader("ppo", settings, ENV, "half/0", 0, 64, box, box)
    return Victim(save_bundle(path, header, build_policy(box, box, settings)), load_agent)


def _chart() -> PBMap:
    learned = np.array([[0.5, 0.5]])
    return PBMap(2, pb_grid(2), np.array(["learned"] * 4), np.zeros(4, int), np.ones(4), learned, ("rise",), {})


def _physical() -> PhysicalMap:
    words = np.array(["learned"] * 4)
    figures = {name: np.zeros(4, dtype=np.float32) for name in FIGURES}
    return PhysicalMap(
        resolution=2, pb=pb_grid(2), outcome=words, mental=words, fault=np.array([""] * 4), nearest=np.zeros(4, int),
        distance=np.ones(4, dtype=np.float32), figures=figures, learned_pb=np.array([[0.5, 0.5]]), names=("rise",),
        record={}, n_done=4, wall_s=1.0, cpu_s=1.0,
    )  # fmt: skip


def _session(path: Path) -> Path:
    Session(path).add(Favourite("abc", ((0.1, 0.2),), "a note"))
    return path
