"""The URDF text that an engine loads: the moving links, with soles and a trunk that collide.

PyBullet turns the frame of a body to the principal axes of its inertia; the text states inertia in these axes, so that
the engine has nothing to turn. Its reader breaks long lines, so every element has its own.

Source: reduction and contacts ours, after trials with the hulls of the models (ten times slower, and they catch).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...robots.description import Description
from ..dynamic.physics import Machine
from .tree import Tree

BALL_M = 0.005  # ours: radius of the balls on which a sole stands; a box tips on plates
SPIN_M = 0.03  # ours: a sole touches by a patch of that size
BASE = "pelvis"
Corners = tuple[tuple[float, float], tuple[float, float]]


def machine(tree: Tree, corners: Corners) -> Machine:
    """A robot for the engine.

    Args:
        tree: Its links and masses.
        corners: Of the left sole along x and y, see `Dynamic`.
    """
    lines = ['<?xml version="1.0"?>', '<robot name="walker">']
    for link in range(len(tree.masses)):
        lines += _link(tree, link, corners)
    for number in range(len(tree.names)):
        lines += _joint(tree, number)
    base = tree.masses[0]
    return Machine(
        "\n".join([*lines, "</robot>"]),
        base.centre,
        _principal(base.inertia)[1],
        torques(tree, corners[1]),
        SPIN_M,
    )


def _link(tree: Tree, link: int, corners: Corners) -> list[str]:
    mass = tree.masses[link]
    values, axes = _principal(mass.inertia)
    xx, yy, zz = values.tolist()
    lines = [
        f'<link name="{link_name(tree, link)}">',
        "<inertial>",
        _origin(mass.centre, axes),
        f'<mass value="{mass.kg:.9g}"/>',
        f'<inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/>',
        "</inertial>",
    ]
    if link == 0:
        lines += _trunk(tree.robot.description, tree.hip_m)
    for side, chain in enumerate(tree.chains):
        if link == chain[-1] + 1:
            lines += _sole(tree, side, corners)
    return [*lines, "</link>"]


def _joint(tree: Tree, number: int) -> list[str]:
    joint, T = tree.robot.tree.joints[number], tree.origins[number]
    return [
        f'<joint name="{joint.name}" type="revolute">',
        f'<parent link="{link_name(tree, joint.parent)}"/>',
        f'<child link="{link_name(tree, number + 1)}"/>',
        _origin(T[:, 3], T[:, :3]),
        f'<axis xyz="{_text(joint.axis)}"/>',
        f'<limit lower="{joint.least_rad:.9g}" upper="{joint.most_rad:.9g}" effort="1000" velocity="50"/>',
        "</joint>",
    ]


def torques(tree: Tree, across: Sequence[float]) -> dict[str, float]:
    """Torque limits by joint: those of the URDF, but of the ankles' roll what tips a sole, so that it yields before."""
    found = dict(tree.efforts)
    half_m = (across[1] - across[0]) / 2
    for _, roll in ankles(tree):
        name = tree.names[roll[0]]
        found[name] = min(found[name], tree.weight_n * half_m)
    return found


def ankles(tree: Tree) -> list[tuple[tuple[int, float], tuple[int, float]]]:
    """Of each leg the joints that pitch and roll its foot, each with the sign of its axis."""
    R, _ = tree.links(np.zeros(len(tree.names)))
    found = []
    for chain in tree.chains:
        last = [int(j) for j in chain[-2:]]
        axes = [R[j + 1] @ tree.axes[j] for j in last]
        pitch = int(np.argmax([abs(axis[1]) for axis in axes]))
        roll = 1 - pitch
        found.append(
            (
                (last[pitch], float(np.sign(axes[pitch][1]))),
                (last[roll], float(np.sign(axes[roll][0]))),
            )
        )
    return found


def link_name(tree: Tree, link: int) -> str:
    """Name of a link: that of the joint that carries it."""
    return tree.names[link - 1] if link else BASE


def _sole(tree: Tree, side: int, corners: Corners) -> list[str]:
    """Four balls below the corners of a sole."""
    x0, y0, _ = tree.robot.description.legs.sole_m
    T, sign = tree.tools[side], 1.0 - 2.0 * side
    lines = []
    for x in corners[0]:
        for y in corners[1]:
            at = T[:3, :3] @ np.array([x - x0, sign * (y - y0), BALL_M]) + T[:3, 3]
            lines += [
                "<collision>",
                f'<origin xyz="{_text(at)}"/>',
                f'<geometry><sphere radius="{BALL_M:g}"/></geometry>',
                "</collision>",
            ]
    return lines


def _trunk(robot: Description, hip_m: float) -> list[str]:
    """A box about everything above the hips, arms included."""
    model = robot.model
    bottom_m = model.hip_m
    middle = np.array([0.0, 0.0, (bottom_m + model.height_m) / 2 - hip_m])
    size = (model.depth_m, model.width_m, model.height_m - bottom_m)
    return [
        "<collision>",
        f'<origin xyz="{_text(middle)}"/>',
        f'<geometry><box size="{_text(size)}"/></geometry>',
        "</collision>",
    ]


def _principal(
    inertia: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Principal inertias and a right-handed frame of their axes."""
    values, axes = np.linalg.eigh(inertia)
    return values, axes if np.linalg.det(axes) > 0.0 else axes * np.array([1.0, 1.0, -1.0])


def _origin(place: Float[np.ndarray, "3"], rotation: Float[np.ndarray, "3 3"]) -> str:
    turn = Rotation.from_matrix(rotation).as_euler("xyz")
    return f'<origin xyz="{_text(place)}" rpy="{_text(turn)}"/>'


def _text(values: Sequence[float] | Float[np.ndarray, "n"]) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)
