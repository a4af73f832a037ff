"""Textured meshes of a scene: every patch painted, shaded, and packed into one texture per object.

Light comes from above and slightly from one side; surfaces darken near the floor and near furniture. The shading is
part of the textures and costs nothing at rendering.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from ..scene import Extent, FloorArea, Scene
from ..shapes import Patch, Shape, Solid, outline, patches
from .renderer import TexturedMesh
from .surfaces import floor_patch
from .textures import paint, shaded

FLOOR_RESOLUTION_M = 0.0016  # ours: a stereo pixel at 0.9 m; finer costs start-up time
SURFACE_RESOLUTION_M = 0.002  # ours
WALL_RESOLUTION_M = 0.0025  # ours
MOST_PX = 26e6  # ours: 8 x 8 m of floor, 75 MB; larger surfaces get a coarser texture
MOST_SCENE_PX = 60e6
"""Ours: pixels of all textures but floor and tags, 2 GB in a renderer; larger scenes get coarser ones."""
MOST_SIDE_PX = 8000  # ours: every renderer accepts such a texture
_LIGHT = np.array([0.35, -0.25, 0.90]) / math.hypot(0.35, 0.25, 0.90)  # ours
_WIDTH_UNIT = 4  # EGL shears textures whose rows are no multiple of 4 px
_BORDER_PX = 8  # ours: each patch repeats its edge, so that mipmaps do not mix neighbours


def paint_scene(scene: Scene) -> tuple[list[TexturedMesh], list[TexturedMesh]]:
    """Meshes of the static objects, and of each moving body about its own origin."""
    standing = [part for _, part in scene.static_shapes]
    coarser = _coarser(scene)
    floor = floor_patch(scene)
    image = _floor_image(scene, standing, np.random.default_rng([scene.seed, 10]))
    still = [TexturedMesh(floor.vertices, floor.triangles, floor.uv, image)]
    for k, item in enumerate(scene.static_objects):
        rng = np.random.default_rng([scene.seed, 11, k])
        surfaces = [p for part in item.parts for p in patches(part) if _is_inside(p, scene.extent)]
        if surfaces:
            finest_m = WALL_RESOLUTION_M if item.wall else SURFACE_RESOLUTION_M
            still.append(_paint(surfaces, rng, coarser * finest_m))
    moving_bodies = []
    for k, (_, parts, _) in enumerate(scene.moving_bodies):
        rng = np.random.default_rng([scene.seed, 12, k])
        surfaces = [p for part in parts for p in patches(part)]
        moving_bodies.append(_paint(surfaces, rng, SURFACE_RESOLUTION_M))
    return still, moving_bodies


def paint_links(links: Sequence[Sequence[Solid]]) -> list[TexturedMesh]:
    """Meshes of the robot's own links, each about its own frame."""
    rng = np.random.default_rng(13)
    return [
        _paint([p for part in parts for p in patches(part)], rng, SURFACE_RESOLUTION_M)
        for parts in links
    ]


def _coarser(scene: Scene) -> float:
    """Factor on the resolution of all static objects that keeps the textures of a large scene within the limit."""
    pixels = 0.0
    for item in scene.static_objects:
        px_m = WALL_RESOLUTION_M if item.wall else SURFACE_RESOLUTION_M
        for patch in (patch for part in item.parts for patch in patches(part)):
            if _is_inside(patch, scene.extent) and not patch.material.startswith("tag/"):
                width, height = patch.size_m
                pixels += width * height / _limited_resolution(patch.size_m, px_m) ** 2
    return max(1.0, math.sqrt(pixels / MOST_SCENE_PX))


def _is_inside(patch: Patch, extent: Extent) -> bool:
    """Whether a patch faces the room: the outer sides of its walls do not."""
    x, y, _ = patch.vertices.mean(axis=0)
    return bool(extent[0] <= x <= extent[2] and extent[1] <= y <= extent[3])


def _paint(surfaces: Sequence[Patch], rng: np.random.Generator, px_m: float) -> TexturedMesh:
    """Paint patches and pack them into one texture."""
    images = [_lit(patch, rng, px_m) for patch in surfaces]
    framed = [
        np.pad(image, ((_BORDER_PX, _BORDER_PX), (_BORDER_PX, _BORDER_PX), (0, 0)), mode="edge")
        for image in images
    ]
    places, size = _shelves([image.shape[:2] for image in framed])
    sheet = np.full((*size, 3), 128, np.uint8)
    vertices, triangles, uv = [], [], []
    count = 0
    for patch, image, (top, left) in zip(surfaces, framed, places, strict=True):
        height, width = image.shape[:2]
        sheet[top : top + height, left : left + width] = image
        corner = np.array([left + _BORDER_PX, top + _BORDER_PX])
        inner = np.array([width - 2 * _BORDER_PX, height - 2 * _BORDER_PX])
        uv.append((corner + patch.uv * inner) / np.array([size[1], size[0]]))
        vertices.append(patch.vertices)
        triangles.append(patch.triangles + count)
        count += len(patch.vertices)
    return TexturedMesh(
        np.concatenate(vertices),
        np.concatenate(triangles),
        np.concatenate(uv),
        sheet,
    )


