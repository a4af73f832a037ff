"""Noise and bend of a depth sensor, from flat surfaces that it has seen: a floor, or the walls of a static room.

- Noise: in cells of some degrees, the scatter of depth about a plane of its own, by depth.
- Bend: the relative error of depth is a quadric of the ray slopes, in units of the published size (`Distortion`). What
  remains of it after each surface took up a plane is estimated over all views. With poses, views of one surface must
  also agree with each other; this shows the constant and the linear terms, which no single view shows.

Views from nearly the same place count as one: their errors are the same.

Source: ours; linear least squares with the surfaces eliminated, scaled by the scatter (Birge 1932).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..depth.distortion import ORDERS, Distortion, quadric
from ..depth.points import Points
from ..primitives.errors import InputError
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from . import choose
from .choose import FloorConfig
from .prior import HAND_UP

CELL_SLOPE = 1.0 / 12.0  # ours: as in the floor fit, about 5 deg
CELL_POINTS = 30  # ours: least points of a cell
LEAST_CELLS = 25  # ours: of a surface: 25 deg by 25 deg
BAND = 3.0  # ours: in tau; points this far from a plane belong to it, bent as it is
SAME_VIEW_M = 0.05  # ours: views whose surfaces differ by less
SAME_VIEW_RAD = math.radians(3.0)  # ours: and by less than this show the same error
POSE_M = 0.015  # ours: hand-held poses of others are good to 1-2 cm
POSE_RAD = math.radians(0.5)  # ours: and to half a degree
WIDE = 2.0  # ours: prior of a coefficient, in published sizes
KNOWN = 0.5  # ours: a coefficient is known if its standard deviation is below, in published sizes
MODEL = 0.1  # ours: how far the quadric itself is right, in published sizes
PRIOR_VIEWS = 1.0  # ours: the published size counts as much as one coefficient
BINS_M = np.arange(0.2, 8.01, 0.2)
RANGE_RATIO = 1.5  # ours: of the depths, below which the growth of noise is not told
MAD = 1.4826  # of a Gaussian
TRIMMED = 0.02  # ours: share of the largest residuals of a cell that are left out
TRIMMED_RMS = 0.9346  # of the others of a unit Gaussian
SHAPE = 0.03  # ours: relative error of a standard deviation by residuals in steps, which are no Gaussian
LOOKS = (
    HAND_UP,
    np.array([0.0, 0.0, -1.0]),
    np.array([0.8, 0.0, -0.6]),
    np.array([-0.8, 0.0, -0.6]),
)
"""Ours: normals about which surfaces are searched: floor, wall ahead, walls to the left and right."""


class NoiseBin(NamedTuple):
    """Noise at one depth.

    Args:
        z: Mean depth, m.
        sigma, error: Standard deviation of depth and its standard error, m.
        claimed: The standard deviation by the noise model so far, m.
        cells: Number of cells.
    """

    z: float
    sigma: float
    error: float
    claimed: float
    cells: int


@dataclass(frozen=True)
class DepthCalibration:
    """What a recording tells of a sensor.

    Args:
        noise: By depth.
        bend: (6,) coefficients of the quadric (`distortion.ORDERS`) in published sizes.
        covariance: (6, 6) of the bend.
        views: Number of different views of surfaces.
        posed: Whether poses related the views.
    """

    noise: tuple[NoiseBin, ...]
    bend: Float[np.ndarray, "6"]
    covariance: Float[np.ndarray, "6 6"]
    views: int
    posed: bool

    @property
    def sigma(self) -> Float[np.ndarray, "6"]:
        """Standard deviation of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def known(self) -> Bool[np.ndarray, "6"]:
        """Which coefficients the recording tells; without poses only those of second order."""
        shown = np.array([i + j == 2 or self.posed for i, j in ORDERS])
        return np.asarray(shown & (self.sigma < KNOWN))

    @property
    def size(self) -> float:
        """Size of the distortion in published sizes, by the coefficients that are known."""
        known = self.known
        seen = float(np.sum(self.bend[known] ** 2 + self.sigma[known] ** 2))
        return math.sqrt((PRIOR_VIEWS + seen) / (PRIOR_VIEWS + int(known.sum())))

    def growth(self, shape: Float[np.ndarray, "n"]) -> tuple[float, float, float]:
        """Noise as constant + growth * shape, fitted to the bins.

        Args:
            shape: Growth of the noise model at the depth of each bin.

        Returns:
            The constant, the growth, and the relative standard error of the two; not negative. The growth is NaN if
            the depths differ too little.
        """
        sigma = np.array([one.sigma for one in self.noise])
        error = np.array([one.error for one in self.noise])
        z = [one.z for one in self.noise]
        spread = float(np.sqrt(1.0 / np.sum((sigma / error) ** 2)))
        if len(z) < 2 or max(z) < RANGE_RATIO * min(z):
            return float(np.average(sigma, weights=error**-2)), math.nan, spread
        from scipy.optimize import nnls  # loaded only here

        A = np.column_stack([np.ones_like(shape), shape]) / error[:, None]
        (constant, growth), _ = nnls(A, sigma / error)
        return float(constant), float(growth), spread


