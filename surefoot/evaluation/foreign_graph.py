"""Pose graphs as g2o text, and the covariances that follow from the information of their edges.

The information of an edge is in the axes of its later pose, over (position, rotation vector), as GTSAM and
`surefoot map` write it; g2o itself takes it over (position, vector part of the quaternion), which is half as large. The
vertices are taken for the solution of the graph.

Source: Kümmerle et al. 2011 (the format); Dellaert and Kaess (2006) (marginals).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from perception.odometry.pose_uncertainty import AttachedImage, pose_uncertainty
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from perception.smoothing.factors import Factor, LoopClosure, Motion, turned_covariance

from ..results.tables import numbers_of, text_lines

_LEVEL = 1e-8  # variance of height and tilt of a planar graph, m^2 and rad^2: nearly none
_FLOOR = (0, 1, 5)  # x, y and yaw among (x, y, z, rotation vector)
_NUMBERS = {"VERTEX_SE3:QUAT": 8, "VERTEX_SE2": 4, "EDGE_SE3:QUAT": 30, "EDGE_SE2": 11}


@dataclass(frozen=True)
class PoseGraph:
    """Vertices and edges of a graph.

    Args:
        numbers: Of the vertices, increasing.
        poses: Of the vertices by number.
        factors: The edges.
        planar: Whether the vertices are (x, y, yaw).
    """

    numbers: Int[np.ndarray, "n"]
    poses: Mapping[int, Pose3]
    factors: tuple[Factor, ...]
    planar: bool

    @property
    def positions(self) -> Float[np.ndarray, "n 3"]:
        """Positions of the vertices, m."""
        return np.array([self.poses[int(number)].position for number in self.numbers])

    def covariances(
        self, chosen: Int[np.ndarray, "m"], aligned: bool
    ) -> Float[np.ndarray, "m k k"]:
        """Covariances of some of the vertices, world axes.

        Args:
            chosen: Indices into `numbers`.
            aligned: After the rigid alignment over the chosen vertices; else relative to the first of them.
        """
        none = np.zeros((6, 6))
        images = [
            AttachedImage(self.poses[int(number)], int(number), none)
            for number in self.numbers[chosen]
        ]
        found = pose_uncertainty(self.factors, self.poses, images)
        both = found.aligned if aligned else found.from_start
        return both[:, _FLOOR][:, :, _FLOOR] if self.planar else both


def is_graph(path: Path) -> bool:
    """Whether the file has lines of a pose graph."""
    return any(line.startswith(("VERTEX_", "EDGE_")) for line in text_lines(path))


def read_vertices(path: Path) -> Float[np.ndarray, "n 7"]:
    """Poses (x, y, z, qx, qy, qz, qw) of the vertices, by increasing number.

    Raises:
        InputError: A line is cut off, or the file has no poses.
    """
    found = {int(row[0]): row[1:] for word, row, _ in _records(path) if word.startswith("VERTEX")}
    if not found:
        raise InputError(f"{path} has no vertices; expected VERTEX_SE3:QUAT or VERTEX_SE2")
    rows = [found[number] for number in sorted(found)]
    return np.array(
        [
            row if len(row) == 7 else [*(pose := _pose(row)).position, *pose.quat_xyzw]
            for row in rows
        ]
    )


def read_g2o(path: Path) -> PoseGraph:
    """Read the poses and the edges between poses of a graph; other lines are left out.

    Raises:
        InputError: A line is cut off, or the file has no poses, poses of both kinds, or edges to none of them.
    """
    vertices: dict[int, Pose3] = {}
    edges: list[tuple[int, int, list[float], int]] = []
    kinds = set()
    for word, row, number in _records(path):
        kinds.add("SE2" in word)
        if word.startswith("VERTEX"):
            vertices[int(row[0])] = _pose(row[1:])
        else:
            edges.append((int(row[0]), int(row[1]), row[2:], number))
    if not vertices or not edges or len(kinds) != 1:
        raise InputError(
            f"{path}: {len(vertices)} poses and {len(edges)} edges between poses, of {len(kinds)} kinds; "
            "expected VERTEX_SE3:QUAT and EDGE_SE3:QUAT, or VERTEX_SE2 and EDGE_SE2"
        )
    numbers = np.array(sorted(vertices))
    after = dict(zip(numbers[:-1].tolist(), numbers[1:].tolist(), strict=True))
    factors: list[Factor] = []
    for before, to, row, line_number in edges:
        if before not in vertices or to not in vertices:
            raise InputError(
                f"{path}, line {line_number}: an edge to a vertex that is not in the file"
            )
        motion, covariance = _edge(path, line_number, row)
        kind = Motion if after.get(before) == to else LoopClosure
        factors.append(kind(before, to, motion, covariance))
    return PoseGraph(numbers, vertices, tuple(factors), kinds.pop())


def _records(path: Path) -> Iterator[tuple[str, list[float], int]]:
    """Kind, numbers, and number in the file, of the lines of poses and of edges between poses."""
    for number, line in enumerate(text_lines(path), start=1):
        word, *words = line.split("#", 1)[0].split() or [""]
        if word not in _NUMBERS:
            continue
        row = numbers_of(words)
        if len(row) != _NUMBERS[word] or not np.all(np.isfinite(row)):
            raise InputError(
                f"{path}, line {number}: {len(row) or 'no'} numbers after {word}; expected {_NUMBERS[word]}"
            )
        yield word, row, number


def _pose(row: list[float]) -> Pose3:
    if len(row) == 3:
        x, y, yaw = row
        return Pose3((x, y, 0.0), (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))))
    x, y, z = row[:3]
    qx, qy, qz, qw = (np.array(row[3:]) / np.linalg.norm(row[3:])).tolist()
    return Pose3((x, y, z), (qx, qy, qz, qw))


def _edge(path: Path, line: int, row: list[float]) -> tuple[Pose3, Float[np.ndarray, "6 6"]]:
    """The motion, and its covariance in the axes of the pose before it."""
    size, poses = (3, 3) if len(row) == 9 else (6, 7)
    motion = _pose(row[:poses])
    information = np.zeros((size, size))
    information[np.triu_indices(size)] = row[poses:]
    information += np.triu(information, 1).T
    if np.linalg.eigvalsh(information)[0] <= 0.0:
        raise InputError(f"{path}, line {line}: the information matrix is not positive definite")
    covariance = _LEVEL * np.eye(6)
    where = _FLOOR if size == 3 else tuple(range(6))
    covariance[np.ix_(where, where)] = np.linalg.inv(information)
    return motion, turned_covariance(covariance, motion.rotation)
