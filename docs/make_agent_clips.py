"""Draw a clip of what each shipped agent finds on a validation memory: docs/images/agents/*.gif.

Usage: python docs/make_agent_clips.py [NAME ...], all shipped agents without a name.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao import load_memory
from creative_nao.agents import load_agent, make_agent, shipped_agents
from creative_nao.agents.play import make_env
from creative_nao.evaluation.protocol import play
from creative_nao.robot import imagined_frames, pictures, write_gif
from creative_nao.robot.scene import Scene

FOLDER = Path(__file__).parent / "images" / "agents"
MEMORY, SEED = "half/10", 100
N_FINDS = 3
TICKS = slice(0, 18)
"""The first punch, or what stands in its place; a movement repeats itself after it."""
SIZE_PX = (168, 180)
LARGEST_BYTES = 300_000


class Recorder(gym.Wrapper):
    """Keeps the reward and the trajectory of every movement that was accepted."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.finds: list[tuple[float, np.ndarray]] = []

    def step(self, action: Any) -> Any:
        """Step, and keep what was found."""
        told = self.env.step(action)
        if told[4].get("appropriate"):
            self.finds.append((float(told[1]), np.asarray(told[4]["trajectory"])))
        return told


def clip(name: str) -> Path:
    """Draw the finds of one episode that earned most, one after the other."""
    score = load_agent(name).header.score
    assert score is not None
    env = Recorder(make_env(score.env, memory=MEMORY))
    play(make_agent(name), env, env_id=score.env, memory=MEMORY, seed=SEED)
    best = sorted(env.finds, key=lambda find: -find[0])[:N_FINDS]
    env.close()
    dt_s = load_memory(MEMORY).demonstrations.dt_s
    scene = Scene(with_bag=False)  # it would hide an arm
    frames = [imagined_frames(scene, trajectory[TICKS], dt_s, frame_dt_s=dt_s) for _, trajectory in best]
    width, height = SIZE_PX
    images = pictures(scene, np.concatenate(frames), camera="close", width=width, height=height, smooth=2)
    path = write_gif(images, FOLDER / f"{name.replace('/', '-')}.gif", frame_dt_s=dt_s)
    if path.stat().st_size > LARGEST_BYTES:
        raise SystemExit(f"{path} is larger than {LARGEST_BYTES} bytes: {path.stat().st_size}")
    return path


def main() -> None:
    """Draw the clips of the agents named."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[1:] or shipped_agents():
        path = clip(name)
        print(f"{path.name}: {path.stat().st_size} bytes")  # noqa: T201


if __name__ == "__main__":
    main()
