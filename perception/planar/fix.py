"""A pose out of nothing: odometry and sightings of a stretch of a log, without start, noise or biases.

Every sighting constrains the pose at the end of the stretch, through the odometry in between. Many starts, on a
grid of places and headings, descend to the minima of a robust cost. The best minima are refined together with the
systematic errors: scales and drift of the odometry, scale and offset of the distances. The size of the residuals
is the noise. A fix is given only if it is sharp, if its residuals are small, and if every other pose explains the
sightings much worse: a robot that stands still has no heading by ranges, and one that drives along a row of
beacons may be on either side.

Source: ours; robust regression with unknown scale: Huber, "Robust Statistics" (1981), chapter 7.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..filtering._square_root_kernels import wrapped
from ..filtering.models import wrap_angles
from ..primitives.gaussian import Gaussian
from ._planar_kernels import DRIFT, GAIN, ODOMETRY_SCALE, OFFSET, TURN_SCALE
from .planar import Journey, PlanarPrior

SIZE = OFFSET + 1  # entries of the state that a fix estimates
MOST_ROWS = 90  # ours: sightings used, evenly over the stretch
LEAST_ROWS = 12  # ours: half as many again as unknowns
HEADINGS, PLACES_PER_AXIS = 16, 5  # ours: grid of starts
DESCENT, REFINEMENT = 25, 12  # ours: iterations
MOST_MINIMA = 6  # ours: poses that are refined
SHARED = 4.0
"""Ours: number of successive sightings with a common error; they count as one in covariance and comparison."""
SURE = 10.0  # ours: log likelihood by which a fix must surpass every other pose
NEAR_M, NEAR_RAD = 0.05, 0.02  # ours: residuals of a perfect log; keeps weights finite
SHARP = 0.05  # ours: standard deviation of the position over the size of the map
SHARP_RAD = 0.2  # ours: standard deviation of the heading
LARGEST = 0.15  # ours: residuals over the distances, and residuals of the bearings in rad
INLIERS = 0.6  # ours: least share of sightings within four standard deviations
LEAST = 1e-6  # ours: information on what no sighting tells, 1/m^2 and 1/rad^2
NORMAL = 1.4826  # standard deviation of a normal variable over the median of its absolute value


@dataclass(frozen=True)
class Fix:
    """A pose and its systematic errors at the end of a stretch.

    Args:
        state: Over the first `SIZE` entries of the planar state; scale and offset of the distances around 1 and 0.
        sigma_m, sigma_rad: Size of the residuals of distance and bearing; the latter NaN without bearings.
    """

    state: Gaussian
    sigma_m: float
    sigma_rad: float


@dataclass(frozen=True)
class _Stretch:
    """Odometry and sightings of the stretch; `instants` index `steps` for each sighting."""

    steps: Float[np.ndarray, "n 3"]
    instants: Int[np.ndarray, "r"]
    spots: Float[np.ndarray, "r 2"]
    seen: Float[np.ndarray, "r 2"]

    def back(self, scales: Float[np.ndarray, "3"]) -> Float[np.ndarray, "r 3"]:
        """Pose at each sighting in axes of the last pose, with odometry scale, turn scale and drift."""
        dt, path, turn = self.steps.T
        turned = scales[1] * turn + scales[2] * dt
        heading = np.cumsum(turned)
        ahead, middle = scales[0] * path, heading - 0.5 * turned
        x, y = np.cumsum(ahead * np.cos(middle)), np.cumsum(ahead * np.sin(middle))
        c, s = math.cos(heading[-1]), math.sin(heading[-1])
        x, y, at = x - x[-1], y - y[-1], self.instants
        return np.stack([c * x + s * y, c * y - s * x, heading - heading[-1]], axis=-1)[at]


def find_fix(journey: Journey, first: int, last: int, prior: PlanarPrior) -> Fix | None:
    """The pose at an instant, from the sightings of a stretch.

    Args:
        journey: The log; its start is not used.
        first, last: First instant of the stretch, and the one after its last.
        prior: Sizes of the systematic errors.

    Returns:
        None if the sightings leave the pose open.
    """
    stretch = _stretch(journey, first, last)
    if len(stretch.seen) < LEAST_ROWS:
        return None
    size = float(np.linalg.norm(np.ptp(journey.places, axis=0))) + float(
        np.median(np.abs(stretch.seen[:, 0]))
    )
    poses = _minima(stretch, journey.places)
    found = sorted((_refined(stretch, pose, prior) for pose in poses), key=lambda one: -one[0])
    if not found:
        return None
    likelihood, fix, inliers = found[0]
    sigma = np.sqrt(np.diag(fix.state.covariance)[:3])
    for other_likelihood, other, _ in found[1:]:
        apart = (other.state.mean - fix.state.mean)[:3]
        apart[2] = wrapped(apart[2])
        same = np.all(np.abs(apart) < np.maximum(3.0 * sigma, [NEAR_M, NEAR_M, NEAR_RAD]))
        if not same and likelihood - other_likelihood < SURE:
            return None
    sharp = max(sigma[:2]) < SHARP * size and sigma[2] < SHARP_RAD
    far = float(np.median(np.abs(stretch.seen[:, 0])))
    small = fix.sigma_m < LARGEST * far and not fix.sigma_rad > LARGEST
    return fix if sharp and small and inliers >= INLIERS else None


def _stretch(journey: Journey, first: int, last: int) -> _Stretch:
    rows = np.arange(journey.first_row[first], journey.first_row[last])
    rows = rows[np.isfinite(journey.seen[rows, 0])]
    if len(rows) > MOST_ROWS:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_ROWS).astype(np.int64)]
    instants = np.searchsorted(journey.first_row, rows, side="right") - 1 - first
    return _Stretch(
        journey.steps[first:last], instants, journey.places[journey.marks[rows]], journey.seen[rows]
    )


def _minima(stretch: _Stretch, places: np.ndarray) -> list[Float[np.ndarray, "3"]]:
    """Different minima of the robust cost over (x, y, yaw), best first; residuals in metres."""
    back = stretch.back(np.array([1.0, 1.0, 0.0]))
    poses = _starts(stretch, places)
    for _ in range(DESCENT):
        residuals, jacobian = _metric(stretch, back, poses)
        scale = np.maximum(np.median(np.abs(residuals), axis=1), NEAR_M)[:, None]
        weighted = jacobian / (1.0 + (residuals / scale) ** 2)[..., None]
        normal = np.einsum("hri,hrj->hij", weighted, jacobian)
        normal += 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = -np.linalg.solve(normal, np.einsum("hri,hr->hi", weighted, residuals)[..., None])
        poses = poses + np.clip(step[..., 0], [-20.0, -20.0, -0.5], [20.0, 20.0, 0.5])
    residuals, _ = _metric(stretch, back, poses)
    scale = np.maximum(np.median(np.abs(residuals), axis=1), NEAR_M)[:, None]
    cost = np.sum(np.log(scale) + np.log1p((residuals / scale) ** 2), axis=1)
    chosen: list[np.ndarray] = []
    for pose in poses[np.argsort(cost)]:
        apart = [
            math.hypot(*(pose - one)[:2]) > 0.5 or abs(wrapped(pose[2] - one[2])) > 0.2
            for one in chosen
        ]
        if all(apart) and np.all(np.isfinite(pose)):
            chosen.append(pose)
        if len(chosen) == MOST_MINIMA:
            break
    return chosen


def _starts(stretch: _Stretch, places: np.ndarray) -> Float[np.ndarray, "h 3"]:
    """Headings all round; with ranges alone also places all over the map."""
    headings = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
    low, high = places.min(axis=0), places.max(axis=0)
    axes = [(low[0] + high[0]) / 2.0], [(low[1] + high[1]) / 2.0]
    if np.any(np.isnan(stretch.seen[:, 1])):
        reach = float(np.median(stretch.seen[:, 0])) / 2.0
        axes = tuple(
            np.linspace(a - reach, b + reach, PLACES_PER_AXIS).tolist()
            for a, b in zip(low, high, strict=True)
        )
    return np.array(list(itertools.product(*axes, headings)), float)


def _metric(
    stretch: _Stretch, back: Float[np.ndarray, "r 3"], poses: Float[np.ndarray, "h 3"]
) -> tuple[Float[np.ndarray, "h k"], Float[np.ndarray, "h k 3"]]:
    """Residuals in metres and their derivatives: of ranges, and of both coordinates of seen landmarks."""
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    bx, by = back[:, 0], back[:, 1]
    dx, dy = c * bx - s * by, s * bx + c * by
    x = stretch.spots[:, 0] - poses[:, :1] - dx
    y = stretch.spots[:, 1] - poses[:, 1:2] - dy
    depth, bearing = stretch.seen.T
    ranged = np.isnan(bearing)
    far = np.maximum(np.hypot(x, y), 1e-6)
    by_range = far - depth, np.stack([-x / far, -y / far, (x * dy - y * dx) / far], axis=-1)
    if np.all(ranged):
        return by_range
    yaw = poses[:, 2:] + back[:, 2]
    cy, sy = np.cos(yaw), np.sin(yaw)
    ahead, left = cy * x + sy * y, cy * y - sy * x
    side = depth * np.tan(np.clip(np.where(ranged, 0.0, bearing), -1.4, 1.4))
    of_ahead = np.stack([-cy, -sy, cy * dy - sy * dx + left], axis=-1)
    of_left = np.stack([sy, -cy, -sy * dy - cy * dx - ahead], axis=-1)
    residuals = [np.where(ranged, by_range[0], ahead - depth), np.where(ranged, 0.0, left - side)]
    jacobians = [
        np.where(ranged[:, None], by_range[1], of_ahead),
        np.where(ranged[:, None], 0.0, of_left),
    ]
    return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)


def _residuals(stretch: _Stretch, state: Float[np.ndarray, "8"]) -> Float[np.ndarray, "2 r"]:
    """Residuals of distance, m, and bearing, rad (NaN for a range)."""
    back = stretch.back(state[[ODOMETRY_SCALE, TURN_SCALE, DRIFT]])
    c, s = math.cos(state[2]), math.sin(state[2])
    x = stretch.spots[:, 0] - state[0] - (c * back[:, 0] - s * back[:, 1])
    y = stretch.spots[:, 1] - state[1] - (s * back[:, 0] + c * back[:, 1])
    bearing = wrap_angles(np.arctan2(y, x) - state[2] - back[:, 2])
    far = np.hypot(x, y)
    depth = np.where(np.isnan(stretch.seen[:, 1]), far, far * np.cos(bearing))
    depth = state[OFFSET] + (1.0 + state[GAIN]) * depth
    return np.stack([depth - stretch.seen[:, 0], wrap_angles(bearing - stretch.seen[:, 1])])


def _refined(
    stretch: _Stretch, pose: Float[np.ndarray, "3"], prior: PlanarPrior
) -> tuple[float, Fix, float]:
    """Log likelihood, fix and share of inliers near a pose, with the systematic errors."""
    state = np.concatenate([pose, [1.0, 1.0, 0.0, 0.0, 0.0]])
    centre = state.copy()
    sigmas = prior.odometry_scale_sigma, prior.turn_scale_sigma, prior.drift_sigma
    known = np.append(np.zeros(3), 1.0 / np.square([*sigmas, prior.gain_sigma, prior.offset_sigma]))
    steps = np.full(SIZE, 1e-5)
    for _ in range(REFINEMENT):
        residuals = _residuals(stretch, state)
        scale = _scales(residuals)
        jacobian = np.stack(
            [(_residuals(stretch, state + step) - residuals) / 1e-5 for step in np.diag(steps)], -1
        )
        white, slopes = residuals / scale[:, None], jacobian / scale[:, None, None]
        measured = np.isfinite(white)
        white, slopes = white[measured], slopes[measured]
        weighted = slopes / (1.0 + (white / 2.0) ** 2)[:, None] / SHARED
        normal = weighted.T @ slopes + np.diag(known) + LEAST * np.eye(SIZE)
        gradient = weighted.T @ white + known * (state - centre)
        step = -np.linalg.solve(normal, gradient)
        state = state + np.clip(step, -2.0, 2.0)
    residuals = _residuals(stretch, state)
    scale = _scales(residuals)
    likelihood, near = 0.0, []
    for row, size in zip(residuals, scale, strict=True):
        white = np.abs(row[np.isfinite(row)]) / size
        likelihood -= float(np.sum(math.log(size) + np.log1p(white**2))) / SHARED
        near.append(white < 4.0)
    likelihood -= 0.5 * float(known @ (state - centre) ** 2)
    covariance = np.linalg.inv(normal)
    state[2] = wrapped(state[2])
    fix = Fix(Gaussian(state, (covariance + covariance.T) / 2.0), *scale.tolist())
    return likelihood, fix, float(np.mean(np.concatenate(near)))


def _scales(residuals: Float[np.ndarray, "2 r"]) -> Float[np.ndarray, "2"]:
    """Standard deviations of the residuals by their medians; NaN without bearings."""
    found = [NORMAL * float(np.median(np.abs(residuals[0]))), math.nan]
    seen = residuals[1][np.isfinite(residuals[1])]
    if len(seen):
        found[1] = max(NORMAL * float(np.median(np.abs(seen))), NEAR_RAD / 4.0)
    found[0] = max(found[0], NEAR_M / 4.0)
    return np.array(found)
