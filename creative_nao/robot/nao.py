"""The robot as a dm_control entity: links, hinges, servos and sensors built from `tables` and `shells`.

Modelled after the NAO H25 V6: 25 motors move 26 hinges (one motor turns both HipYawPitch hinges). The hands are shut to
fists in gloves; their motors, 0 closed to 1 open as in NAOqi, turn fingers that nothing touches.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

from typing import Any

from creative_nao.joints import JOINTS
from creative_nao.robot import shells
from creative_nao.robot.modelling import composer, define, mjcf, observable
from creative_nao.robot.servos import ServoSettings
from creative_nao.robot.tables import FIST_IN_HAND_M, TORSO, Link, links

COUPLED = ("LHipYawPitch", "RHipYawPitch")
"""One motor turns both; the left name is the motor's."""

MOTOR_JOINTS: tuple[str, ...] = tuple(link.joint for link in links() if link.joint != COUPLED[1])
"""The 25 joints with a motor, in the order of the model's actuators."""

FRICTION = (0.9, 0.005, 0.0001)
"""Sliding, torsional and rolling friction of the shells: rubber soles and leather gloves."""

_FORCE_SENSORS_MM = {
    "front_outer": (70.25, 29.90),
    "front_inner": (70.25, -23.10),
    "rear_outer": (-30.25, 29.90),
    "rear_inner": (-29.65, -19.10),
}
"""Force sensors under the left foot, ahead of and beside the ankle."""


