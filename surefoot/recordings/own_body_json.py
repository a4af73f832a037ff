"""The robot's own body and its joint angles as JSON of a recording, without loss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from perception.primitives.kinematics import Joint, KinematicTree
from perception.primitives.own_body import JointReading, OwnBody, OwnPart
from perception.primitives.pose import Pose3


def joints_to_json(joints: JointReading) -> dict[str, list[float]]:
    """Content of the `/joints` message."""
    values = {"angles": joints.angles} | asdict(joints.T_body_base)
    return {name: [float(value) for value in part] for name, part in values.items()}


def joints_from_json(values: Mapping[str, list[float]] | None) -> JointReading | None:
    """The inverse of `joints_to_json`; None for None.

    Raises:
        ValueError: The pose has other numbers than it should.
    """
    if values is None:
        return None
    return JointReading(_pose(values), tuple(map(float, values["angles"])))


def own_body_to_json(own: OwnBody) -> dict[str, Any]:
    """Joints and convex parts of the robot."""
    parts = [vars(part) | {"corners": part.corners.tolist()} for part in own.parts]
    return {"joints": [asdict(joint) for joint in own.tree.joints], "parts": parts}


def own_body_from_json(values: Mapping[str, Any]) -> OwnBody:
    """The inverse of `own_body_to_json`.

    Raises:
        ValueError: A number is not finite, or a part is on no link.
    """
    joints = tuple(
        Joint(
            one["name"],
            one["parent"],
            _pose(one["origin"]),
            _numbers(one["axis"], 3),
            *_numbers([one["least_rad"], one["most_rad"]], 2),
        )
        for one in values["joints"]
    )
    parts = []
    for one in values["parts"]:
        corners = np.array([_numbers(corner, 3) for corner in one["corners"]]).reshape(-1, 3)
        margin_m, sigma_rad = _numbers([one["margin_m"], one["angle_sigma_rad"]], 2)
        if one["link"] not in range(len(joints) + 1) or not len(corners):
            raise ValueError(f"part {one['name']!r} has no corners, or no link")
        parts.append(OwnPart(one["name"], one["link"], corners, margin_m, sigma_rad))
    return OwnBody(KinematicTree(joints), tuple(parts))


def _pose(values: Mapping[str, Any]) -> Pose3:
    return Pose3(_numbers(values["translation"], 3), _numbers(values["quat_xyzw"], 4))


def _numbers(values: list[Any], count: int) -> Any:
    """That many finite numbers, as a tuple."""
    found = tuple(float(value) for value in values)
    if len(found) != count or not np.isfinite(found).all():
        raise ValueError(f"{values} are not {count} finite numbers")
    return found
