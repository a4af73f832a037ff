"""Maps as Open3D objects: clouds with attributes per point, layers as tensors, and a mesh of heights.

Tensors share the memory of the arrays that they are made of. Open3D is imported on use: it takes a second.

Source: ours; Zhou, Park and Koltun 2018 (Open3D).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from perception.primitives.errors import InputError


@runtime_checkable
class HeightMap(Protocol):
    """A map of cells: row 0 at the smallest y, column 0 at the smallest x."""

    @property
    def cell_m(self) -> float: ...
    @property
    def origin(self) -> Float[np.ndarray, "2"]: ...
    @property
    def probability(self) -> Float32[np.ndarray, "rows columns"]: ...
    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]: ...
    @property
    def updated_s(self) -> Float[np.ndarray, "rows columns"]: ...
    @property
    def height_m(self) -> Float32[np.ndarray, "rows columns"]: ...
    @property
    def height_variance_m2(self) -> Float32[np.ndarray, "rows columns"]: ...


LAYERS = ("probability", "known", "updated_s", "height_m", "height_variance_m2")


def point_cloud(
    points: Float[np.ndarray, "n 3"],
    colours: UInt8[np.ndarray, "n 3"] | None = None,
    attributes: Mapping[str, np.ndarray] | None = None,
) -> Any:
    """An `open3d.t.geometry.PointCloud`.

    Args:
        points: m.
        colours: RGB; None: none.
        attributes: Further numbers (n,) per point, such as sigma (m), stamp (s), view; each becomes `cloud.point[name]`.

    Raises:
        InputError: An attribute has another length than the cloud.
    """
    import open3d

    tensor: Any = open3d.core.Tensor
    cloud: Any = open3d.t.geometry.PointCloud(tensor.from_numpy(np.ascontiguousarray(points)))
    if colours is not None:
        cloud.point["colors"] = tensor.from_numpy(np.ascontiguousarray(colours))
    for name, values in (attributes or {}).items():
        if len(values) != len(points):
            raise InputError(f"cloud: {name} has {len(values)} values for {len(points)} points")
        kept = values.astype(np.int32) if values.dtype == np.int64 else values  # PLY has no int64
        cloud.point[name] = tensor.from_numpy(np.ascontiguousarray(kept).reshape(-1, 1))
    return cloud


def layers(found: HeightMap) -> dict[str, Any]:
    """The layers of a map as `open3d.core.Tensor` (rows, columns), by their names in `LAYERS`."""
    import open3d

    tensor: Any = open3d.core.Tensor
    return {name: tensor.from_numpy(np.ascontiguousarray(getattr(found, name))) for name in LAYERS}


def height_mesh(found: HeightMap) -> Any:
    """An `open3d.t.geometry.TriangleMesh` of the measured heights, world frame, m: a square for every known cell.

    The colour of a vertex goes from white (free) to red (occupied).
    """
    import open3d

    height = found.height_m
    row, column = np.nonzero(found.known & np.isfinite(height))
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64)
    low = found.origin + found.cell_m * np.stack([column, row], axis=1)
    vertices = np.empty((len(row), 4, 3), np.float32)
    vertices[..., :2] = low[:, None] + found.cell_m * corner
    vertices[..., 2] = height[row, column][:, None]
    free = 1.0 - found.probability[row, column].astype(np.float32)
    colours = np.stack([np.ones_like(free), free, free], axis=1).repeat(4, axis=0)
    first = 4 * np.arange(len(row), dtype=np.int32)[:, None]
    halves = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    triangles = (first[:, None] + halves).reshape(-1, 3)
    tensor: Any = open3d.core.Tensor
    mesh: Any = open3d.t.geometry.TriangleMesh(
        tensor.from_numpy(vertices.reshape(-1, 3)),
        tensor.from_numpy(triangles),
    )
    mesh.vertex["colors"] = tensor.from_numpy(colours)
    return mesh
