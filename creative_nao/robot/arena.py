"""The boxing ring: canvas, ropes, corner posts, the gantry that carries the bag, lights and cameras.

Only the floor can be touched; everything else is drawn. The robot's sole stands at z = 0 and looks along x.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

from typing import Any

from creative_nao.robot.modelling import composer

HALF_RING_M = 0.90
"""From the centre to a corner post, along x and y."""
ROPE_HEIGHTS_M = (0.14, 0.27, 0.40)
POST_HEIGHT_M = 0.46
APRON_M = 0.12
"""Height of the platform above the hall's floor."""
PHYSICS_STEP_S = 0.005

_PAINTS: dict[str, dict[str, Any]] = {
    "apron": {"rgba": (0.10, 0.16, 0.33, 1), "specular": 0.2, "shininess": 0.2},
    "stripe": {"rgba": (0.88, 0.88, 0.90, 1), "specular": 0.1, "shininess": 0.1},
    "rope_red": {"rgba": (0.80, 0.12, 0.12, 1), "specular": 0.3, "shininess": 0.3},
    "rope_white": {"rgba": (0.92, 0.92, 0.90, 1), "specular": 0.3, "shininess": 0.3},
    "rope_blue": {"rgba": (0.12, 0.25, 0.66, 1), "specular": 0.3, "shininess": 0.3},
    "post": {"rgba": (0.30, 0.31, 0.34, 1), "specular": 0.6, "shininess": 0.6},
    "steel": {"rgba": (0.42, 0.44, 0.48, 1), "specular": 0.7, "shininess": 0.7},
}


