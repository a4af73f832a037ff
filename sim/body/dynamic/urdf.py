"""The body and the floor as URDF text, written from the table of `anatomy`; nothing is drawn by hand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from ...shapes import Box, Cylinder
from .anatomy import Anatomy, Link, links

REACH_RAD = 2.6  # of every joint: the gait, not the servo, keeps them apart


def robot_urdf(body: Anatomy) -> str:
    """The whole robot; its joints are called after the parts they carry."""
    lines = ['<?xml version="1.0"?>', '<robot name="walker">']
    for link in links(body):
        lines += _link(link)
        if link.parent:
            lines += _joint(link, body.servo_nm)
    return "\n".join([*lines, "</robot>"])


def still_urdf(solids: Iterable[Box | Cylinder]) -> str:
    """Things that do not move of themselves, as one rigid part; there must be at least one."""
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
    """Of an even box about its middle, kg m^2."""
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


def bumps(
    extent: tuple[float, float, float, float],
    height_m: float,
    rng: np.random.Generator,
    spacing_m: float = 0.12,
) -> list[Box]:
    """Thin plates over a floor: one a square of the spacing, somewhere in it, as high as 0 to the most.

    Args:
        extent: (x_min, y_min, x_max, y_max), m.
        height_m: The highest a bump may be.
        rng: Where they lie.
        spacing_m: Plates are half to all as wide as that.
    """
    x0, y0, x1, y1 = extent
    columns, rows = (max(1, math.ceil(length / spacing_m)) for length in (x1 - x0, y1 - y0))
    count = columns * rows
    side = spacing_m * rng.uniform(0.5, 1.0, count)
    free = (spacing_m - side) * rng.uniform(-0.5, 0.5, (2, count))
    j, i = np.divmod(np.arange(count), columns)
    x, y = x0 + (i + 0.5) * spacing_m + free[0], y0 + (j + 0.5) * spacing_m + free[1]
    top = rng.uniform(0.0, height_m, count)
    # plates reach below the floor: a corner that comes down on an edge is pushed up, not through
    return [
        Box((float(a), float(b), float(h) - 0.02), (float(s), float(s), 0.04))
        for a, b, s, h in zip(x, y, side, top, strict=True)
    ]
