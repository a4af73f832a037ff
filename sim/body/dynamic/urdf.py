"""URDF text of the robot and of static objects, generated from the table of `anatomy`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from ...scene import Extent
from ...shapes import Box, Cylinder
from .anatomy import Anatomy, Link, links

REACH_RAD = 2.6  # ours: limit of every joint; the gait keeps links apart
BUMP_SPACING_M = 0.12  # ours


def robot_urdf(body: Anatomy) -> str:
    """The robot; each joint has the name of its child link."""
    lines = ['<?xml version="1.0"?>', '<robot name="walker">']
    for link in links(body):
        lines += _link(link)
        if link.parent:
            lines += _joint(link, body.servo_nm)
    return "\n".join([*lines, "</robot>"])


def static_urdf(solids: Iterable[Box | Cylinder]) -> str:
    """Static shapes as one rigid link; there must be at least one."""
    lines = [
        '<?xml version="1.0"?>',
        '<robot name="still">',
        '<link name="still">',
        '<inertial><mass value="0"/>',
        '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>',
    ]
    for solid in solids:
        if isinstance(solid, Box):
            lines += _solid(solid.centre, solid.size, solid.yaw_rad)
        else:
            lines += [
                f'<collision><origin xyz="{_text(solid.centre)}"/><geometry>',
                f'<cylinder radius="{solid.radius:.9g}" length="{solid.height:.9g}"/>',
                "</geometry></collision>",
            ]
    return "\n".join([*lines, "</link>", "</robot>"])


def box_inertia(mass: float, size: Sequence[float]) -> tuple[float, float, float]:
    """Principal inertia of a homogeneous box about its centre, kg m^2."""
    x, y, z = (value**2 for value in size)
    return mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12


def _link(link: Link) -> list[str]:
    xx, yy, zz = box_inertia(link.mass, link.size)
    lines = [
        f'<link name="{link.name}">',
        f'<inertial><origin xyz="{_text(link.centre_of_mass)}"/><mass value="{link.mass:.9g}"/>',
        f'<inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/></inertial>',
    ]
    if link.solid:
        lines += _solid(link.middle, link.size)
    return [*lines, "</link>"]


def _joint(link: Link, torque: float) -> list[str]:
    return [
        f'<joint name="{link.name}" type="revolute">',
        f'<parent link="{link.parent}"/><child link="{link.name}"/>',
        f'<origin xyz="{_text(link.origin)}"/><axis xyz="{_text(link.axis)}"/>',
        f'<limit lower="{-REACH_RAD}" upper="{REACH_RAD}" effort="{torque:.9g}" velocity="20"/>',
        "</joint>",
    ]


def _solid(middle: Sequence[float], size: Sequence[float], yaw_rad: float = 0.0) -> list[str]:
    return [
        f'<collision><origin xyz="{_text(middle)}" rpy="0 0 {yaw_rad:.9g}"/>',
        f'<geometry><box size="{_text(size)}"/></geometry></collision>',
    ]


def _text(values: Sequence[float] | Float[np.ndarray, "n"]) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def floor_bumps(extent: Extent, height_m: float, rng: np.random.Generator) -> list[Box]:
    """Thin plates on a floor, one at a random place in each square, of random height.

    Args:
        extent: (x_min, y_min, x_max, y_max), m.
        height_m: Greatest height.
        rng: Source of places, widths and heights; plates are half to fully as wide as a square.
    """
    x0, y0, x1, y1 = extent
    columns, rows = (max(1, math.ceil(length / BUMP_SPACING_M)) for length in (x1 - x0, y1 - y0))
    count = columns * rows
    side = BUMP_SPACING_M * rng.uniform(0.5, 1.0, count)
    free = (BUMP_SPACING_M - side) * rng.uniform(-0.5, 0.5, (2, count))
    j, i = np.divmod(np.arange(count), columns)
    x, y = x0 + (i + 0.5) * BUMP_SPACING_M + free[0], y0 + (j + 0.5) * BUMP_SPACING_M + free[1]
    top = rng.uniform(0.0, height_m, count)
    # plates reach below the floor, so that contact on an edge pushes the sole up
    return [
        Box((float(a), float(b), float(h) - 0.02), (float(s), float(s), 0.04))
        for a, b, s, h in zip(x, y, side, top, strict=True)
    ]
