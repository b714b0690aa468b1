"""A boxing world in a few lines: the environments' interface without network or physics.

It registers `Fake/Boxing-v0` and `Fake/BoxingMental-v0` in Gymnasium; a job's process finds them as
`fake_boxing:Fake/Boxing-v0`. A trajectory is a smooth function of the PB vector, so novelty and outcomes are plain.
"""

import os
import signal
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np

N_STEPS = 10
NAMES = ("jab_left", "straight_right", "hook_left")


class FakeMemory:
    """Three basic actions at three PB vectors, and everything between."""

    def __init__(self, name):
        if name != "fake/0":
            raise ValueError(f"the fake world has one memory, `fake/0`, not `{name}`")
        self.name = name
        self.dt_s = 0.15
        self.network = SimpleNamespace(n_pb=2)
        self.pb = np.array([[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]])
        self.demonstrations = SimpleNamespace(
            names=NAMES, trajectories=list(self.generate(self.pb)), dt_s=0.15, joints=tuple("abcdefgh")
        )

    def generate(self, pb):
        pb = np.atleast_2d(np.asarray(pb, dtype=np.float64))
        time = np.sin(np.linspace(0.0, np.pi, N_STEPS))[:, None]
        weights = np.stack([np.cos(np.arange(8)), np.sin(np.arange(8))])
        return time * (pb @ weights)[:, None, :]


class FakeBoxing(gym.Env):
    """Thirty PB vectors an episode; those near the rim of the square are inappropriate, and wider so in physics."""

    action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = gym.spaces.Box(-1.0, 1.0, (4,), np.float32)

    def __init__(self, memory="fake/0", physical=True):
        self.memory = FakeMemory(memory)
        self.physical = physical
        self.rim = 0.8 if physical else 0.9

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.repertoire, self.step_ = [], 0
        return np.zeros(4, np.float32), {}

    def step(self, action):
        pb = np.asarray(action, dtype=np.float64)
        trajectory = self.memory.generate(pb)[0]
        demonstrations = self.memory.demonstrations.trajectories
        to_basic = [float(np.abs(trajectory - other).sum()) for other in demonstrations]
        to_known = min(to_basic + [float(np.abs(trajectory - other).sum()) for other in self.repertoire])
        appropriate = bool(np.abs(pb).max() < self.rim)
        outcome = ("learned" if min(to_basic) < 10.0 else "unlearned") if appropriate else "fluctuating"
        if not appropriate and self.physical:
            outcome = "fell"
        reward = to_known / 30.0 if appropriate else 0.0
        if appropriate:
            self.repertoire.append(trajectory)
        self.step_ += 1
        truncated = self.step_ == 30
        nearest = int(np.argmin(to_basic))
        info = {
            "pb": pb.copy(),
            "outcome": outcome,
            "appropriate": appropriate,
            "nearest": nearest,
            "nearest_name": NAMES[nearest],
            "distance": min(to_basic),
            "known_distance": to_known,
            "reward_novelty": reward,
            "repertoire_size": len(self.repertoire),
            "step": self.step_,
            "trajectory": trajectory,
        }
        if truncated:
            kept = self.repertoire
            info["episode_measures"] = {
                "appropriateness_pct": 100.0 * len(kept) / 30,
                "novelty": float(np.mean([min(np.abs(k - d).sum() for d in demonstrations) for k in kept]))
                if kept
                else None,
                "diversity": float(np.mean([np.abs(a - b).sum() for a in kept for b in kept if a is not b]))
                if len(kept) > 1
                else None,
            }
        observation = np.array([*pb, reward / 10.0, self.step_ / 30.0], np.float32).clip(-1.0, 1.0)
        return observation, reward, False, truncated, info


class Target(gym.Env):
    """The nearer the PB vector to (0.5, -0.5), the better: what any learner learns."""

    action_space = FakeBoxing.action_space
    observation_space = FakeBoxing.observation_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.step_ = 0
        return np.zeros(4, np.float32), {}

    def step(self, action):
        self.step_ += 1
        reward = 1.0 - float(np.linalg.norm(np.asarray(action) - [0.5, -0.5]))
        return np.zeros(4, np.float32), reward, False, self.step_ == 30, {}


class Deadly(FakeBoxing):
    """Kills its own process as it is made: always, or once if FAKE_DEATH_MARK names a file to remember it by."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        mark = os.environ.get("FAKE_DEATH_MARK")
        if mark is None or not Path(mark).exists():
            if mark is not None:
                Path(mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)


gym.register("Fake/Deadly-v0", entry_point=Deadly)
gym.register("Fake/Target-v0", entry_point=Target)
gym.register("Fake/Boxing-v0", entry_point=FakeBoxing)
gym.register("Fake/BoxingMental-v0", entry_point=FakeBoxing, kwargs={"physical": False})
