"""Triangle meshes, and their PLY files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, UInt8

from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from ..io import ply
from ..io.atomic_write import atomic_path
from ..io.clouds import MOST_M


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in the map frame.

    Args:
        vertices: Positions, m.
        triangles: Indices of vertices, counter-clockwise as seen from free space.
        normals: Unit normals of the vertices, towards free space.
        colours: RGB of the vertices; None without colours.
    """

    vertices: Float32[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    normals: Float32[np.ndarray, "n 3"]
    colours: UInt8[np.ndarray, "n 3"] | None = None

    @property
    def areas(self) -> Float32[np.ndarray, "m"]:
        """Areas of the triangles, m^2."""
        a, b, c = (self.vertices[self.triangles[:, n]] for n in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    def sampled(self, count: int, rng: np.random.Generator) -> Float32[np.ndarray, "count 3"]:
        """Random points on the surface, uniform over its area, m; none without area."""
        areas = self.areas.astype(np.float64)
        if not areas.sum() > 0.0:
            return np.zeros((0, 3), np.float32)
        chosen = self.triangles[rng.choice(len(areas), count, p=areas / areas.sum())]
        s, t = np.sqrt(rng.random(count)), rng.random(count)
        shares = np.stack([1.0 - s, s * (1.0 - t), s * t], axis=1)
        return np.asarray(np.einsum("nk,nkd->nd", shares, self.vertices[chosen]), np.float32)


def save_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a binary PLY with normals and optional colours, atomically.

    Raises:
        OutputError: The file cannot be written.
    """
    fields = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    columns = [*mesh.vertices.T, *mesh.normals.T]
    kinds = ["float"] * 6
    if mesh.colours is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
        columns += [*mesh.colours.T]
        kinds += ["uchar"] * 3
    vertices = np.empty(len(mesh.vertices), fields)
    for (name, _), column in zip(fields, columns, strict=True):
        vertices[name] = column
    triangles = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", (3,))])
    triangles["count"], triangles["corners"] = 3, mesh.triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property {kind} {name}" for kind, (name, _) in zip(kinds, fields, strict=True)]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
        file.write(triangles.tobytes())


def load_mesh(path: str | Path) -> Mesh:
    """A mesh that `save_mesh` wrote.

    Raises:
        InputError: The file is missing or damaged, or holds something else.
    """
    try:
        points, triangles = ply.read_mesh(path)
        names = points.dtype.names or ()
        if not set(_NORMAL) <= set(names):
            raise UnreadableError("has no normals")
        xyz, normals = (
            np.stack([points[name] for name in axes], axis=-1).astype(np.float32)
            for axes in (("x", "y", "z"), _NORMAL)
        )
        if not (np.abs(xyz) <= MOST_M).all():
            raise UnreadableError(f"has points that are not within {MOST_M:g} m of its origin")
    except UnreadableError as error:
        raise InputError(f"mesh {path} {error}; a PLY of a map was expected") from error
    coloured = all(name in names and points[name].dtype == np.uint8 for name in _RGB)
    colours = np.stack([points[name] for name in _RGB], axis=-1) if coloured else None
    return Mesh(xyz, triangles, normals, colours)


_NORMAL = ("nx", "ny", "nz")
_RGB = ("red", "green", "blue")
