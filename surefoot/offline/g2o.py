"""Write a pose graph as g2o text, which GTSAM, g2o and most graph tools read.

The format has poses, motions between two poses, and landmarks in the plane. It has no robust losses, absolute pose
measurements, floors or systematic errors; their effect is contained in the poses, which are written as vertices.
Information matrices are in the axes of the later pose, in which the format defines errors.

Source: Kümmerle et al., "g2o: a general framework for graph optimization" (2011), and its file format.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError, OutputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3
from perception.smoothing.factors import (
    Factor,
    Glance,
    LoopClosure,
    Motion,
    Placement,
    turned_covariance,
)
from perception.smoothing.smoother import Solution


def write_g2o(path: Path, factors: Sequence[Factor], solution: Solution) -> int:
    """Write the poses of a solution and the motions, closures and unknown landmarks of its factors.

    The numbers of the landmarks follow those of the poses, in the order of the landmarks.

    Args:
        path: The file; an existing one is replaced.
        factors: The factors of the graph.
        solution: Its solution; factors that the solution rejected are left out.

    Returns:
        Number of edges written.

    Raises:
        InputError: A factor refers to a pose or landmark that is not in the solution.
        OutputError: The file cannot be written.
    """
    first = max(solution.poses, default=-1) + 1
    landmark_ids = {number: first + i for i, number in enumerate(sorted(solution.landmarks))}
    lines = [_vertex(number, pose) for number, pose in sorted(solution.poses.items())]
    lines += [
        f"VERTEX_XY {landmark_ids[number]} {_text(solution.landmarks[number].mean)}"
        for number in sorted(landmark_ids)
    ]
    rejected = {id(factor) for factor in solution.rejected}
    edges: list[str] = []
    for factor in factors:
        if isinstance(factor, (Motion, LoopClosure)) and id(factor) not in rejected:
            for number in (factor.before, factor.after):
                if number not in solution.poses:
                    raise InputError(f"g2o: pose {number} of a motion is not in the solution")
            edges.append(_edge(factor))
        elif isinstance(factor, Glance):
            edges += _sightings(factor, landmark_ids)
    try:
        path.write_text("\n".join([*lines, *edges]) + "\n", encoding="ascii")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another path") from error
    return len(edges)


def _vertex(number: int, pose: Gaussian | Placement) -> str:
    if isinstance(pose, Gaussian):
        return f"VERTEX_SE2 {number} {_text(pose.mean)}"
    return f"VERTEX_SE3:QUAT {number} {_text(_numbers(pose.pose))}"


def _edge(factor: Motion | LoopClosure) -> str:
    motion = factor.motion
    local = turned_covariance(factor.covariance, motion.rotation.T)
    kind = "EDGE_SE2" if isinstance(motion, Pose2) else "EDGE_SE3:QUAT"
    numbers = motion.vector if isinstance(motion, Pose2) else _numbers(motion)
    return f"{kind} {factor.before} {factor.after} {_text(numbers)} {_information(local)}"


def _sightings(glance: Glance, landmark_ids: dict[int, int]) -> list[str]:
    """Edges to unknown landmarks, with their measured position in body axes."""
    lines = []
    for seen in glance.seen:
        if isinstance(seen.landmark, tuple):
            continue
        if seen.landmark not in landmark_ids:
            raise InputError(f"g2o: landmark {seen.landmark} is not in the solution")
        r, bearing = (float(v) for v in seen.measured)
        c, s = math.cos(bearing), math.sin(bearing)
        out = np.array([[c, -r * s], [s, r * c]])
        P = out @ (seen.covariance + np.diag([0.0, glance.play_rad**2])) @ out.T
        position = np.array([r * c, r * s])
        lines.append(
            f"EDGE_SE2_XY {glance.pose} {landmark_ids[seen.landmark]} {_text(position)} {_information(P)}"
        )
    return lines


def _numbers(pose: Pose3) -> Float[np.ndarray, "7"]:
    quat = np.array(pose.quat_xyzw)
    return np.concatenate([pose.position, quat / np.linalg.norm(quat)])


def _information(covariance: Float[np.ndarray, "d d"]) -> str:
    information = np.linalg.inv(covariance)
    information = (information + information.T) / 2.0
    return _text(information[np.triu_indices(len(covariance))])


def _text(numbers: Float[np.ndarray, "n"]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
