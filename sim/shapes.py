"""Shapes of a scene, and the textured patches of their surfaces.

Boxes and cylinders stand upright; a `Solid` is a triangle mesh. Rendering and ray casting use the same patches, so
images and ranges agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

_CHUNK = 10_000  # points per call against all corners of an outline: about 10 MB
SEGMENTS = 32  # sides of a cylinder's polygon, which is 0.5 mm inside a circle of 10 cm radius


@dataclass(frozen=True)
class Box:
    """An upright box.

    Args:
        centre: (x, y, z), world frame, m.
        size: Along its own x, y, z, m.
        yaw_rad: Rotation about the vertical.
        material: See `rendering.textures`.
        front: Material of the face towards its own +x; empty for the same.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw_rad: float = 0.0
    material: str = "plaster/white"
    front: str = ""

    @property
    def bottom_m(self) -> float:
        """Height of its lower face."""
        return self.centre[2] - self.size[2] / 2

    @property
    def top_m(self) -> float:
        """Height of its upper face."""
        return self.centre[2] + self.size[2] / 2


@dataclass(frozen=True)
class Cylinder:
    """A vertical cylinder: centre (x, y, z), radius and height, m."""

    centre: tuple[float, float, float]
    radius: float
    height: float
    material: str = "plaster/white"

    @property
    def bottom_m(self) -> float:
        """Height of its lower face."""
        return self.centre[2] - self.height / 2

    @property
    def top_m(self) -> float:
        """Height of its upper face."""
        return self.centre[2] + self.height / 2


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed triangle mesh of one piece; contact uses the convex hull of its projection on the floor.

    Args:
        vertices: World frame, m.
        triangles: Vertex indices, counter-clockwise from outside.
        material: See `rendering.textures`.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    material: str = "plaster/white"

    @property
    def centre(self) -> tuple[float, float, float]:
        """Centre of its bounding box."""
        x, y, z = (float(v) for v in (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2)
        return x, y, z

    @property
    def bottom_m(self) -> float:
        """Height of its lowest point."""
        return float(self.vertices[:, 2].min())

    @property
    def top_m(self) -> float:
        """Height of its highest point."""
        return float(self.vertices[:, 2].max())


Shape = Box | Cylinder | Solid


@dataclass(frozen=True, eq=False)
class Patch:
    """A surface patch with its own rectangle of texture.

    Args:
        vertices: World frame, m.
        triangles: Vertex indices, counter-clockwise from outside.
        uv: Texture coordinates in [0, 1], (0, 0) the upper left corner.
        size_m: Width and height of the texture on the surface.
        normal: Outward; for the side of a cylinder that of its first line.
        material: See `rendering.textures`.
        curved: Whether it is the side of a cylinder.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    uv: Float[np.ndarray, "n 2"]
    size_m: tuple[float, float]
    normal: Float[np.ndarray, "3"]
    material: str
    curved: bool = False


def patches(shape: Shape) -> list[Patch]:
    """Visible surface of a shape; a lower face on the floor is left out."""
    if isinstance(shape, Box):
        return _box_patches(shape)
    if isinstance(shape, Solid):
        return _solid_patches(shape)
    return _cylinder_patches(shape)


def rectangle(
    corner: Float[np.ndarray, "3"],
    right: Float[np.ndarray, "3"],
    down: Float[np.ndarray, "3"],
    material: str,
) -> Patch:
    """Flat patch from its upper left corner and the edges of its texture, as seen from outside."""
    vertices = np.stack([corner, corner + down, corner + down + right, corner + right])
    normal = np.cross(down, right)
    return Patch(
        vertices,
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]),
        (float(np.linalg.norm(right)), float(np.linalg.norm(down))),
        normal / np.linalg.norm(normal),
        material,
    )


def outline(shape: Shape) -> Float[np.ndarray, "n 2"]:
    """Convex outline of the shape projected on the floor: corners counter-clockwise, world frame, m."""
    if isinstance(shape, Cylinder):
        angle = np.arange(SEGMENTS) * 2 * math.pi / SEGMENTS
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.asarray(shape.centre[:2] + shape.radius * ring)
    if isinstance(shape, Solid):
        flat = shape.vertices[:, :2]
        return np.asarray(flat[ConvexHull(flat).vertices])
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(shape.size[:2]) / 2
    c, s = math.cos(shape.yaw_rad), math.sin(shape.yaw_rad)
    return np.asarray(half @ np.array([[c, s], [-s, c]]) + np.array(shape.centre[:2]))


def distance(shape: Shape, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Exact signed distance of floor points from the shape's outline, m; negative inside."""
    offset = points - np.array(shape.centre[:2])
    if isinstance(shape, Cylinder):
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]) - shape.radius)
    if isinstance(shape, Solid):
        corners = outline(shape)
        chunks = range(0, max(len(points), 1), _CHUNK)
        return np.concatenate([_polygon_distance(corners, points[k : k + _CHUNK]) for k in chunks])
    c, s = math.cos(shape.yaw_rad), math.sin(shape.yaw_rad)
    local = np.abs(offset @ np.array([[c, -s], [s, c]])) - np.array(shape.size[:2]) / 2
    along, across = local[:, 0], local[:, 1]
    outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    return np.asarray(outside + np.minimum(np.maximum(along, across), 0.0))


def convex_gap(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "m 2"]) -> float:
    """Exact distance between two convex outlines, m; if they overlap, minus the penetration depth.

    Corners run counter-clockwise; the penetration depth is the least over all edge normals.
    """
    depth = max(_separation(a, b), _separation(b, a))
    if depth <= 0.0:
        return depth
    return min(_corner_distance(a, b), _corner_distance(b, a))


