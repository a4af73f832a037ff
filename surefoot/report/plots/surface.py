"""Pictures of a mapped recording: its surface from two directions, and the layers of its floor.

A mesh is ray cast by Open3D and shaded; a cloud without one is drawn point by point.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from mapping.io.clouds import load_ply
from mapping.surface.meshes import load_mesh
from mapping.surface.traversability import SHOWN, load_layers

from ...results.run_folder import RunFolder
from .style import ESTIMATE, WIDTH_IN, Drawn, sheet

PIXELS = 520  # along the longer side of a view, as large as the page shows
PIXEL_M = 0.02  # smallest pixel, as the voxels: a finer image would have gaps between points
CAST_PIXEL_M = 0.005  # smallest pixel of a mesh
AMBIENT = 0.45  # brightness of a surface that is seen edge-on
OBLIQUE_DEG = 35.0  # depression angle of the oblique view
BACKGROUND = 255
LAYERS_MARGIN_IN = 1.2  # room for titles and scales of the layers
MARGIN_IN, MOST_IN = 0.7, 6.5  # room for title and labels; largest height of the figure


def surface(run: RunFolder) -> Drawn | None:
    """The mesh of the run, or its point cloud, from above and in an oblique view; None without either."""
    if not run.has("cloud.ply"):
        return None
    triangles = None
    if run.has("mesh.ply"):
        mesh = load_mesh(run.path("mesh.ply"))
        points, triangles = mesh.vertices.astype(np.float64), mesh.triangles
        colours = mesh.colours
    else:
        points, colours = load_ply(run.path("cloud.ply"))
    if len(points) == 0:
        return None
    low, high = np.percentile(points, (0.5, 99.5), axis=0)
    near = np.all((points > low - 0.3) & (points < high + 0.3), axis=1)
    by_height = colours is None
    if colours is None:
        colours = _height_colours(points[:, 2], float(low[2]), float(high[2]))
    path = run.read_trajectory("trajectory.txt")
    if triangles is None or not len(triangles):
        images = [splat(points[near] @ view.T, colours[near]) for view in _views()]
    else:
        triangles = triangles[near[triangles].all(axis=1)]
        images = [cast(points @ view.T, triangles, colours) for view in _views()]
    tallest = max(picture.shape[0] / picture.shape[1] for picture, _ in images)
    figure, axes = sheet(1, 2, min(MARGIN_IN + tallest * WIDTH_IN / 2, MOST_IN))
    titles = ("from above", "oblique view")
    for one, view, (picture, extent), words in zip(axes, _views(), images, titles, strict=True):
        one.imshow(picture, origin="lower", extent=extent, interpolation="nearest", aspect="equal")
        if path is not None:
            for mine in run.sessions(path.stamps).values():
                seen = path.positions[mine] @ view.T
                one.plot(seen[:, 0], seen[:, 1], color=ESTIMATE, lw=1.6)
        one.grid(False)
        one.set(title=words, xlabel="x, m")
    axes[0].set_ylabel("y, m")
    axes[1].set_yticks([])
    sentence = (
        "The mapped surface from above, in the axes of the map, and in an oblique view along +y"
    )
    sentence += ", with the trajectory in blue" if path is not None else ""
    sentence += (
        ". No colour image is registered to the depth: colour shows height, dark is low"
        if by_height
        else ""
    )
    return Drawn(figure, f"{sentence}.")


def layers(run: RunFolder) -> Drawn | None:
    """Height, slope and traversability of the floor; None without layers.npz."""
    if not run.has("layers.npz"):
        return None
    saved = load_layers(run.path("layers.npz"))
    height, slope, probability = (saved[name] for name in SHOWN)
    (left, bottom), cell_m = saved["origin"], float(saved["resolution"])
    if not np.isfinite(height).any():
        return None
    extent = (left, left + cell_m * height.shape[1], bottom, bottom + cell_m * height.shape[0])
    shape = height.shape[0] / height.shape[1]
    high_in = float(np.clip(LAYERS_MARGIN_IN + shape * WIDTH_IN / 3, 2.2, MOST_IN))
    figure, axes = sheet(1, 3, high_in, sharey=True)
    low, high = np.nanpercentile(height, (1, 99))
    for one, layer, title, limits in (
        (axes[0], height, "height, m", (low, high)),
        (axes[1], np.degrees(slope), "slope, deg", (0.0, 45.0)),
        (axes[2], probability, "traversable, probability", (0.0, 1.0)),
    ):
        image = one.imshow(
            layer, origin="lower", extent=extent, vmin=limits[0], vmax=max(limits[1], limits[0] + 1e-3),
            cmap="viridis", interpolation="nearest",
        )  # fmt: skip
        one.grid(False)
        one.set(title=title, xlabel="x, m")
        figure.colorbar(image, ax=one, orientation="horizontal", shrink=0.9)
    axes[0].set_ylabel("y, m")
    sentence = (
        "Layers of the floor in the axes of the map: height of the highest surface below the headroom, slope, and "
        "the probability that a foot can stand on it, which does not say whether it can be reached; white cells are unknown."
    )
    return Drawn(figure, sentence)


def _height_colours(z: Float[np.ndarray, "n"], low: float, high: float) -> UInt8[np.ndarray, "n 3"]:
    """Colours of points without colour, by height."""
    from matplotlib import colormaps

    level = np.clip((z - low) / max(high - low, 1e-6), 0.0, 1.0)
    return np.asarray(colormaps["cividis"](level, bytes=True)[:, :3], dtype=np.uint8)


def splat(
    points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
) -> tuple[UInt8[np.ndarray, "h w 3"], tuple[float, float, float, float]]:
    """Orthographic image of points: each pixel has the colour of the point nearest to the viewer.

    Args:
        points: Coordinates to the right, up, and towards the viewer, m.
        colours: RGB of each point.

    Returns:
        The image, lowest row first, and its extent (left, right, bottom, top), m.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    cell = max(float(np.max(high - low)) / PIXELS, PIXEL_M)
    columns, rows = (np.floor((high - low) / cell).astype(int) + 1).tolist()
    at = np.floor((points[:, :2] - low) / cell).astype(int)
    picture = np.full((rows, columns, 3), BACKGROUND, np.uint8)
    order = np.argsort(points[:, 2], kind="stable")  # the nearest is drawn last
    for side in ((0, 1), (1, 0), (0, 0)):  # a point also fills empty pixels above and beside it
        u, v = (at[order] + side).T
        inside = (u < columns) & (v < rows)
        picture[v[inside], u[inside]] = colours[order][inside]
    left, bottom = (float(value) for value in low)
    return picture, (left, left + cell * columns, bottom, bottom + cell * rows)