class Nao(composer.Entity):
    """A NAO-like humanoid of 5.36 kg and 0.57 m; give it a free joint when attaching it.

    Joint names, signs and the zero pose are NAOqi's. Every motor is a position servo: its control is the target angle
    [rad], its force range the published effort. The torso frame is the root.
    """

    def _build(self, name: str = "nao", servos: ServoSettings | None = None) -> None:
        self._servos = servos or ServoSettings()
        self._mjcf_root = mjcf.RootElement(model=name)
        self._mjcf_root.compiler.angle = "radian"
        self._mjcf_root.compiler.eulerseq = "xyz"
        for paint, look in shells.PAINTS.items():
            self._mjcf_root.asset.add("material", name=paint, **look)
        self._bodies = {TORSO.name: self._mjcf_root.worldbody.add("body", name=TORSO.name)}
        _add_inertia(self._bodies[TORSO.name], TORSO.mass_kg, TORSO.com_mm, TORSO.inertia_e6)
        for link in links():
            self._add_link(link)
        for shape in shells.shapes():
            _add_shape(self._bodies[shape.link], shape)
        for one, two in shells.separated_pairs():
            self._mjcf_root.contact.add("exclude", body1=one, body2=two)
        self._couple_hips()
        self._add_sites_and_sensors()

    def _add_link(self, link: Link) -> None:
        body = self._bodies[link.parent].add("body", name=link.name, pos=_metres(link.offset_mm))
        self._bodies[link.name] = body
        _add_inertia(body, link.mass_kg, link.com_mm, link.inertia_e6)
        joint = body.add(
            "joint",
            name=link.joint,
            type="hinge",
            axis=link.axis,
            range=link.range_rad,
            limited=True,
            armature=link.motor.armature,
            damping=self._servos.damping,
            frictionloss=self._servos.friction_loss,
        )
        if link.joint != COUPLED[1]:
            kp, kd = self._servos.gains(link)
            effort = link.motor.effort_nm
            self._mjcf_root.actuator.add(
                "position", name=link.joint, joint=joint, kp=kp, kv=kd,
                ctrllimited=True, ctrlrange=link.range_rad, forcelimited=True, forcerange=(-effort, effort),
            )  # fmt: skip

    def _couple_hips(self) -> None:
        left, right = (self._mjcf_root.find("joint", name) for name in COUPLED)
        self._mjcf_root.equality.add(
            "joint", name="hip_yaw_pitch", joint1=right, joint2=left, polycoef=(0, 1, 0, 0, 0), solref=(0.01, 1)
        )

    def _add_sites_and_sensors(self) -> None:
        root = self._mjcf_root
        sensor = root.sensor
        torso = self._bodies[TORSO.name]
        torso.add("site", name="accelerometer", pos=(-0.008, 0.00606, 0.027), size=(0.004,), group=4)
        torso.add("site", name="gyrometer", pos=(-0.008, 0.006, 0.029), size=(0.004,), group=4)
        sensor.add("accelerometer", name="accelerometer", site="accelerometer")
        sensor.add("gyro", name="gyrometer", site="gyrometer")
        for side, sign in (("L", 1), ("R", -1)):
            hand, foot = self._bodies[f"{side}Hand"], self._bodies[f"{side}Foot"]
            hand.add("site", name=f"{side}Fist", pos=FIST_IN_HAND_M, size=(0.005,), group=4)
            hand.add("site", name=f"{side}Glove", pos=(0.053, 0, -0.002), size=(0.040,), group=4)
            sensor.add("touch", name=f"{side}Fist_touch", site=f"{side}Glove")
            for place, (x, y) in _FORCE_SENSORS_MM.items():
                foot.add("site", name=f"{side}Foot_{place}", pos=_metres((x, sign * y, -45.19)), size=(0.004,), group=4)
            centre = (0.0244, sign * 0.0056, -0.0352)
            foot.add("site", name=f"{side}Foot", type="box", pos=centre, size=(0.080, 0.050, 0.014), group=4)
            sensor.add("touch", name=f"{side}Foot_touch", site=f"{side}Foot")
            sensor.add("framelinvel", name=f"{side}Fist_velocity", objtype="site", objname=f"{side}Fist")
        for link in links():
            sensor.add("jointpos", name=f"{link.joint}_position", joint=link.joint)
        for joint in JOINTS:
            sensor.add("actuatorfrc", name=f"{joint}_torque", actuator=joint)
        sensor.add("contact", name="self_contact", subtree1=TORSO.name, subtree2=TORSO.name, data="found")
        eyes = self._bodies["Head"]
        eyes.add("camera", name="top_camera", pos=(0.060, 0, 0.06364), xyaxes=(0, -1, 0, 0.021, 0, 1), fovy=47.6)

    def _build_observables(self) -> NaoObservables:
        return NaoObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The robot alone: no floor, no light, no option."""
        return self._mjcf_root

    @property
    def actuators(self) -> list[Any]:
        """The 25 position servos, in the order of `MOTOR_JOINTS`."""
        return [self._mjcf_root.find("actuator", joint) for joint in MOTOR_JOINTS]

    @property
    def arm_joints(self) -> list[Any]:
        """The eight arm hinges, in the order of `joints.JOINTS`."""
        return [self._mjcf_root.find("joint", joint) for joint in JOINTS]

    @property
    def touch_sensors(self) -> list[Any]:
        """Touch of both fists and both feet [N]: left fist, left foot, right fist, right foot."""
        return [sensor for sensor in self._mjcf_root.find_all("sensor") if sensor.tag == "touch"]

    def body(self, link: str) -> Any:
        """Return the body element of a link, for instance `RForearm`."""
        return self._bodies[link]


class NaoObservables(composer.Observables):
    """What the robot senses of itself; all are off until enabled."""

    @define.observable
    def joint_positions(self) -> observable.MJCFFeature:
        """Angles of the eight arm joints [rad], shape (8,)."""
        return observable.MJCFFeature("qpos", self._entity.arm_joints)

    @define.observable
    def joint_velocities(self) -> observable.MJCFFeature:
        """Speeds of the eight arm joints [rad/s], shape (8,)."""
        return observable.MJCFFeature("qvel", self._entity.arm_joints)

    @define.observable
    def touch(self) -> observable.MJCFFeature:
        """Normal force on left fist, left foot, right fist, right foot [N], shape (4,)."""
        return observable.MJCFFeature("sensordata", self._entity.touch_sensors)


def _metres(millimetres: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(value / 1000 for value in millimetres)


def _add_inertia(body: Any, mass_kg: float, com_mm: tuple[float, ...], inertia_e6: tuple[float, ...]) -> None:
    full = tuple(value * 1e-6 for value in inertia_e6)
    body.add("inertial", mass=mass_kg, pos=_metres(com_mm), fullinertia=full)


def _add_shape(body: Any, shape: shells.Shape) -> None:
    place = {"fromto": shape.ends} if shape.ends else {"pos": shape.at, "euler": shape.turn}
    if shape.contact:
        body.add(
            "geom", name=shape.name, type=shape.kind, size=shape.size, group=shells.CONTACT_GROUP,
            friction=FRICTION, mass=0, rgba=(0.9, 0.4, 0.1, 0.5), **place,
        )  # fmt: skip
    else:
        body.add(
            "geom", type=shape.kind, size=shape.size, material=shape.paint, contype=0, conaffinity=0, mass=0,
            group=1, **place,
        )  # fmt: skip