def _polygon_distance(
    corners: Float[np.ndarray, "n 2"], points: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "m"]:
    """Signed distance of points from a convex outline; negative inside."""
    edge = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    offset = points[:, None] - corners[None]
    height = np.einsum("mnd,nd->mn", offset, outward).max(axis=1)
    share = (offset * edge).sum(axis=2) / (edge**2).sum(axis=1)
    nearest = np.clip(share, 0.0, 1.0)[..., None] * edge
    gap = np.linalg.norm(offset - nearest, axis=2).min(axis=1)
    return np.where(height > 0.0, gap, height)


def _separation(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "m 2"]) -> float:
    """Greatest signed distance of b from the edges of a."""
    edge = np.roll(a, -1, axis=0) - a
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    heights = (b[None] - a[:, None]) @ outward[:, :, None]
    return float(heights[..., 0].min(axis=1).max())


def _corner_distance(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "m 2"]) -> float:
    """Least distance of a corner of b from an edge of a."""
    edge = np.roll(a, -1, axis=0) - a
    offset = b[None] - a[:, None]
    share = (offset * edge[:, None]).sum(axis=2) / (edge**2).sum(axis=1)[:, None]
    nearest = np.clip(share, 0.0, 1.0)[..., None] * edge[:, None]
    return float(np.linalg.norm(offset - nearest, axis=2).min())


def _box_patches(box: Box) -> list[Patch]:
    c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    x, y, z = np.array([c, s, 0.0]), np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])
    hx, hy, hz = (v / 2 for v in box.size)
    middle = np.array(box.centre)
    found = []
    for outward, leftward, depth, width, front in (
        (x, y, hx, hy, True),
        (y, -x, hy, hx, False),
        (-x, -y, hx, hy, False),
        (-y, x, hy, hx, False),
    ):
        # seen from outside, the left edge of the side is at minus `leftward`
        corner = middle + outward * depth - leftward * width + z * hz
        material = box.front if front and box.front else box.material
        found.append(rectangle(corner, 2 * width * leftward, -2 * hz * z, material))
    found.append(
        rectangle(middle - x * hx + y * hy + z * hz, 2 * hx * x, -2 * hy * y, box.material)
    )
    if box.bottom_m > 1e-6:
        found.append(
            rectangle(middle - x * hx - y * hy - z * hz, 2 * hx * x, 2 * hy * y, box.material)
        )
    return found


def _solid_patches(solid: Solid) -> list[Patch]:
    """Up to six patches: triangles facing one axis, with the texture projected along it."""
    corners = solid.vertices[solid.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    positive = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0
    found = []
    for along, sign in ((k, s) for k in range(3) for s in (True, False)):
        chosen = solid.triangles[(axis == along) & (positive == sign)]
        if not len(chosen):
            continue
        used, triangles = np.unique(chosen, return_inverse=True)
        vertices = solid.vertices[used]
        across, down = ((1, 2), (0, 2), (0, 1))[along]
        flat = vertices[:, [across, down]] * np.array([1.0, -1.0])
        low, size = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0), 1e-3)
        normal = np.zeros(3)
        normal[along] = 1.0 if sign else -1.0
        width, height = (float(v) for v in size)
        uv = (flat - low) / size
        triangles = triangles.reshape(-1, 3)
        found.append(Patch(vertices, triangles, uv, (width, height), normal, solid.material))
    return found


def _cylinder_patches(cylinder: Cylinder) -> list[Patch]:
    angle = np.arange(SEGMENTS + 1) * 2 * math.pi / SEGMENTS
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    middle = np.array(cylinder.centre)
    up = np.array([0.0, 0.0, cylinder.height / 2])
    top, bottom = (middle + cylinder.radius * ring + sign * up for sign in (1, -1))
    along = np.linspace(0.0, 1.0, SEGMENTS + 1)
    first = np.arange(SEGMENTS)
    below = first + SEGMENTS + 1
    side = Patch(
        np.concatenate([top, bottom]),
        np.concatenate(
            [np.stack([first, below, below + 1], 1), np.stack([first, below + 1, first + 1], 1)]
        ),
        np.concatenate([np.stack([along, 0 * along], 1), np.stack([along, 0 * along + 1], 1)]),
        (2 * math.pi * cylinder.radius, cylinder.height),
        np.array([1.0, 0.0, 0.0]),
        cylinder.material,
        curved=True,
    )
    found = [side, _disc(middle + up, cylinder.radius, 1.0, cylinder.material)]
    if cylinder.bottom_m > 1e-6:
        found.append(_disc(middle - up, cylinder.radius, -1.0, cylinder.material))
    return found


def _disc(centre: Float[np.ndarray, "3"], radius: float, up: float, material: str) -> Patch:
    angle = np.arange(SEGMENTS) * 2 * math.pi / SEGMENTS
    ring = np.stack([np.cos(angle), up * np.sin(angle), np.zeros_like(angle)], axis=1)
    first = np.arange(SEGMENTS)
    return Patch(
        np.concatenate([centre[None], centre + radius * ring]),
        np.stack([0 * first, 1 + first, 1 + (first + 1) % SEGMENTS], axis=1),
        np.concatenate([[[0.5, 0.5]], 0.5 + 0.5 * ring[:, :2] * np.array([1.0, -up])]),
        (2 * radius, 2 * radius),
        np.array([0.0, 0.0, up]),
        material,
    )
