"""MJCF text of a robot and its surroundings, generated from the same table of `anatomy` as the URDF."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from ...shapes import Box, Cylinder, Shape, Solid
from ..pendulum import GRAVITY_MPS2
from .anatomy import Anatomy, Link, links
from .physics import FRICTION, SPIN_M, Stage, convex
from .urdf import REACH_RAD, box_inertia

STIFFNESS = 120.0  # ours: torque of a servo per rad, relative to its limit; 60 walks too
DAMPING_S = 2.0  # ours: per rad/s; deviations decay in 1/60 s, as those of PyBullet's servos do
ARMATURE_S2 = 0.0013  # MX-28: rotor of 0.87 g cm^2 behind a gear of 193, for 2.5 N m
CONTACT_S = 0.004  # ours: time constant of a contact; twice the shortest for steps of 1 ms
GRIP = 10.0  # ours: stiffness of friction against that of contact; 100 slips as much, 1 more

SOLID = 'contype="0" conaffinity="1"'  # what is not the robot touches the robot only
ROBOT = 'contype="1" conaffinity="0"'  # as in PyBullet, its links do not touch each other


def mjcf(stage: Stage, step_s: float) -> str:
    """The whole model.

    Joints, their servos and the links' bodies have the names of `anatomy.links`, the soles' shapes too. The floor and
    its bumps are named "floor" and "bump" with a number; moving objects are mocap bodies "moving" with a number.

    Args:
        stage: Robot, floor and objects.
        step_s: Time step of the integration.
    """
    assert isinstance(stage.body, Anatomy)
    found = links(stage.body)
    torque = stage.body.servo_nm
    gravity = -GRAVITY_MPS2 * np.array(stage.up)
    still = [_part(shape) for shape in stage.still]
    corners = [part for part in still if not isinstance(part, (Box, Cylinder))]
    lines = [
        '<mujoco model="walker">',
        '<compiler angle="radian" autolimits="true"/>',
        f'<option timestep="{step_s:.9g}" gravity="{_text(gravity)}" integrator="implicitfast"',
        f'  cone="elliptic" impratio="{GRIP:.9g}"/>',
        f'<default><geom condim="4" friction="{FRICTION} {SPIN_M} 0" solref="{CONTACT_S} 1"/></default>',
        "<asset>",
        *(
            f'<mesh name="hull{k}" vertex="{_text(points.ravel())}"/>'
            for k, points in enumerate(corners)
        ),
        "</asset>",
        "<worldbody>",
        f'<geom name="floor" type="plane" size="0 0 1" {SOLID}/>',
        *(_geom(bump, f"bump{k}") for k, bump in enumerate(stage.bumps)),
        *(_geom(part) for part in still if isinstance(part, (Box, Cylinder))),
        *(f'<geom type="mesh" mesh="hull{k}" {SOLID}/>' for k in range(len(corners))),
    ]
    for k, parts in enumerate(stage.moving):
        lines += [
            f'<body name="moving{k}" mocap="true" pos="0 0 -9">',
            *map(_geom, parts),
            "</body>",
        ]
    lines += [*_links(found[0], found, torque), "</worldbody>", "<actuator>"]
    gains = f'kp="{STIFFNESS * torque:.9g}" kv="{DAMPING_S * torque:.9g}"'
    lines += [
        f'<position name="{link.name}" joint="{link.name}" {gains} forcerange="{-torque:.9g} {torque:.9g}"/>'
        for link in found[1:]
    ]
    return "\n".join([*lines, "</actuator>", "</mujoco>"])


def _links(link: Link, found: Sequence[Link], torque: float) -> list[str]:
    """A link and all that it carries."""
    inertia = box_inertia(link.mass, link.size)
    lines = [
        f'<body name="{link.name}" pos="{_text(link.origin)}">',
        f'<inertial pos="{_text(link.centre_of_mass)}" mass="{link.mass:.9g}" diaginertia="{_text(inertia)}"/>',
    ]
    if link.parent:
        lines.append(
            f'<joint name="{link.name}" axis="{_text(link.axis)}" range="{-REACH_RAD} {REACH_RAD}"'
            f' armature="{ARMATURE_S2 * torque:.9g}"/>'
        )
    else:
        lines.append("<freejoint/>")
    if link.solid:
        half = [size / 2 for size in link.size]
        lines.append(
            f'<geom name="{link.name}" type="box" pos="{_text(link.middle)}" size="{_text(half)}" {ROBOT}/>'
        )
    for child in found:
        if child.parent == link.name:
            lines += _links(child, found, torque)
    return [*lines, "</body>"]


def _part(shape: Shape) -> Box | Cylinder | Float[np.ndarray, "n 3"]:
    return convex(shape) if isinstance(shape, Solid) else shape


def _geom(part: Box | Cylinder, name: str = "") -> str:
    named = f'name="{name}" ' if name else ""
    where = f'{named}pos="{_text(part.centre)}" {SOLID}'
    if isinstance(part, Cylinder):
        return f'<geom type="cylinder" size="{part.radius:.9g} {part.height / 2:.9g}" {where}/>'
    half = [size / 2 for size in part.size]
    return f'<geom type="box" size="{_text(half)}" euler="0 0 {part.yaw_rad:.9g}" {where}/>'


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
