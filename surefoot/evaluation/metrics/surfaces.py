"""A mapped surface against the true one: accuracy, completeness and F-score.

Sources: Knapitsch et al. 2017 (precision, recall and F-score at a distance); Seitz et al. 2006 (accuracy,
completeness).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from perception.primitives import mesh_reader
from perception.primitives.errors import InputError
from perception.primitives.mesh_reader import MeshError

DISTANCES_M = (0.01, 0.02, 0.05)
SAMPLE_M = 0.005
MOST_EXTENT_M = 1000.0  # ours: of a surface to compare; more is another unit
"""Spacing of the sample points of a true mesh."""


def surface_metrics(
    mapped: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "m 3"]
) -> dict[str, float]:
    """Distances from the map to the truth and from the truth to the map.

    Args:
        mapped: Points of the map, m.
        true: Points of the true surface in the same frame, m; their spacing must be small beside the errors.

    Returns:
        accuracy_mm (median), accuracy_mean_mm, accuracy_p90_mm of the mapped points; and for 1, 2 and 5 cm
        precision_<d> (share of mapped points so close to the truth), completeness_<d> (share of true points
        so close to the map), fscore_<d> (their harmonic mean).

    Raises:
        InputError: One of them is empty.
    """
    for what, points in (("map", mapped), ("true surface", true)):
        if len(points) == 0:
            raise InputError(f"surfaces: the {what} has no points")
    to_truth = np.asarray(cKDTree(true).query(mapped, workers=1)[0])
    to_map = np.asarray(cKDTree(mapped).query(true, workers=1)[0])
    figures = {
        "accuracy_mm": 1e3 * float(np.median(to_truth)),
        "accuracy_mean_mm": 1e3 * float(np.mean(to_truth)),
        "accuracy_p90_mm": 1e3 * float(np.percentile(to_truth, 90)),
    }
    for distance in DISTANCES_M:
        name = f"{round(100 * distance)}cm"
        precision = float(np.mean(to_truth <= distance))
        completeness = float(np.mean(to_map <= distance))
        both = precision + completeness
        figures[f"precision_{name}"] = precision
        figures[f"completeness_{name}"] = completeness
        figures[f"fscore_{name}"] = 2.0 * precision * completeness / both if both else 0.0
    return figures


def read_surface(path: Path) -> Float[np.ndarray, "n 3"]:
    """Points of a mesh, sampled uniformly, or of a cloud, m.

    Args:
        path: Mesh or cloud in a format that Open3D reads (PLY, OBJ, STL, PCD, ...).

    Raises:
        InputError: The file does not exist, or is neither a mesh nor a cloud.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; a mesh or a cloud (PLY, OBJ, STL, PCD) was expected"
        )
    try:
        found = mesh_reader.read(path)
    except MeshError as error:
        raise InputError(f"{path}: {error}") from error
    extent = float(np.ptp(found.vertices, axis=0).max())
    if extent > MOST_EXTENT_M:
        raise InputError(
            f"{path}: is {extent:.0f} m wide; {MOST_EXTENT_M:.0f} m are the most, check its unit"
        )
    if not len(found.triangles):
        return found.vertices
    import open3d as o3d  # slow to import

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(found.vertices), o3d.utility.Vector3iVector(found.triangles)
    )
    o3d.utility.random.seed(0)
    count = int(min(max(mesh.get_surface_area() / SAMPLE_M**2, 1_000.0), 3_000_000.0))
    return np.asarray(mesh.sample_points_uniformly(count).points, dtype=np.float64)
