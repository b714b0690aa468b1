"""A punching bag in the robot's size: it hangs from the gantry, swings when hit and comes to rest again."""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

import dataclasses
from typing import Any

from creative_nao.robot.modelling import composer, define, mjcf, observable


@dataclasses.dataclass(frozen=True)
class BagSettings:
    """Size and suspension of the bag [m, kg]."""

    radius_m: float = 0.12
    length_m: float = 0.40
    """Of the whole bag, rounded ends included."""
    mass_kg: float = 1.5
    chain_m: float = 0.26
    """From the hook to the upper end of the bag."""
    damping: float = 0.6
    """Of each of the two swing hinges [N m s/rad]: a swing dies within a few seconds."""
    friction: float = 0.6


class Bag(composer.Entity):
    """A leather bag on a chain; its root is the hook, and it swings about two crossed hinges there."""

    def _build(self, name: str = "bag", settings: BagSettings | None = None) -> None:
        bag = settings or BagSettings()
        self._mjcf_root = mjcf.RootElement(model=name)
        self._mjcf_root.compiler.angle = "radian"
        for paint, look in _PAINTS.items():
            self._mjcf_root.asset.add("material", name=paint, **look)
        body = self._mjcf_root.worldbody.add("body", name="bag")
        self._swing = [
            body.add("joint", name=f"swing_{name}", type="hinge", axis=axis, damping=bag.damping)
            for name, axis in (("x", (1, 0, 0)), ("y", (0, 1, 0)))
        ]
        middle = -bag.chain_m - bag.length_m / 2
        half = bag.length_m / 2 - bag.radius_m
        self._geom = body.add(
            "geom", name="leather", type="capsule", size=(bag.radius_m, half), pos=(0, 0, middle), mass=bag.mass_kg,
            friction=(bag.friction, 0.005, 0.0001), group=3, rgba=(0.5, 0.1, 0.1, 0.5), solref=(0.02, 1.0),
        )  # fmt: skip
        self._mjcf_root.sensor.add("jointpos", name="swing_x", joint=self._swing[0])
        self._mjcf_root.sensor.add("jointpos", name="swing_y", joint=self._swing[1])
        _dress(body, bag, middle)

    def _build_observables(self) -> BagObservables:
        return BagObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The bag alone."""
        return self._mjcf_root

    @property
    def swing_joints(self) -> list[Any]:
        """The two hinges at the hook: about x (sideways) and about y (away from the robot)."""
        return self._swing

    @property
    def geom(self) -> Any:
        """The contact shape."""
        return self._geom


class BagObservables(composer.Observables):
    """How the bag swings; off until enabled."""

    @define.observable
    def swing(self) -> observable.MJCFFeature:
        """Angles of both hinges [rad], shape (2,)."""
        return observable.MJCFFeature("qpos", self._entity.swing_joints)

    @define.observable
    def swing_velocity(self) -> observable.MJCFFeature:
        """Angular speeds of both hinges [rad/s], shape (2,)."""
        return observable.MJCFFeature("qvel", self._entity.swing_joints)


_PAINTS: dict[str, dict[str, Any]] = {
    "bag_leather": {"rgba": (0.13, 0.13, 0.15, 1), "specular": 0.5, "shininess": 0.5},
    "bag_band": {"rgba": (0.85, 0.62, 0.12, 1), "specular": 0.4, "shininess": 0.4},
    "bag_steel": {"rgba": (0.62, 0.64, 0.68, 1), "specular": 0.8, "shininess": 0.8},
}


def _dress(body: Any, bag: BagSettings, middle: float) -> None:
    """Add what is only drawn: leather, bands, chains."""

    def draw(kind: str, size: tuple[float, ...], paint: str, **place: Any) -> None:
        body.add("geom", type=kind, size=size, material=paint, contype=0, conaffinity=0, mass=0, group=1, **place)

    top, bottom = middle + bag.length_m / 2, middle - bag.length_m / 2
    barrel = bag.length_m / 2 - 0.03
    draw("cylinder", (bag.radius_m, barrel), "bag_leather", pos=(0, 0, middle))
    draw("ellipsoid", (bag.radius_m, bag.radius_m, 0.03), "bag_leather", pos=(0, 0, middle + barrel))
    draw("ellipsoid", (bag.radius_m, bag.radius_m, 0.03), "bag_leather", pos=(0, 0, middle - barrel))
    for height in (top - 0.055, bottom + 0.055):
        draw("cylinder", (bag.radius_m + 0.0015, 0.012), "bag_band", pos=(0, 0, height))
    ring = -bag.chain_m * 0.45
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        edge = (0.8 * bag.radius_m * x, 0.8 * bag.radius_m * y, top - 0.02)
        draw("capsule", (0.004,), "bag_steel", fromto=(0, 0, ring, *edge))
    draw("sphere", (0.011,), "bag_steel", pos=(0, 0, ring))
    draw("capsule", (0.006,), "bag_steel", fromto=(0, 0, 0, 0, 0, ring))
