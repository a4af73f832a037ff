"""Plane regions of one depth image: floors, treads, risers, ramps, kerbs, the ground of a hole.

Cells of some pixels that a plane explains grow into regions, as long as one plane explains all of them; the test has the
noise of each pixel and an error that the pixels of a cell share. Then every pixel goes to the region nearby that explains
it best, and each region is fitted as the floor is. The planes of the cells lean, where cells lie on a fold; so the pixels
are shared out once more, by the planes as fitted. A region whose residuals its own noise does not explain (stairs far away
that look like a ramp) is not claimed.

Source: growth of planar cells after Poppinga et al. 2008 and Proenca and Gao 2018 (CAPE); sums that add up after Feng,
Taguchi and Kamat 2014; tests by the noise of each pixel, and the fit, ours (`floor.refine`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, Int16

from ..depth._stereo_trust_kernels import SIDE
from ..depth.flying import GRAZE_DEG
from ..depth.points import Points
from ..depth.reach import ReachConfig
from ..floor.choose import FloorConfig, explains, thinned
from ..floor.refine import LEAST_FACTOR, MANY_CELLS, NONE, Fit, Scatter, refine
from ..primitives.frame import Depth
from ..primitives.plane import Plane
from . import _region_kernels as kernels
from .distorted import by_distortion
from .edges import straight_edges
from .region import Region

CELLS_ACROSS, CELLS_DOWN = 80, 120  # ours: level ground is foreshortened, so cells are wide
LEAST_WIDE_PX, LEAST_TALL_PX, LEAST_MATCHED_PX = 4, 2, 3
"""Ours: time of flight measures every pixel by itself, and a tread of few rows holds no whole cell of 3 rows; cameras that
match a pattern or a picture share noise between rows."""
ROWS_THAT_TELL = 3  # fewer fit a plane across any jump of depth between them
FULL = 0.7  # ours: share of a cell's pixels with depth
FLAT = 2.5  # ours: most squared residual of a cell per degree of freedom
ROUGH_M = 0.002  # ours: of a surface within a cell
COMMON_M = 0.003  # ours: error that the pixels of a cell share; roughness of floors in `refine`
COMMON_SIGMAS = 0.5
"""Ours: the same, in standard deviations of a pixel, for block matching, which smooths its noise."""
GATE = 7.8  # chi-square, 3 degrees of freedom, 0.95; with a wider one cells on a fold join
LEAST_CELLS = 4  # ours
ALIKE = 0.15  # ours: squared residual per pixel by which regions that are joined may fit worse
REACH_CELLS = 2  # ours
MOST_REGIONS = 64  # ours
PIXEL_SIGMAS = 3.0  # ours
MARGIN_PX = 2
"""Ours: border of a region that its fit leaves out; half a block more after block matching."""
THIN = 0.2  # ours: least share of a region's pixels away from its border for that
LARGE, STRIDE, MANY = 150_000, 3, 600
"""Ours: in images of `LARGE` pixels, every `STRIDE`-th point of regions with `MANY` points is fitted."""
SUB_PIXEL_SIGMAS, RIM_SIGMAS = 0.1, 0.5
"""Ours: after block matching, shared by pixels of like disparity; by those of a region whose blocks all see beyond it."""
RESOLVED_PX, RESOLVED_BLOCKS = 5.0, 2.0
"""Ours: smallest detail that a region resolves: in pixels, and in blocks of block matching, which smooths small steps."""
LEAST_PIXELS, LEAST_SHARE = 100, 0.002  # ours: of the image; smaller regions are not claimed


def find(
    depth: Depth,
    reach: ReachConfig | None = None,
    config: FloorConfig | None = None,
    sensor: str | None = None,
) -> list[Region]:
    """Plane regions of a depth image, the largest first.

    Args:
        depth: With the standard deviation of every pixel.
        reach: Depths used.
        config: Bands of the fit, and the distortion of each kind of sensor.
        sensor: "tof", "stereo" or "depth", which sets the distortion and the smallest cells; None: as an RGB-D camera.

    Returns:
        Regions in the camera frame, each with covariance and edges; empty if none is seen.

    Raises:
        InputError: The image does not fit its camera.
    """
    reach, config = reach or ReachConfig(), config or FloorConfig()
    depth.camera.check_image("depth", depth.z)
    depth.camera.check_image("sigma", depth.sigma)
    q, weight = np.empty((2, *depth.z.shape), np.float32)
    grown = _grown(depth, reach, sensor, q, weight)
    distortion = config.distortion.of(sensor)
    edge = float(np.max(np.abs(depth.camera.slopes[0])))
    stride = 1 if depth.z.size < LARGE else STRIDE
    fitted: dict[int, tuple[Points, Fit]] = {}
    for one in _pixels(*_labels(grown, q, weight, depth), q, weight, depth):
        middle = (
            thinned(one.inner, len(one.inner) // stride) if len(one.inner) > MANY else one.inner
        )
        start = _start(grown.slopes[one.label])
        fit = refine(middle, start, config.sample, config.refine, NONE)
        if fit is not None and explains(middle, fit, config):
            fitted[one.label] = middle, fit
            grown.slopes[one.label] = -fit.plane.normal / fit.plane.offset_m
    labels, counts = _labels(grown, q, weight, depth)  # again, by the planes as fitted
    fits: list[tuple[_Pixels, Points, Fit]] = []
    kept = np.full(len(counts) + 1, -1, np.int16)  # by label; the last one is that of no region
    for one in _pixels(labels, counts, q, weight, depth):
        if one.label in fitted:
            kept[one.label] = len(fits)
            fits.append((one, *fitted[one.label]))
    correlation = _correlation([fit.scatter for _, _, fit in fits])
    found = []
    for one, middle, fit in fits:
        assert fit.scatter is not None, "refine gives it"
        common = 0.0
        if depth.baseline_m > 0.0:
            common = SUB_PIXEL_SIGMAS if len(one.inner) < len(one.pixels) else RIM_SIGMAS
        own, shared = by_distortion(middle, fit.plane, distortion, edge, common)
        own = own + correlation * fit.scatter.independent
        found.append(_region(one, fit.plane, own, shared, depth))
    return straight_edges(found, kept[labels], q, weight, depth, sensor)


def _correlation(parts: list[Scatter | None]) -> float:
    """By how much the covariance of a plane exceeds that by independent noise, by all planes of the view."""
    cells = np.array([one.cells for one in parts if one is not None])
    factors = np.array([one.correlation for one in parts if one is not None])
    if not cells.sum():
        return 1.0
    least = 1.0 if cells.sum() < MANY_CELLS else LEAST_FACTOR
    return max(float(cells @ factors / cells.sum()), least)


class _Grown(NamedTuple):
    """Regions of cells.

    Args:
        cells: (rows, columns), region of every cell, negative if none.
        size: Rows and columns of pixels of a cell.
        slopes: (m, 3), slope a of every region.
    """

    cells: Int[np.ndarray, "r c"]
    size: tuple[int, int]
    slopes: Float[np.ndarray, "m 3"]


def _grown(
    depth: Depth,
    reach: ReachConfig,
    sensor: str | None,
    q: Float32[np.ndarray, "h w"],
    weight: Float32[np.ndarray, "h w"],
) -> _Grown:
    """Regions of cells; fills inverse depth and its weight."""
    height, width = depth.z.shape
    least = LEAST_TALL_PX if sensor == "tof" else LEAST_MATCHED_PX
    tall = max(least, round(height / CELLS_DOWN))
    wide = max(LEAST_WIDE_PX, round(width / CELLS_ACROSS))
    x, y = depth.camera.slopes
    sums = np.zeros((height // tall, width // wide, kernels.SUMS))
    limits = (max(reach.nearest_m, 1e-6), reach.farthest_m, ROUGH_M)
    kernels.sum_cells(depth.z, depth.sigma, x, y, limits, (tall, wide), q, weight, sums)
    rest = np.empty(sums.shape[:2])
    graze = math.sin(math.radians(GRAZE_DEG)) if tall < ROWS_THAT_TELL else 0.0
    kernels.flatten(sums, FULL * tall * wide, FLAT, graze, COMMON_M, COMMON_SIGMAS, rest)
    flat = np.flatnonzero(np.isfinite(rest))
    order = flat[np.argsort(rest.ravel()[flat] / sums[..., 10].ravel()[flat], kind="stable")]
    cells = np.full(rest.shape, -1, np.int64)
    regions, left = np.zeros((MOST_REGIONS, kernels.SUMS)), np.zeros(MOST_REGIONS)
    count = kernels.grow(sums, rest, order, GATE, LEAST_CELLS, cells, regions, left)
    kernels.merge(cells, regions[:count], left[:count], ALIKE, REACH_CELLS)
    slopes = np.zeros((max(count, 1), 3))
    A, g = np.empty((3, 3)), np.empty(3)
    for k in range(count):
        slopes[k] = kernels.fit(regions[k], A, g)[:3]
    return _Grown(cells, (tall, wide), slopes)


def _labels(
    grown: _Grown,
    q: Float32[np.ndarray, "h w"],
    weight: Float32[np.ndarray, "h w"],
    depth: Depth,
) -> tuple[Int16[np.ndarray, "h w"], Int[np.ndarray, "m"]]:
    """Region of every pixel, -1 if none, and the number of pixels of each."""
    x, y = depth.camera.slopes
    labels = np.empty(depth.z.shape, np.int16)
    counts = np.zeros(len(grown.slopes), np.int64)
    kernels.label_pixels(
        q, weight, x, y, grown.cells, grown.size, grown.slopes, PIXEL_SIGMAS, labels, counts
    )
    return labels, counts


class _Pixels(NamedTuple):
    """Pixels of a region.

    Args:
        label: Of the region.
        inner: Points away from its border, or all if it is thin; camera frame.
        pixels: Flat indices.
        total: Sums of all points, and of z^3.
        ends: Column and row of the first and the last pixel of every row.
    """

    label: int
    inner: Points
    pixels: Int[np.ndarray, "n"]
    total: Float[np.ndarray, "4"]
    ends: Int[np.ndarray, "m 2"]


def _pixels(
    labels: Int16[np.ndarray, "h w"],
    counts: Int[np.ndarray, "m"],
    q: Float32[np.ndarray, "h w"],
    weight: Float32[np.ndarray, "h w"],
    depth: Depth,
) -> list[_Pixels]:
    """Pixels of every region, the largest first."""
    x, y = depth.camera.slopes
    total = int(counts.sum())
    xyz, sigma = np.empty((total, 3)), np.empty(total)
    pixels, inside = np.empty(total, np.int64), np.empty(total, np.bool_)
    totals = np.zeros((len(counts), 4))
    spans = np.full((len(counts), labels.shape[0], 2), -1, np.int32)
    starts = np.cumsum(counts) - counts
    margin = SIDE // 2 + MARGIN_PX if depth.baseline_m > 0.0 else MARGIN_PX
    around = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    inner = (cv2.erode(labels, around) == labels) & (cv2.dilate(labels, around) == labels)
    kernels.gather(
        labels, q, weight, x, y, starts.copy(), inner, ROUGH_M, xyz, sigma, pixels, inside,
        totals, spans,
    )  # fmt: skip
    found = []
    least = max(LEAST_PIXELS, LEAST_SHARE * labels.size)
    for k in np.argsort(-counts, kind="stable"):
        if counts[k] >= least:
            part = slice(int(starts[k]), int(starts[k] + counts[k]))
            points = Points(xyz[part], sigma[part], pixels[part])
            thick = np.count_nonzero(inside[part]) > max(LEAST_PIXELS, THIN * counts[k])
            rows = np.flatnonzero(spans[k, :, 0] >= 0)
            ends = np.column_stack([spans[k, rows].ravel(), np.repeat(rows, 2)])
            inner_points = points.of(inside[part]) if thick else points
            found.append(_Pixels(int(k), inner_points, pixels[part], totals[k], ends))
    return found


def _start(slope: Float[np.ndarray, "3"]) -> Plane:
    """The plane of a slope a."""
    rho = 1.0 / float(np.linalg.norm(slope))
    return Plane(-slope * rho, rho)


def _region(
    one: _Pixels,
    fitted: Plane,
    own: Float[np.ndarray, "3 3"],
    shared: Float[np.ndarray, "3 k"],
    depth: Depth,
) -> Region:
    """A region without edges."""
    camera = depth.camera
    plane = Plane(fitted.normal, fitted.offset_m, own + shared @ shared.T)
    middle = one.total[:3] / len(one.pixels)
    middle = middle - plane.distance(middle) * plane.normal
    area = float(one.total[3]) / (plane.offset_m * camera.fx * camera.fy)
    hull = cv2.convexHull(one.ends.astype(np.int32))[:, 0].astype(np.float64)
    outline = camera.back_project(hull, np.ones(len(hull)))
    outline = outline * (-plane.offset_m / (outline @ plane.normal))[:, None]
    noise = float(np.median(one.inner.sigma / one.inner.xyz[:, 2])) * plane.offset_m
    pixels = RESOLVED_BLOCKS * SIDE if depth.baseline_m > 0.0 else RESOLVED_PX
    detail = pixels * middle[2] / max(camera.fx, camera.fy)
    return Region(
        plane, own, shared, one.pixels, middle, outline, area, noise_m=noise, detail_m=detail
    )