class Ring(composer.Arena):
    """A boxing ring in the robot's size, with cheap and repeatable physics options.

    Pyramidal friction cones without the no-slip passes (together 1.7 times as fast as the defaults of composer),
    the implicitfast integrator and steps of 5 ms.

    Args:
        name: Name of the model.
        hook: Where the bag hangs [m]; the gantry is drawn up to there.
    """

    def _build(self, name: str = "ring", hook: tuple[float, float, float] = (0.305, 0.0, 0.85)) -> None:
        super()._build(name)
        root = self._mjcf_root
        option = root.option
        option.timestep = PHYSICS_STEP_S
        option.noslip_iterations, option.cone, option.integrator = 0, "pyramidal", "implicitfast"
        root.visual.quality.offsamples = 0
        root.visual.quality.shadowsize = 4096
        root.statistic.extent, root.statistic.center = 1.0, (0.1, 0, 0.3)
        off_screen = getattr(root.visual, "global")
        off_screen.offwidth, off_screen.offheight = 1920, 1080
        root.visual.headlight.ambient, root.visual.headlight.diffuse = (0.36, 0.36, 0.38), (0.30, 0.30, 0.30)
        root.visual.map.znear, root.visual.map.zfar = 0.01, 30
        for paint, look in _PAINTS.items():
            root.asset.add("material", name=paint, **look)
        self._add_floor()
        self._add_ropes()
        self._add_gantry(hook)
        self._add_lights_and_cameras()
        self._hook = root.worldbody.add("site", name="hook", pos=hook, size=(0.005,), group=4)

    def _add_floor(self) -> None:
        root = self._mjcf_root
        root.asset.add(
            "texture", name="sky", type="skybox", builtin="gradient", rgb1=(0.20, 0.24, 0.32), rgb2=(0.05, 0.06, 0.09),
            width=256, height=256,
        )  # fmt: skip
        root.asset.add(
            "texture", name="canvas", type="2d", builtin="checker", rgb1=(0.63, 0.71, 0.80), rgb2=(0.59, 0.67, 0.77),
            width=256, height=256,
        )  # fmt: skip
        root.asset.add("material", name="canvas", texture="canvas", texrepeat=(6, 6), specular=0.05, shininess=0.05)
        world = root.worldbody
        self._floor = world.add(
            "geom", name="floor", type="plane", size=(2, 2, 0.1), group=3, friction=(0.9, 0.005, 0.0001)
        )
        edge = HALF_RING_M + 0.10
        self._draw("box", (edge, edge, 0.01), "canvas", pos=(0, 0, -0.0102))
        self._draw("box", (edge, edge, APRON_M / 2), "apron", pos=(0, 0, -APRON_M / 2 - 0.0205))
        self._draw("box", (edge + 0.001, edge + 0.001, 0.006), "stripe", pos=(0, 0, -0.0395))
        for sign in (1, -1):
            self._draw("box", (0.012, HALF_RING_M - 0.05, 0.0006), "stripe", pos=(sign * (HALF_RING_M - 0.06), 0, 0))
            self._draw("box", (HALF_RING_M - 0.05, 0.012, 0.0006), "stripe", pos=(0, sign * (HALF_RING_M - 0.06), 0))
        root.asset.add("texture", name="hall", type="2d", builtin="flat", rgb1=(0.16, 0.17, 0.20), width=32, height=32)
        root.asset.add("material", name="hall", texture="hall", specular=0.1, shininess=0.1, reflectance=0.08)
        self._draw("plane", (8, 8, 0.1), "hall", pos=(0, 0, -APRON_M - 0.03))

    def _add_ropes(self) -> None:
        half = HALF_RING_M
        corners = [(half, half), (-half, half), (-half, -half), (half, -half)]
        pads = ("rope_red", "rope_white", "rope_blue", "rope_white")
        for (x, y), pad in zip(corners, pads, strict=True):
            self._draw("cylinder", (0.020, POST_HEIGHT_M / 2), "post", pos=(x, y, POST_HEIGHT_M / 2))
            self._draw("sphere", (0.024,), "steel", pos=(x, y, POST_HEIGHT_M))
            inner = 0.965
            self._draw("cylinder", (0.026, 0.165), pad, pos=(inner * x, inner * y, 0.27))
        for height, paint in zip(ROPE_HEIGHTS_M, ("rope_blue", "rope_white", "rope_red"), strict=True):
            for (x, y), (next_x, next_y) in zip(corners, corners[1:] + corners[:1], strict=True):
                self._draw("capsule", (0.0075,), paint, fromto=(x, y, height, next_x, next_y, height))

    def _add_gantry(self, hook: tuple[float, float, float]) -> None:
        x, y, z = hook
        foot = HALF_RING_M + 0.05
        self._draw("capsule", (0.016,), "steel", fromto=(foot, y, 0, foot, y, z + 0.015))
        self._draw("capsule", (0.013,), "steel", fromto=(foot, y, z + 0.015, x - 0.03, y, z + 0.015))
        self._draw("capsule", (0.009,), "steel", fromto=(foot, y, z - 0.16, foot - 0.16, y, z + 0.015))
        self._draw("cylinder", (0.045, 0.006), "post", pos=(foot, y, 0.004))

    def _add_lights_and_cameras(self) -> None:
        world = self._mjcf_root.worldbody
        world.add(
            "light", name="key", pos=(1.2, -1.6, 2.6), dir=(-0.42, 0.55, -0.85), directional=True, castshadow=True,
            diffuse=(0.52, 0.51, 0.48), specular=(0.35, 0.35, 0.35),
        )  # fmt: skip
        world.add(
            "light", name="fill", pos=(-1.5, 1.5, 2.0), dir=(0.6, -0.5, -0.7), directional=True, castshadow=False,
            diffuse=(0.22, 0.24, 0.28), specular=(0.05, 0.05, 0.05),
        )  # fmt: skip
        for name, (eye, target, fovy) in CAMERAS.items():
            world.add("camera", name=name, pos=eye, xyaxes=_look_at(eye, target), fovy=fovy)

    def _draw(self, kind: str, size: tuple[float, ...], paint: str, **place: Any) -> None:
        self._mjcf_root.worldbody.add(
            "geom", type=kind, size=size, material=paint, contype=0, conaffinity=0, group=1, **place
        )

    @property
    def floor(self) -> Any:
        """The contact plane under the canvas."""
        return self._floor

    @property
    def hook(self) -> Any:
        """The site from which the bag hangs."""
        return self._hook


Vector = tuple[float, float, float]

CAMERAS: dict[str, tuple[Vector, Vector, float]] = {
    "close": ((0.60, -0.74, 0.52), (0.10, 0.0, 0.31), 44.0),
    "ringside": ((1.25, -1.95, 1.15), (0.10, 0.0, 0.24), 40.0),
    "side": ((0.13, -0.84, 0.40), (0.13, 0.0, 0.32), 46.0),
    "left": ((0.66, 0.72, 0.44), (0.10, 0.0, 0.31), 44.0),
}
"""Eye, target [m] and vertical field of view [degrees] of the fixed cameras."""


def _look_at(eye: Vector, target: Vector) -> tuple[float, ...]:
    """Return a camera's x and y axes for looking from `eye` at `target` with z up."""
    forward = [t - e for e, t in zip(eye, target, strict=True)]
    right = (forward[1], -forward[0], 0.0)
    up = (
        right[1] * forward[2] - right[2] * forward[1],
        right[2] * forward[0] - right[0] * forward[2],
        right[0] * forward[1] - right[1] * forward[0],
    )
    return (*right, *up)
