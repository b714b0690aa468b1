"""A wrapper that gives `CreativeNao/Boxing-v0` a slightly different robot every episode (domain randomisation)."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.model.config import check_kind
from creative_nao.robot import RobotVariation


@dataclasses.dataclass(frozen=True)
class VariationRanges:
    """From where to where each figure of the robot is drawn, evenly; the names are those of `robot.RobotVariation`."""

    mass: tuple[float, float] = (0.97, 1.03)
    """The complete robot is sold 2.2 % heavier than the sum of its links."""
    friction: tuple[float, float] = (0.55, 1.33)
    """Sliding friction 0.5, of one published description, to 1.2, the upper end of another's range."""
    kp: tuple[float, float] = (0.8, 1.25)
    """Gains are not published; beyond this the basic actions fail on the body (benchmarks/physics.py)."""
    kd: tuple[float, float] = (0.8, 1.25)
    latency_s: tuple[float, float] = (0.0, 0.02)
    """None to two cycles of the robot's device controller."""
    encoder_noise_rad: tuple[float, float] = (0.0, 0.0015)
    """Up to about one count of the 12-bit encoders."""

    def __post_init__(self) -> None:
        """Refuse ranges that are none, or whose ends are no robot."""
        for field in dataclasses.fields(self):
            low, high = getattr(self, field.name)
            if not low <= high:
                raise SettingsError(f"`{field.name}` should be a range (low, high), but is ({low}, {high})")
            for end in (low, high):
                RobotVariation(**{field.name: end})

    def draw(self, rng: np.random.Generator) -> RobotVariation:
        """Draw a robot; every figure takes one number of the generator, also where a range is a point."""
        names = [field.name for field in dataclasses.fields(self)]
        return RobotVariation(**{name: float(rng.uniform(*getattr(self, name))) for name in names})


class RandomisedRobot(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """Draws a new robot at every reset: mass, friction, gains, latency and encoder noise.

    What was drawn is in the `info` of `reset` under `variation`, as a dictionary. The draws depend on the seed of
    `reset` alone; without a seed they go on from the one before. States of the wrapped environment (`get_state`) do not
    hold the robot that was drawn.

    Args:
        env: A `CreativeNao/Boxing-v0`, wrapped or not.
        ranges: From where to where each figure is drawn.

    Raises:
        SettingsError: If no robot performs in the environment.

    Example:
        >>> import gymnasium as gym
        >>> import creative_nao
        >>> from creative_nao.envs.randomised_robot import RandomisedRobot, VariationRanges
        >>> env = RandomisedRobot(gym.make("CreativeNao/Boxing-v0"), VariationRanges(mass=(1.1, 1.1)))
        >>> env.reset(seed=0)[1]["variation"]["mass"]
        1.1
    """

    def __init__(self, env: gym.Env[np.ndarray, np.ndarray], ranges: VariationRanges | None = None) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, ranges=ranges)
        check_kind(gym.Env, env, "env")
        gym.Wrapper.__init__(self, env)
        if not hasattr(env.unwrapped, "performer"):
            raise SettingsError(
                f"only an environment in which a robot performs can vary it, CreativeNao/Boxing-v0, but this is {env}"
            )
        self.ranges = VariationRanges() if ranges is None else ranges
        check_kind(VariationRanges, self.ranges, "ranges")
        self._rng: np.random.Generator | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with a robot drawn anew.

        Args:
            seed: Seed of the draws of the robot, and of the environment.
            options: Handed to the environment.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None or self._rng is None:
            self._rng = np.random.default_rng(seed)
        variation = self.ranges.draw(self._rng)
        body: Any = self.env.unwrapped
        body.performer.vary(variation, self._rng)
        return observation, {**info, "variation": dataclasses.asdict(variation)}