def _shelves(sizes: Sequence[tuple[int, int]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Positions (top, left) of rectangles in rows, tallest first, and the size of the sheet."""
    across = max(max(w for _, w in sizes), int(math.sqrt(sum(h * w for h, w in sizes))))
    across = -(-across // _WIDTH_UNIT) * _WIDTH_UNIT
    places: list[tuple[int, int]] = [(0, 0)] * len(sizes)
    top = left = row = 0
    for index in sorted(range(len(sizes)), key=lambda i: (-sizes[i][0], i)):
        height, width = sizes[index]
        if left + width > across:
            top, left, row = top + row, 0, 0
        places[index] = (top, left)
        left, row = left + width, max(row, height)
    return places, (top + row, across)


def _lit(patch: Patch, rng: np.random.Generator, px_m: float) -> UInt8[np.ndarray, "h w 3"]:
    """The patch's material under the light of the room."""
    image = paint(patch.material, patch.size_m, _limited_resolution(patch.size_m, px_m), rng)
    if patch.material.startswith("tag/"):
        return image
    height, width = image.shape[:2]
    if patch.curved:
        angle = (np.arange(width) + 0.5) / width * 2 * math.pi
        facing = np.cos(angle) * _LIGHT[0] + np.sin(angle) * _LIGHT[1]
    else:
        facing = np.full(width, float(patch.normal @ _LIGHT))
    light = np.broadcast_to(0.84 + 0.20 * facing, (height, width))
    if abs(float(patch.normal[2])) < 0.5:
        top = float(patch.vertices[:, 2].max())
        above = np.maximum(top - (np.arange(height) + 0.5) / height * patch.size_m[1], 0.0)
        light = light * (1.0 - 0.35 * np.exp(-above / 0.12))[:, None]
    return shaded(image, light.astype(np.float32))


def _floor_image(
    scene: Scene, standing: Sequence[Shape], rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """All flooring, with soft contact shadows."""
    x0, y0, x1, y1 = scene.extent
    px_m = _limited_resolution((x1 - x0, y1 - y0), FLOOR_RESOLUTION_M)
    width = _WIDTH_UNIT * round((x1 - x0) / px_m / _WIDTH_UNIT)
    size = (round((y1 - y0) / px_m), width)
    image = np.zeros((*size, 3), np.uint8)
    for area in scene.floor:
        rows, columns = _window(area, scene.extent, size, px_m)
        a, b, c, d = area.extent
        piece = paint(area.material, (c - a, d - b), px_m, rng)
        wide = (columns.stop - columns.start, rows.stop - rows.start)
        if min(wide) < 1:  # less than a pixel inside
            continue
        image[rows, columns] = cv2.resize(piece, wide, interpolation=cv2.INTER_LINEAR)
    return shaded(image, _contact_shade(scene.extent, standing, size))


def _limited_resolution(size_m: tuple[float, float], px_m: float) -> float:
    """Resolution, made coarser where the texture of a large surface would exceed the limits."""
    width, height = size_m
    return max(px_m, math.sqrt(width * height / MOST_PX), max(size_m) / MOST_SIDE_PX)


def _window(
    area: FloorArea, extent: Extent, size: tuple[int, int], px_m: float
) -> tuple[slice, slice]:
    """Rows and columns of a floor area; row 0 is at y_max."""
    a, b, c, d = area.extent
    rows = slice(max(0, round((extent[3] - d) / px_m)), min(size[0], round((extent[3] - b) / px_m)))
    columns = slice(
        max(0, round((a - extent[0]) / px_m)), min(size[1], round((c - extent[0]) / px_m))
    )
    return rows, columns


def _contact_shade(
    extent: Extent, standing: Sequence[Shape], size: tuple[int, int]
) -> Float32[np.ndarray, "h w"]:
    """Brightness factor: darker within 10 to 20 cm of walls and of objects on the floor."""
    px_m = 0.02
    x0, y0, x1, y1 = extent
    small = (round((y1 - y0) / px_m) + 2, round((x1 - x0) / px_m) + 2)
    free = np.zeros(small, np.uint8)
    free[1:-1, 1:-1] = 255
    for shape in standing:
        if shape.bottom_m < 0.05:
            corners = (outline(shape) - np.array([x0, y1])) / np.array([px_m, -px_m]) + 0.5
            cv2.fillPoly(free, [np.rint(corners).astype(np.int32)], 0)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5) * px_m
    shade = (1.0 - 0.40 * np.exp(-distance / 0.10)).astype(np.float32)[1:-1, 1:-1]
    return np.asarray(cv2.resize(shade, (size[1], size[0]), interpolation=cv2.INTER_LINEAR))