def cast(
    points: Float[np.ndarray, "n 3"],
    triangles: Int[np.ndarray, "m 3"],
    colours: UInt8[np.ndarray, "n 3"],
) -> tuple[UInt8[np.ndarray, "h w 3"], tuple[float, float, float, float]]:
    """Orthographic image of a mesh: the colour where a ray meets it, darker on slopes; back sides are see-through.

    Args:
        points: Coordinates to the right, up, and towards the viewer, m.
        triangles: Indices of points, counter-clockwise as seen from free space.
        colours: RGB of each point.

    Returns:
        As of `splat`.
    """
    import open3d

    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    towards = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    triangles, towards = triangles[towards > 0.0], towards[towards > 0.0]
    shown = points[triangles] if len(triangles) else points[:1]
    low, high = shown.reshape(-1, 3).min(axis=0), shown.reshape(-1, 3).max(axis=0)
    cell = max(float(np.max((high - low)[:2])) / PIXELS, CAST_PIXEL_M)
    columns, rows = (np.floor((high - low)[:2] / cell).astype(int) + 1).tolist()
    left, bottom, top = float(low[0]), float(low[1]), float(high[2]) + 1.0
    picture = np.full((rows, columns, 3), BACKGROUND, np.uint8)
    extent = (left, left + cell * columns, bottom, bottom + cell * rows)
    if not len(triangles):
        return picture, extent
    scene: Any = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(points.astype(np.float32), np.ascontiguousarray(triangles, dtype=np.uint32))
    rays = np.zeros((rows, columns, 6), np.float32)
    rays[..., 0] = left + cell * (np.arange(columns) + 0.5)
    rays[..., 1] = bottom + cell * (np.arange(rows)[:, None] + 0.5)
    rays[..., 2], rays[..., 5] = top, -1.0
    tensor: Any = open3d.core.Tensor
    met = scene.cast_rays(tensor(rays))
    hit = np.isfinite(met["t_hit"].numpy())
    face = met["primitive_ids"].numpy()[hit].astype(np.int64)
    u, v = met["primitive_uvs"].numpy()[hit].T
    shares = np.stack([1.0 - u - v, u, v], axis=1)
    light = AMBIENT + (1.0 - AMBIENT) * towards[face]
    tone = np.einsum("nk,nkc->nc", shares, colours[triangles[face]].astype(np.float64))
    picture[hit] = np.clip(np.rint(tone * light[:, None]), 0, 255).astype(np.uint8)
    return picture, extent


def _views() -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Rows are right, up and towards the viewer: from above, and oblique, looking along +y."""
    c, s = math.cos(math.radians(OBLIQUE_DEG)), math.sin(math.radians(OBLIQUE_DEG))
    return np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, s, c], [0.0, -c, s]])