@dataclass
class Calibrator:
    """Collects the surfaces of a recording.

    Args:
        distortion: Published size of the sensor's bend.
        rng: Random numbers of the plane searches.
        config: Settings of the plane searches.
    """

    distortion: Distortion
    rng: np.random.Generator
    config: FloorConfig = field(default_factory=FloorConfig)

    def __post_init__(self) -> None:
        self._scatter: list[tuple[float, float, float]] = []  # depth, noise, claimed noise
        self._surfaces: list[_Surface] = []

    def add(self, points: Points, T_world_camera: Pose3 | None) -> int:
        """Take the flat surfaces of one view; their number."""
        edge = float(np.max(np.abs(points.xyz[:, 0] / points.xyz[:, 2]))) if len(points) else 1.0
        found, rest = 0, points
        for normal in LOOKS:
            if len(rest) < LEAST_CELLS * CELL_POINTS:
                break
            wide = np.diag([math.radians(20.0) ** 2, math.radians(20.0) ** 2, 1.5**2])
            floor = choose.find(rest, Plane(normal, 1.5, wide), self.rng, self.config, "depth")
            if floor is None:
                continue
            plane = floor.among_points
            z = rest.xyz[:, 2]
            sample = self.config.sample
            tau = sample.base_m + sample.sigmas * rest.sigma * plane.offset_m / z
            on = np.abs(plane.distance(rest.xyz)) < BAND * tau
            surface = self._surface(rest.xyz[on], rest.sigma[on], plane, edge, T_world_camera)
            rest = Points(rest.xyz[~on], rest.sigma[~on], rest.pixels[~on])
            if surface is not None:
                found += 1
                self._surfaces.append(surface)
        return found

    def _surface(
        self,
        xyz: Float[np.ndarray, "n 3"],
        claimed: Float[np.ndarray, "n"],
        plane: Plane,
        edge: float,
        pose: Pose3 | None,
    ) -> _Surface | None:
        """Cells of one surface: mean ray, inverse depth and its standard error; None if it is too small."""
        q = 1.0 / xyz[:, 2]
        rays = xyz * q[:, None]
        column, row = np.floor(rays[:, :2] / CELL_SLOPE).astype(int).T
        order = np.lexsort((column, row))
        keys = row[order] * 10_000 + column[order]
        starts = np.flatnonzero(np.r_[True, np.diff(keys) != 0])
        rows = []
        for part in np.split(order, starts[1:]):
            if len(part) < CELL_POINTS:
                continue
            r, inverse = rays[part], q[part]
            slope, *_ = np.linalg.lstsq(r, inverse, rcond=None)
            sigma = _trimmed_rms(inverse - r @ slope)
            sigma *= math.sqrt(len(part) / (len(part) - 3))
            middle = float(np.mean(inverse))
            rows.append((*r.mean(axis=0)[:2], middle, sigma / math.sqrt(len(part))))
            self._scatter.append((1.0 / middle, sigma / middle**2, float(np.mean(claimed[part]))))
        if len(rows) < LEAST_CELLS:
            return None
        u, v, inverse, error = np.array(rows).T
        return _Surface(u, v, inverse, np.maximum(error, 1e-5), plane, edge, pose)

    def solve(self) -> DepthCalibration:
        """Noise and bend by all surfaces so far.

        Raises:
            InputError: No surface was flat and large enough.
        """
        if not self._surfaces:
            raise InputError(
                "no flat surface of 25 by 25 degrees was seen; record a bare floor or a wall that fills a "
                "third of the picture, from several distances between 0.5 and 3 m"
            )
        posed = [one for one in self._surfaces if one.pose is not None]
        groups = _same_planes(posed) if len(posed) == len(self._surfaces) else []
        pooled = [group for group in groups if len(group) > 1]
        alone = [one for one in self._surfaces if not any(one is k for g in pooled for k in g)]
        views = _different(self._surfaces)
        share = views / len(self._surfaces)
        parts = [_information([one], self.distortion) for one in alone]
        parts += [_information(group, self.distortion) for group in pooled]
        J, b, scatter, cells = (sum(part[k] for part in parts) for k in range(4))
        prior = np.eye(6) / WIDE**2
        first = np.linalg.solve(J + prior, b)
        left = scatter - first @ b
        excess = max(1.0, float(left) / max(cells - 3 * len(self._surfaces) - 6, 1))
        J, b = J * share / excess, b * share / excess
        covariance = np.linalg.inv(J + prior) + MODEL**2 * np.eye(6)
        return DepthCalibration(
            self._noise(), np.linalg.solve(J + prior, b), covariance, views, bool(pooled)
        )

    def _noise(self) -> tuple[NoiseBin, ...]:
        """The median scatter of the cells in every bin of depth."""
        z, sigma, claimed = np.array(self._scatter).T
        found = []
        for number in range(len(BINS_M) - 1):
            inside = (z >= BINS_M[number]) & (z < BINS_M[number + 1])
            count = int(inside.sum())
            if count < LEAST_CELLS:
                continue
            middle = float(np.median(sigma[inside]))
            spread = MAD * float(np.median(np.abs(sigma[inside] - middle)))
            own = 1.25 * spread / math.sqrt(min(count, 400))  # cells of a static view repeat
            error = math.hypot(own, SHAPE * middle)
            found.append(
                NoiseBin(
                    float(np.mean(z[inside])),
                    middle,
                    error,
                    float(np.median(claimed[inside])),
                    count,
                )
            )
        return tuple(found)


