"""A URDF as a kinematic tree: joints that do not move are merged into the links that carry them.

Every link of the file keeps its name as a frame on a link of the tree. Only turning joints can move; sliding ones and
those that the model freezes stay at their posture.

Source: the URDF specification of ROS; the merging is ours.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError
from perception.primitives.kinematics import Joint, KinematicTree, rotation_about
from perception.primitives.pose import Pose3

from ..scenes import urdf_elements as elements

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
RIGID = ("fixed", "floating", "planar")  # the last two are at zero
MOST_LINKS = 1000  # ours


@dataclass(frozen=True, eq=False)
class Place:
    """A frame on the tree: the link that it is part of, and its pose in that link, homogeneous."""

    link: int
    T_link_frame: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Merged:
    """A URDF with few joints.

    Args:
        path: Of the file.
        tree: Its moving joints.
        places: Where every link of the file is, by name.
        shapes: Visual geometries of those links, else their collision geometries: (link, element).
    """

    path: Path
    tree: KinematicTree
    places: Mapping[str, Place]
    shapes: tuple[tuple[str, ET.Element], ...]

    def place(self, name: str) -> Place:
        """The frame of a link of the file.

        Raises:
            InputError: The file has no such link.
        """
        if name not in self.places:
            raise InputError(f"{self.path}: no link {name!r}; it has {', '.join(self.places)}")
        return self.places[name]


@dataclass(frozen=True, eq=False)
class _Element:
    """A joint of the file."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Float[np.ndarray, "4 4"]
    axis: tuple[float, float, float]
    span: tuple[float, float]


def read(path: Path, moving: Sequence[str], posture: Mapping[str, float]) -> Merged:
    """The tree of a URDF.

    Args:
        path: The file.
        moving: Names of the joints that move.
        posture: Angles, rad, of frozen joints by name; the others are frozen at zero.

    Raises:
        InputError: The file is missing or damaged; a joint is unknown, cannot turn, or the links are no tree.
    """
    robot = elements.root(path)
    joints = [_joint(joint, path) for joint in robot.findall("joint")]
    links = [elements.attribute(link, "name", path) for link in robot.findall("link")]
    known = {joint.name: joint for joint in joints}
    if len(known) != len(joints) or len(set(links)) != len(links) or len(links) > MOST_LINKS:
        raise InputError(
            f"{path}: {len(links)} links, {len(joints)} joints; expected at most {MOST_LINKS}, each with its own name"
        )
    for name in (*moving, *posture):
        if name not in known:
            raise InputError(f"{path}: no joint {name!r}; it has {', '.join(known)}")
    for name in moving:
        if known[name].kind not in TURNING:
            raise InputError(
                f"{path}: joint {name!r} is {known[name].kind}; only {' and '.join(TURNING)} joints can move"
            )
        least, most = known[name].span
        if not least < most:
            raise InputError(
                f"{path}: joint {name!r} turns from {least} to {most} rad; expected lower < upper"
            )
    return _merged(path, robot, links, joints, moving, posture)


def _merged(
    path: Path,
    robot: ET.Element,
    links: list[str],
    joints: list[_Element],
    moving: Sequence[str],
    posture: Mapping[str, float],
) -> Merged:
    children: dict[str, list[_Element]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    carried = [joint.child for joint in joints]
    roots = [name for name in links if name not in carried]
    if len(roots) != 1 or len(set(carried)) != len(carried) or not set(carried) <= set(links):
        raise InputError(
            f"{path}: {len(roots)} links are carried by no joint and {len(carried) - len(set(carried))} by two; "
            "expected one tree of links"
        )
    places, found = {roots[0]: Place(0, np.eye(4))}, []
    waiting = [roots[0]]
    while waiting:
        name = waiting.pop(0)
        place = places[name]
        for joint in children.get(name, []):
            T = place.T_link_frame @ joint.origin
            if joint.name in moving:
                pose = Pose3.from_matrix(T)
                found.append(Joint(joint.name, place.link, pose, joint.axis, *joint.span))
                places[joint.child] = Place(len(found), np.eye(4))
            else:
                angle = posture.get(joint.name, 0.0)
                places[joint.child] = Place(place.link, T @ _moved(joint, angle))
            waiting.append(joint.child)
    shapes = tuple(
        (elements.attribute(link, "name", path), shape)
        for link in robot.findall("link")
        for shape in (link.findall("visual") or link.findall("collision"))
    )
    return Merged(path, KinematicTree(tuple(found)), places, shapes)


def _moved(joint: _Element, value: float) -> Float[np.ndarray, "4 4"]:
    """Motion of a frozen joint away from zero."""
    T = np.eye(4)
    if joint.kind in TURNING:
        T[:3, :3] = rotation_about(joint.axis, value)
    elif joint.kind in SLIDING:
        T[:3, 3] = value * np.array(joint.axis)
    return T


def _joint(joint: ET.Element, path: Path) -> _Element:
    name = elements.attribute(joint, "name", path)
    kind = elements.attribute(joint, "type", path)
    if kind not in TURNING + SLIDING + RIGID:
        raise InputError(
            f"{path}: joint {name!r} is of type {kind!r}; expected {', '.join(TURNING + SLIDING + RIGID)}"
        )
    axis, limit = joint.find("axis"), joint.find("limit")
    along = [1.0, 0.0, 0.0] if axis is None else elements.numbers(axis, "xyz", 3, path)
    length = math.hypot(*along)
    if kind in TURNING + SLIDING and length == 0.0:
        raise InputError(f"{path}: joint {name!r} has the axis 0 0 0; expected a direction")
    x, y, z = (v / length if length else 0.0 for v in along)
    span = (-math.pi, math.pi)
    if kind == "revolute" and limit is not None:
        (least,) = elements.numbers(limit, "lower", 1, path, "0")
        (most,) = elements.numbers(limit, "upper", 1, path, "0")
        span = (least, most)
    return _Element(
        name,
        kind,
        elements.attribute(joint.find("parent"), "link", path),
        elements.attribute(joint.find("child"), "link", path),
        elements.origin(joint, path),
        (x, y, z),
        span,
    )
