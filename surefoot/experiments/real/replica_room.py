"""Simulated recording of Replica's office by a handheld depth camera: ray cast along the given trajectory, with noise.

The noise is that of structured light: a standard deviation that grows with the square of depth, lateral noise at edges,
a resolution of one millimetre, and no depth at grazing incidence or beyond the range.

Source: Straub et al. 2019 (the room); Nguyen, Izadi, Lovell 2012 (noise, lateral shift).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from mapping.surface.meshes import Mesh
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3

from ...recordings.poses import pose_of_matrix
from ..support.simulated_depth import structured_light_sigma

CAMERA = Camera(600, 340, 300.0, 300.0, 299.5, 169.5)  # of the data set, at half resolution
LATERAL_PX = 0.5  # Nguyen 2012: about 0.8 px at full size
GRAZING = 0.12  # cosine of the greatest incidence angle with a depth, 83 deg
FARTHEST_M = 6.0
HZ = 30.0


class ReplicaRoom:
    """The true mesh and trajectory, and the images along it."""

    def __init__(self, path: Path) -> None:
        import open3d

        self._o3d: Any = open3d
        mesh = open3d.io.read_triangle_mesh(path / "office0_mesh.ply")
        mesh.compute_vertex_normals()
        self.mesh = Mesh(
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.triangles, np.int32),
            np.asarray(mesh.vertex_normals, np.float32),
            np.rint(np.asarray(mesh.vertex_colors) * 255.0).astype(np.uint8),
        )
        self._scene = scene_of(self.mesh)
        rows = np.loadtxt(path / "traj.txt").reshape(-1, 4, 4)
        self.poses = [pose_of_matrix(row) for row in rows]
        self.seen = np.zeros(
            len(self.mesh.triangles), bool
        )  # triangles seen by any pixel, without noise

    def frames(self, rng: np.random.Generator, every: int = 1, first: int = 0) -> Iterator[Frame]:
        """Frames with noisy depth and colour at every `every`-th pose from the `first` on."""
        for number in range(first, len(self.poses), every):
            z, rgb = self._look(self.poses[number], rng)
            yield Frame(
                stamp_s=number / HZ,
                depth=DepthView(z, CAMERA),
                colour=ColourView(rgb, CAMERA),
                T_world_camera=self.poses[number],
            )

    def _look(
        self, pose: Pose3, rng: np.random.Generator
    ) -> tuple[Float32[np.ndarray, "h w"], UInt8[np.ndarray, "h w 3"]]:
        size = (CAMERA.height, CAMERA.width)
        slopes = CAMERA.rays.copy()
        slopes[..., :2] += rng.normal(0.0, LATERAL_PX, (*size, 2)) / CAMERA.fx
        rays = np.empty((*size, 6), np.float32)
        rays[..., :3] = pose.position
        rays[..., 3:] = slopes @ pose.rotation.T  # unit depth, so that the ray parameter is depth
        hits = self._scene.cast_rays(self._o3d.core.Tensor(rays))
        z = hits["t_hit"].numpy()
        triangles = hits["primitive_ids"].numpy()
        hit = np.isfinite(z)
        self.seen[np.unique(triangles[hit & (z < FARTHEST_M)])] = True
        normals = hits["primitive_normals"].numpy()
        length = np.linalg.norm(rays[..., 3:], axis=-1)
        cosine = np.abs(np.einsum("hwk,hwk->hw", normals, rays[..., 3:])) / length
        with np.errstate(invalid="ignore"):
            z = z + structured_light_sigma(z) * rng.standard_normal(size)
            z = np.round(z * 1000.0) / 1000.0
        z[~hit | (cosine < GRAZING) | (z > FARTHEST_M) | (z < 0.3)] = np.nan
        return z.astype(np.float32), self._paint(hits, triangles, hit)

    def _paint(
        self, hits: Any, triangles: np.ndarray, hit: np.ndarray
    ) -> UInt8[np.ndarray, "h w 3"]:
        assert self.mesh.colours is not None
        uv = hits["primitive_uvs"].numpy()
        corners = self.mesh.triangles[np.where(hit, triangles, 0)]
        shares = np.stack([1.0 - uv[..., 0] - uv[..., 1], uv[..., 0], uv[..., 1]], axis=-1)
        rgb = np.einsum("hwk,hwkc->hwc", shares, self.mesh.colours[corners].astype(np.float32))
        return np.asarray(np.where(hit[..., None], rgb, 0.0)).astype(np.uint8)


def scene_of(mesh: Mesh) -> Any:
    """Ray casting scene of a mesh (Open3D)."""
    import open3d

    core: Any = open3d.core
    scene: Any = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(core.Tensor(mesh.vertices), core.Tensor(mesh.triangles.astype(np.uint32)))
    return scene