def _trimmed_rms(rest: Float[np.ndarray, "n"]) -> float:
    """Standard deviation without the largest residuals; unlike the median's, right where most depths are one step."""
    kept = np.sort(np.abs(rest))[: round((1.0 - TRIMMED) * len(rest))]
    return float(np.sqrt(np.mean(kept**2))) / TRIMMED_RMS


class _Surface(NamedTuple):
    """Cells of one surface in one view: slopes, inverse depth, its standard error; the plane; the image's edge."""

    u: Float[np.ndarray, "m"]
    v: Float[np.ndarray, "m"]
    q: Float[np.ndarray, "m"]
    error: Float[np.ndarray, "m"]
    plane: Plane
    edge: float
    pose: Pose3 | None


def _different(surfaces: list[_Surface]) -> int:
    """Number of surfaces that differ from the others in the camera frame."""
    kept: list[Plane] = []
    for one in surfaces:
        if not any(_alike(one.plane, other) for other in kept):
            kept.append(one.plane)
    return len(kept)


def _alike(one: Plane, other: Plane) -> bool:
    return one.angle_to(other) < SAME_VIEW_RAD and abs(one.offset_m - other.offset_m) < SAME_VIEW_M


def _same_planes(surfaces: list[_Surface]) -> list[list[_Surface]]:
    """Surfaces that are one plane of the world: within 8 deg and 10 cm at the camera."""
    groups: list[list[_Surface]] = []
    for one in surfaces:
        assert one.pose is not None
        for group in groups:
            first = group[0]
            assert first.pose is not None
            seen = first.plane.moved(one.pose.inverse() @ first.pose)
            apart = abs(seen.offset_m - one.plane.offset_m)
            if seen.angle_to(one.plane) < math.radians(8.0) and apart < 0.10:
                group.append(one)
                break
        else:
            groups.append([one])
    return groups


