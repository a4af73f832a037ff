"""A mapped surface against the true one: accuracy, completeness, F-score, and which way it errs.

What the camera never saw cannot be mapped: completeness is asked only of that part of the truth that was seen,
if it is said which that is.

Sources: Knapitsch et al. 2017 (precision, recall and F-score at a distance); Seitz et al. 2006 (accuracy,
completeness).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from perception.primitives.errors import InputError

DISTANCES_M = (0.01, 0.02, 0.05)
SAMPLE_M = 0.005
"""Distance between points that a true mesh is sampled at."""


def surface_metrics(
    mapped: Float[np.ndarray, "n 3"],
    true: Float[np.ndarray, "m 3"],
    true_normals: Float[np.ndarray, "m 3"] | None = None,
    seen: Bool[np.ndarray, "m"] | None = None,
) -> dict[str, float]:
    """Distances from the map to the truth and back.

    Args:
        mapped: Points of the map, m.
        true: Points of the true surface in the same frame, dense beside the errors, m.
        true_normals: Unit, pointing to where one may be; for the sign of the error.
        seen: Which true points any camera saw; None: all are asked for.

    Returns:
        accuracy_mm (median), accuracy_mean_mm, accuracy_p90_mm of the mapped points; and for 1, 2 and 5 cm
        precision_<d>, completeness_<d>, fscore_<d>; bias_mm with normals: mean distance in front of the true
        surface of the points within 5 cm.

    Raises:
        InputError: One of them is empty, or nothing was seen.
    """
    wanted = true if seen is None else true[seen]
    for what, points in (("map", mapped), ("true surface", true), ("seen part of it", wanted)):
        if len(points) == 0:
            raise InputError(f"surfaces: the {what} has no points")
    off, nearest = (np.asarray(found) for found in cKDTree(true).query(mapped, workers=1))
    back = np.asarray(cKDTree(mapped).query(wanted, workers=1)[0])
    figures = {
        "accuracy_mm": 1e3 * float(np.median(off)),
        "accuracy_mean_mm": 1e3 * float(np.mean(off)),
        "accuracy_p90_mm": 1e3 * float(np.percentile(off, 90)),
    }
    for distance in DISTANCES_M:
        name = f"{round(100 * distance)}cm"
        precision, completeness = float(np.mean(off <= distance)), float(np.mean(back <= distance))
        both = precision + completeness
        figures[f"precision_{name}"] = precision
        figures[f"completeness_{name}"] = completeness
        figures[f"fscore_{name}"] = 2.0 * precision * completeness / both if both else 0.0
    near = np.asarray(off <= DISTANCES_M[-1])
    if true_normals is not None and near.any():
        ahead = np.einsum(
            "ij,ij->i", mapped[near] - true[nearest[near]], true_normals[nearest[near]]
        )
        figures["bias_mm"] = 1e3 * float(np.mean(ahead))
    return figures


def read_surface(path: Path, seed: int = 0) -> Float[np.ndarray, "n 3"]:
    """Points of a mesh, sampled evenly, or of a cloud, m.

    Args:
        path: Mesh or cloud in a format that Open3D reads (PLY, OBJ, STL, PCD, ...).
        seed: Of the samples of a mesh.

    Raises:
        InputError: Absent, or neither a mesh nor a cloud.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; a mesh or a cloud (PLY, OBJ, STL, PCD) was expected"
        )
    import open3d as o3d  # slow to import

    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(path)
        if len(mesh.triangles):
            o3d.utility.random.seed(seed)
            count = int(min(max(mesh.get_surface_area() / SAMPLE_M**2, 1_000.0), 3_000_000.0))
            return np.asarray(mesh.sample_points_uniformly(count).points, dtype=np.float64)
        cloud = o3d.io.read_point_cloud(path)
    if not len(cloud.points):
        raise InputError(f"{path}: holds neither triangles nor points that Open3D can read")
    return np.asarray(cloud.points, dtype=np.float64)
