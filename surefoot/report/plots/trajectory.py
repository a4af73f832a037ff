"""Pictures of a mapped recording: its surface from two sides with the way in it, and what alignment leaves."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, UInt8

from mapping.io.clouds import load_ply

from ...evaluation.metrics.gauge_alignment import FLOOR, SPACE
from ...results.run_folder import ERRORS, RunFolder
from .style import BELIEF, TRUTH, Drawn, key, sheet

PIXELS = 520  # along the longer side of a view: the page shows little more
GRAIN_M = 0.02  # as the voxels: finer pixels would show gaps between points
OBLIQUE_DEG = 35.0  # looked down at so steeply, from behind the start
NO_COLOUR = (120, 128, 138)
BACK = 255


def surface(run: RunFolder) -> Drawn | None:
    """The run's cloud from above and from aslant; None without one."""
    if not run.has("cloud.ply"):
        return None
    points, colours = load_ply(run.path("cloud.ply"))
    if colours is None:
        colours = np.tile(np.array(NO_COLOUR, np.uint8), (len(points), 1))
    way = run.read_trajectory("trajectory.txt") if run.has("trajectory.txt") else None
    figure, axes = sheet(1, 2, 3.6)
    low, high = np.percentile(points, (0.5, 99.5), axis=0)
    near = np.all((points > low - 0.3) & (points < high + 0.3), axis=1)
    for one, view, words in zip(axes, _views(), ("from above", "from aslant"), strict=True):
        picture, extent = splat(points[near] @ view.T, colours[near])
        one.imshow(picture, origin="lower", extent=extent, interpolation="nearest", aspect="equal")
        if way is not None:
            seen = way.positions @ view.T
            one.plot(seen[:, 0], seen[:, 1], color=BELIEF, lw=1.6)
        one.grid(False)
        one.set(title=words, xlabel="m")
    if way is not None:
        key(axes[0])
    sentence = (
        "The surface as it was mapped, from above and from aslant, with the way the camera took."
    )
    return Drawn(figure, sentence)


def splat(
    points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
) -> tuple[UInt8[np.ndarray, "h w 3"], tuple[float, float, float, float]]:
    """What one sees of points from far off: each pixel has the colour of the one nearest to the eye.

    Args:
        points: Right, up, and towards the eye, m.
        colours: Red first.

    Returns:
        The picture, its lowest row first, and (left, right, bottom, top) of it, m.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    cell = max(float(np.max(high - low)) / PIXELS, GRAIN_M)
    columns, rows = (np.floor((high - low) / cell).astype(int) + 1).tolist()
    at = np.floor((points[:, :2] - low) / cell).astype(int)
    picture = np.full((rows, columns, 3), BACK, np.uint8)
    order = np.argsort(points[:, 2], kind="stable")  # the nearest is painted last
    for side in (
        (0, 1),
        (1, 0),
        (0, 0),
    ):  # a point covers its neighbours, if none of them has its own
        u, v = (at[order] + side).T
        inside = (u < columns) & (v < rows)
        picture[v[inside], u[inside]] = colours[order][inside]
    left, bottom = (float(value) for value in low)
    return picture, (left, left + cell * columns, bottom, bottom + cell * rows)


def _views() -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Rows are right, up and towards the eye: from above, and from aslant behind the start."""
    above = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x, ahead, is up
    c, s = math.cos(math.radians(OBLIQUE_DEG)), math.sin(math.radians(OBLIQUE_DEG))
    return above, np.array([[0.0, -1.0, 0.0], [s, 0.0, c], [-c, 0.0, s]])


def aligned_errors(run: RunFolder) -> Drawn | None:
    """What is left of the errors after alignment, with claimed deviations; None where nobody measured it."""
    table = run.read_csv(ERRORS)
    if table is None:
        return None
    names = SPACE if "error_z" in table.columns else FLOOR
    lengths = 3 if names is SPACE else 2
    stamps = table.numbers("stamp_s")
    figure, axes = sheet(len(names), 1, 1.15 * len(names) + 0.7, sharex=True)
    for i, (one, name) in enumerate(zip(axes, names, strict=True)):
        scale, unit = (100.0, "cm") if i < lengths else (180.0 / math.pi, "deg")
        sigma = 2.0 * scale * table.numbers(f"sigma_{name}")
        seconds = stamps - stamps[0]
        one.fill_between(
            seconds, -sigma, sigma, color=BELIEF, alpha=0.14, lw=0, label="two deviations"
        )
        one.axhline(0.0, color=TRUTH, linewidth=0.7)
        one.plot(seconds, scale * table.numbers(f"error_{name}"), color=BELIEF, label="error")
        one.set_ylabel(f"{name.replace('_', ' ')}, {unit}")
    key(axes[0])
    axes[-1].set_xlabel("time, s")
    sentence = (
        "Estimated minus true pose after the whole way is laid over the truth; the band is two deviations of "
        "what the run claims, after the same motion, and should hold the line about 95 % of the time."
    )
    return Drawn(figure, sentence)
