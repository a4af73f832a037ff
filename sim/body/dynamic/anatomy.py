"""Anatomy: one table of lengths and masses, and the links derived from it.

URDF, inverse kinematics, height of the centre of mass and dimensions of the gait follow from this table. The base is
the pelvis, its origin midway between the hips; yaw, roll and pitch axes of a hip meet in one point, and so do pitch
and roll of an ankle.

Sources: dimensions of a DARwIn-OP (seeds 000, 001, 003); seed 004, Table 3 (0.30 x 0.60 x 0.20 m, 23 joints).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError

from ..gait import GaitConfig
from ..head import HeadConfig

LEG_JOINTS = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
SIDES = (("left", 1.0), ("right", -1.0))


@dataclass(frozen=True)
class Anatomy:
    """Lengths in m, masses in kg, of one side where there are two.

    Args:
        hip_m: Height of the pelvis while walking, with bent knees.
        shoulder_m: Left shoulder in the pelvis frame.
        trunk_m: Depth, width and height of everything above the legs, arms included, for contact.
        trunk_bottom_m: Its lower end above the floor while walking.
        torso_mass_height_m: Centre of mass of the torso above the pelvis.
        servo_nm: Torque limit of a joint.
        full: 23 joints, with waist yaw and elbow yaw; else 20.
    """

    hip_m: float = 0.2055
    hip_half_m: float = 0.037
    thigh_m: float = 0.093
    shank_m: float = 0.093
    ankle_m: float = 0.0335
    foot_m: tuple[float, float, float] = (0.104, 0.066, 0.010)
    foot_outward_m: float = 0.005
    torso_m: tuple[float, float, float] = (0.080, 0.110, 0.120)
    trunk_m: tuple[float, float, float] = (0.110, 0.164, 0.355)  # seed 000: up to 0.455 m
    trunk_bottom_m: float = 0.10  # ours: hips
    torso_mass_height_m: float = 0.075  # ours: puts the whole body's at 0.215 m, as measured
    shoulder_m: tuple[float, float, float] = (0.0, 0.068, 0.115)
    arm_m: tuple[float, float] = (0.060, 0.070)  # upper and lower arm
    arm_width_m: float = 0.028
    neck_m: float = 0.150
    tilt_m: float = 0.015
    head_m: tuple[float, float, float] = (0.070, 0.080, 0.070)
    torso_kg: float = 0.976
    leg_kg: tuple[float, float, float, float, float, float] = (
        0.027,  # hip yaw
        0.167,  # hip roll
        0.119,  # thigh
        0.070,  # shank
        0.167,  # ankle
        0.079,  # foot
    )
    arm_kg: tuple[float, float, float] = (0.025, 0.168, 0.059)
    head_kg: tuple[float, float] = (0.024, 0.158)
    servo_nm: float = 2.5  # 1.5 is needed, 1.0 falls
    full: bool = False

    def scaled(self, factor: float) -> Anatomy:
        """The same body with lengths times a factor, masses times its cube, torques times its fourth power.

        Raises:
            ConfigError: for a factor outside 0.5 to 3.
        """
        if not 0.5 <= factor <= 3.0:
            raise ConfigError(f"dynamic: scale={factor} must lie between 0.5 and 3")
        if factor == 1.0:
            return self
        changed: dict[str, object] = {}
        for name, value in vars(self).items():
            power = 1 if name.endswith("_m") else 3 if name.endswith("_kg") else 0
            power = 4 if name == "servo_nm" else power
            if power and isinstance(value, tuple):
                changed[name] = tuple(v * factor**power for v in value)
            elif power:
                changed[name] = value * factor**power
        return replace(self, **changed)  # type: ignore[arg-type]


DARWIN = Anatomy()

TALL = (
    replace(  # seed 004: 0.60 m tall, 0.30 m wide, 0.20 m deep, 23 joints; inner measures are ours
        DARWIN.scaled(0.600 / 0.455),
        torso_m=(0.150, 0.180, 0.158),
        trunk_m=(0.200, 0.300, 0.468),
        shoulder_m=(0.0, 0.130, 0.152),
        arm_width_m=0.040,
        foot_m=(0.200, 0.087, 0.013),
        full=True,
    )
)

ANATOMIES = {"darwin": DARWIN, "tall": TALL}


@dataclass(frozen=True)
class Link:
    """One rigid part and the joint that carries it.

    Args:
        name: Name of link and joint.
        parent: Parent link; empty for the base.
        axis: Joint axis, in both frames at angle zero.
        origin: Joint in the parent's frame, m.
        mass: kg.
        middle: Centre of the link's box, by default its centre of mass, own frame, m.
        size: Size of that box, m.
        solid: Whether it collides.
        weight: Centre of mass where it is not the box's centre.
    """

    name: str
    parent: str
    axis: tuple[float, float, float]
    origin: tuple[float, float, float]
    mass: float
    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    solid: bool = False
    weight: tuple[float, float, float] | None = None

    @property
    def centre_of_mass(self) -> Float[np.ndarray, "3"]:
        """Centre of mass, own frame, m."""
        return np.array(self.middle if self.weight is None else self.weight)


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
NOWHERE = (0.0, 0.0, 0.0)


def links(body: Anatomy) -> list[Link]:
    """All links, parents before children, the base first."""
    width, height = body.torso_m[1], body.torso_m[2]
    middle = (0.0, 0.0, 0.02 / 0.12 * height + height / 2)
    weight = (0.0, 0.0, body.torso_mass_height_m)
    if not body.full:
        found = [Link("torso", "", Z, NOWHERE, body.torso_kg, middle, body.torso_m, True, weight)]
        chest = "torso"
    else:  # a fifth of the torso's mass stays below the waist
        low = (body.torso_m[0], 0.6 * width, 0.3 * height)
        found = [
            Link("torso", "", Z, NOWHERE, 0.2 * body.torso_kg, NOWHERE, low),
            Link("waist", "torso", Z, NOWHERE, 0.8 * body.torso_kg, middle, body.torso_m, True),
        ]
        chest = "waist"
    head, neck_kg = body.head_m, body.head_kg
    found.append(
        Link("pan", chest, Z, (0.0, 0.0, body.neck_m), neck_kg[0], NOWHERE, (0.02, 0.02, 0.02))
    )
    middle = (0.0, 0.0, head[2] / 2)
    found.append(Link("tilt", "pan", Y, (0.0, 0.0, body.tilt_m), neck_kg[1], middle, head, True))
    for side, sign in SIDES:
        found += _arm(body, chest, side, sign) + _leg(body, side, sign)
    return found


def _leg(body: Anatomy, side: str, sign: float) -> list[Link]:
    small = (0.4 * body.thigh_m,) * 3
    thick = 0.35 * body.thigh_m
    yaw, roll, thigh, shank, ankle, foot = body.leg_kg
    sole = (0.0, sign * body.foot_outward_m, body.foot_m[2] / 2 - body.ankle_m)
    parts = (
        (Z, (0.0, sign * body.hip_half_m, 0.0), yaw, NOWHERE, small, False),
        (X, NOWHERE, roll, NOWHERE, small, False),
        (Y, NOWHERE, thigh, (0.0, 0.0, -body.thigh_m / 2), (thick, thick, body.thigh_m), False),
        (
            Y,
            (0.0, 0.0, -body.thigh_m),
            shank,
            (0.0, 0.0, -body.shank_m / 2),
            (thick, thick, body.shank_m),
            False,
        ),
        (Y, (0.0, 0.0, -body.shank_m), ankle, NOWHERE, small, False),
        (X, NOWHERE, foot, sole, body.foot_m, True),
    )
    return _chain("torso", side, LEG_JOINTS, parts)


def _arm(body: Anatomy, chest: str, side: str, sign: float) -> list[Link]:
    upper, lower = body.arm_m
    width = body.arm_width_m
    x, y, z = body.shoulder_m
    small = (width,) * 3
    shoulder, arm, hand = body.arm_kg
    parts = [
        (Y, (x, sign * y, z), shoulder, NOWHERE, small, False),
        (X, NOWHERE, arm, (0.0, 0.0, -upper / 2), (width, width, upper), True),
        (Y, (0.0, 0.0, -upper), hand, (0.0, 0.0, -lower / 2), (width, width, lower), True),
    ]
    names = ["shoulder_pitch", "shoulder_roll", "elbow"]
    if body.full:
        parts.insert(2, (Z, (0.0, 0.0, -upper), 0.2 * hand, NOWHERE, small, False))
        parts[3] = (Y, NOWHERE, 0.8 * hand, *parts[3][3:])
        names.insert(2, "elbow_yaw")
    return _chain(chest, side, names, parts)


def _chain(parent: str, side: str, names: object, parts: object) -> list[Link]:
    found: list[Link] = []
    for name, (axis, origin, mass, middle, size, solid) in zip(names, parts, strict=True):  # type: ignore[call-overload]
        found.append(Link(f"{side}_{name}", parent, axis, origin, mass, middle, size, solid))
        parent = f"{side}_{name}"
    return found


def gait_for(body: Anatomy, gait: GaitConfig) -> GaitConfig:
    """Gait with lengths scaled by the leg length; its timing stays."""
    factor = (body.thigh_m + body.shank_m) / (DARWIN.thigh_m + DARWIN.shank_m)
    if factor == 1.0:
        return gait
    lengths = {name: value * factor for name, value in vars(gait).items() if name.endswith("_m")}
    return replace(gait, **lengths)


def head_for(body: Anatomy, head: HeadConfig) -> HeadConfig:
    """Head geometry of this body."""
    if body == DARWIN:
        return head
    return replace(head, hip_m=body.hip_m, neck_m=body.neck_m, tilt_m=body.tilt_m)
