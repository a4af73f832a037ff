"""A pose graph as g2o text, which GTSAM, g2o and most tools for graphs read.

The format knows poses, motions between two of them, and in the plane landmarks. It has no place for robust losses, for
poses seen from outside, for floors or for systematic errors: those have done their work in the poses that are written
as vertices. Information matrices are in the axes of the later pose, where the format measures errors.

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

    Landmarks are numbered on from the last pose, in the order of their own numbers.

    Args:
        path: Of the file; an existing one is replaced.
        factors: Those that were solved.
        solution: What came of them; factors that its gate rejected are left out.

    Returns:
        How many edges were written.

    Raises:
        InputError: A factor speaks of a pose or landmark that the solution does not have.
        OutputError: The file cannot be written.
    """
    first = max(solution.poses, default=-1) + 1
    marks = {number: first + i for i, number in enumerate(sorted(solution.landmarks))}
    lines = [_vertex(number, pose) for number, pose in sorted(solution.poses.items())]
    lines += [
        f"VERTEX_XY {marks[number]} {_words(solution.landmarks[number].mean)}"
        for number in sorted(marks)
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
            edges += _sightings(factor, marks)
    try:
        path.write_text("\n".join([*lines, *edges]) + "\n", encoding="ascii")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another path") from error
    return len(edges)


def _vertex(number: int, pose: Gaussian | Placement) -> str:
    if isinstance(pose, Gaussian):
        return f"VERTEX_SE2 {number} {_words(pose.mean)}"
    return f"VERTEX_SE3:QUAT {number} {_words(_numbers(pose.pose))}"


def _edge(factor: Motion | LoopClosure) -> str:
    motion = factor.motion
    local = turned_covariance(factor.covariance, motion.rotation.T)
    kind = "EDGE_SE2" if isinstance(motion, Pose2) else "EDGE_SE3:QUAT"
    numbers = motion.vector if isinstance(motion, Pose2) else _numbers(motion)
    return f"{kind} {factor.before} {factor.after} {_words(numbers)} {_information(local)}"


def _sightings(glance: Glance, marks: dict[int, int]) -> list[str]:
    """Edges to unknown landmarks: where each was seen, body axes."""
    lines = []
    for one in glance.seen:
        if isinstance(one.landmark, tuple):
            continue
        if one.landmark not in marks:
            raise InputError(f"g2o: landmark {one.landmark} is not in the solution")
        r, bearing = (float(v) for v in one.measured)
        c, s = math.cos(bearing), math.sin(bearing)
        out = np.array([[c, -r * s], [s, r * c]])
        P = out @ (one.covariance + np.diag([0.0, glance.play_rad**2])) @ out.T
        place = np.array([r * c, r * s])
        lines.append(
            f"EDGE_SE2_XY {glance.pose} {marks[one.landmark]} {_words(place)} {_information(P)}"
        )
    return lines


def _numbers(pose: Pose3) -> Float[np.ndarray, "7"]:
    quat = np.array(pose.quat_xyzw)
    return np.concatenate([pose.position, quat / np.linalg.norm(quat)])


def _information(covariance: Float[np.ndarray, "d d"]) -> str:
    information = np.linalg.inv(covariance)
    information = (information + information.T) / 2.0
    return _words(information[np.triu_indices(len(covariance))])


def _words(numbers: Float[np.ndarray, "n"]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