def _information(
    group: list[_Surface], distortion: Distortion
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"], float, int]:
    """Information matrix and vector of the bend by the views of one surface, squared scatter, and cells.

    Inverse depth is r.a - q f, a the slope of the plane and f the bend. A single view leaves a free; in views with
    poses it is that of one plane of the world, up to the error of the pose.
    """
    first = group[0]
    J, b = np.zeros((9, 9)), np.zeros(9)  # world plane, bend
    scatter, cells = 0.0, 0
    for one in group:
        rays = np.column_stack([one.u, one.v, np.ones_like(one.u)])
        q = rays @ _slope(one.plane)  # not the measured one, whose noise would be taken for a scale
        size = distortion.size(1.0 / q, one.error / q**2)
        bend = -quadric(one.u, one.v, one.edge) * (size * q)[:, None]
        bend[:, 0] = -np.mean(size) * q  # a scale; how it grows with depth is not told
        w = one.error**-2
        normal = rays.T @ (rays * w[:, None])
        if len(group) == 1:
            start, turn, loose = _slope(one.plane), np.zeros((3, 3)), np.zeros((3, 3))
        else:
            assert one.pose is not None
            assert first.pose is not None
            T = one.pose.inverse() @ first.pose
            start = _slope(first.plane.moved(T))
            turn = _derivative(first.plane, T)
            own = _derivative(first.plane.moved(T), Pose3())
            loose = np.linalg.inv(own @ np.diag([POSE_RAD**2, POSE_RAD**2, POSE_M**2]) @ own.T)
        wanted = np.column_stack([rays @ turn, bend])
        rest = one.q - rays @ start
        weighted = wanted * w[:, None]
        gain = np.linalg.inv(normal + loose)
        side, pull = rays.T @ weighted, rays.T @ (w * rest)
        J += wanted.T @ weighted - side.T @ gain @ side
        b += weighted.T @ rest - side.T @ gain @ pull
        scatter += float(w @ rest**2 - pull @ gain @ pull)
        cells += len(rest)
    if len(group) == 1:
        return J[3:, 3:], b[3:], scatter, cells
    gain = np.linalg.inv(J[:3, :3] + 1e-9 * np.eye(3))
    across = J[3:, :3] @ gain
    scatter -= float(b[:3] @ gain @ b[:3])
    return J[3:, 3:] - across @ J[:3, 3:], b[3:] - across @ b[:3], scatter, cells


def _slope(plane: Plane) -> Float[np.ndarray, "3"]:
    """a of 1 / z = a.r."""
    return np.asarray(-plane.normal / plane.offset_m)


def _derivative(plane: Plane, T: Pose3) -> Float[np.ndarray, "3 3"]:
    """Derivative of the slope in the moved frame by (tilt, tilt, offset) of the plane."""
    step, columns = 1e-5, []
    for axis in range(3):
        tilt = np.zeros(2)
        offset = plane.offset_m
        if axis < 2:
            tilt[axis] = step
        else:
            offset += step
        normal = plane.normal + tilt @ plane.tangents
        changed = Plane(normal / np.linalg.norm(normal), offset)
        columns.append((_slope(changed.moved(T)) - _slope(plane.moved(T))) / step)
    return np.column_stack(columns)
