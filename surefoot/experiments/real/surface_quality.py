"""Comparison of a surface with the true one: accuracy, completeness, F-score.

Source: Knapitsch et al. 2017 (F-score of reconstructions).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mapping.surface.meshes import Mesh

from .replica_room import ReplicaRoom, scene_of

SAMPLES = 200_000  # points on each surface


@dataclass(frozen=True)
class Quality:
    """Comparison of a surface with the true one.

    Args:
        accuracy_mm: Median distance of its points from the true surface.
        completeness_5cm: Share of the visible true points within 5 cm of it.
        fscore_2cm: Harmonic mean of the shares within 2 cm, in both directions.
    """

    accuracy_mm: float
    completeness_5cm: float
    fscore_2cm: float


def quality(mesh: Mesh, room: ReplicaRoom, rng: np.random.Generator) -> Quality:
    """Compare a mesh in the room's frame with the truth."""
    true = Mesh(room.mesh.vertices, room.mesh.triangles[room.seen], room.mesh.normals)
    to_truth = distances_to(scene_of(room.mesh), mesh.sampled(SAMPLES, rng))
    to_found = distances_to(scene_of(mesh), true.sampled(SAMPLES, rng))
    precise, recalled = float(np.mean(to_truth < 0.02)), float(np.mean(to_found < 0.02))
    return Quality(
        1e3 * float(np.median(to_truth)),
        float(np.mean(to_found < 0.05)),
        2.0 * precise * recalled / max(precise + recalled, 1e-9),
    )


def distances_to(scene: Any, points: np.ndarray) -> np.ndarray:
    """Distance of each point to the surface, m."""
    import open3d

    core: Any = open3d.core
    return np.asarray(scene.compute_distance(core.Tensor(points)).numpy())
