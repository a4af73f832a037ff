"""Compiled inner loops of planar localisation: motion, sightings of landmarks, and whole runs.

After the first SIZE entries, named here, the state holds displacements (x, y) of the landmarks seen last, one
pair per slot.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..filtering._square_root_kernels import corrected, draw, lower, predicted, wrapped
from ..primitives.compiled import njit
from .config import Parameters


class Weights(NamedTuple):
    """Reach of the sigma points, and their weights for the mean and for the covariance."""

    reach: float
    mean: np.ndarray
    covariance: np.ndarray


class Scratch(NamedTuple):
    """Work space of the kernels, allocated once, see `scratch_space`."""

    points: np.ndarray
    seen: np.ndarray
    wide: np.ndarray
    away: np.ndarray
    work: np.ndarray
    noise: np.ndarray
    noise_seen: np.ndarray
    innovation: np.ndarray
    measured: np.ndarray
    angles: np.ndarray
    angles_seen: np.ndarray


SIZE = 12
X, Y, YAW, ODOMETRY_SCALE, TURN_SCALE, DRIFT, GAIN, OFFSET = range(8)
DEPTH, BEARING, LENS_EVEN, LENS_ODD = range(8, SIZE)
NO_BEARING = 1.0 / math.sqrt(2.0 * math.pi)
"""Deviation of the bearing, always 0, of a range alone: its factor of the density is 1."""


@njit(cache=True)
def scratch_space(size: int) -> Scratch:
    """Work space for a state of that size: sigma points, their sightings, roots, noise, angle flags."""
    angles = np.zeros(size, np.bool_)
    angles[YAW] = True
    return Scratch(
        np.empty((2 * size + 1, size)),
        np.empty((2 * size + 1, 2)),
        np.empty((size + 2, 3 * size + 3)),
        np.empty((2, size + 2)),
        np.empty((size + 2, size + 2)),
        np.empty((size, size)),
        np.zeros((2, 2)),
        np.zeros(2),
        np.zeros(2),
        angles,
        np.array([False, True]),
    )


@njit(cache=True)
def move(
    mean: np.ndarray,
    root: np.ndarray,
    dt: float,
    path: float,
    turn: float,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> bool:
    """Predict by odometry; False without any change if the result is not finite."""
    points, noise = scratch.points, scratch.noise
    size = mean.shape[0]
    keep_depth = math.exp(-dt / p.depth_memory)
    keep_bearing = math.exp(-dt / p.bearing_memory)
    keep_place = math.exp(-dt / p.place_memory)
    draw(mean, root, weights.reach, points)
    for k in range(points.shape[0]):
        point = points[k]
        ahead = path * point[ODOMETRY_SCALE]
        turned = turn * point[TURN_SCALE] + point[DRIFT] * dt
        middle = point[YAW] + 0.5 * turned
        point[X] += ahead * math.cos(middle)
        point[Y] += ahead * math.sin(middle)
        point[YAW] = wrapped(point[YAW] + turned)
        point[DEPTH] *= keep_depth
        point[BEARING] *= keep_bearing
        for j in range(SIZE, size):
            point[j] *= keep_place
    for i in range(size):
        for j in range(size):
            noise[i, j] = 0.0
    length, second = abs(path), math.sqrt(dt)
    along, across = p.along * math.sqrt(length), p.across * math.sqrt(length)
    c, s = math.cos(mean[YAW] + 0.5 * turn), math.sin(mean[YAW] + 0.5 * turn)
    noise[X, X], noise[X, Y] = c * along, -s * across
    noise[Y, X], noise[Y, Y] = s * along, c * across
    noise[YAW, YAW] = math.sqrt(
        p.turn_per_path**2 * length + p.turn_per_turn**2 * abs(turn) + p.turn_per_time**2 * dt
    )
    noise[ODOMETRY_SCALE, ODOMETRY_SCALE] = p.odometry_scale_walk * second
    noise[TURN_SCALE, TURN_SCALE] = p.turn_scale_walk * second
    noise[DRIFT, DRIFT] = p.drift_walk * second
    noise[GAIN, GAIN] = p.gain_walk * second
    noise[DEPTH, DEPTH] = p.depth_shared * math.sqrt(1.0 - keep_depth**2)
    noise[BEARING, BEARING] = p.bearing_shared * math.sqrt(1.0 - keep_bearing**2)
    noise[LENS_EVEN, LENS_EVEN] = noise[LENS_ODD, LENS_ODD] = p.lens_walk * second
    for j in range(SIZE, size):
        noise[j, j] = p.place * math.sqrt(1.0 - keep_place**2)
    return _predicted(mean, root, weights, scratch)


@njit(cache=True)
def _predicted(mean: np.ndarray, root: np.ndarray, weights: Weights, scratch: Scratch) -> bool:
    """Mean and root of the moved sigma points with the noise of the scratch space; False if refused."""
    return predicted(
        scratch.points, weights.mean, weights.covariance, scratch.noise, scratch.angles,
        mean, root, scratch.wide, scratch.away, scratch.work,
    )  # fmt: skip


@njit(cache=True)
def deviations(depth: float, rate: float, p: Parameters) -> tuple[float, float]:
    """Standard deviations of depth, m, and bearing, rad, of a sighting at a depth; rate: turn of the body, rad/s."""
    return math.hypot(p.depth_near, p.depth_far * depth * depth), math.hypot(
        p.bearing_sigma, p.bearing_turning * rate
    )


@njit(cache=True)
def expected(
    state: np.ndarray,
    place: np.ndarray,
    slot: int,
    sigma_depth: float,
    p: Parameters,
    bearing_seen: bool = True,
) -> tuple[float, float]:
    """Expected depth and bearing of a landmark, or range and 0; slot: entry of its displacement, or -1."""
    x, y = place[0] - state[X], place[1] - state[Y]
    if slot >= 0:
        x, y = x + state[slot], y + state[slot + 1]
    common = p.offset + state[OFFSET] + sigma_depth * state[DEPTH]
    if not bearing_seen:
        return common + (p.scale + state[GAIN]) * math.hypot(x, y), 0.0
    c, s = math.cos(state[YAW]), math.sin(state[YAW])
    ahead, left = c * x + s * y, c * y - s * x
    bearing = math.atan2(left, ahead)
    side = 2.0 * bearing  # 1 at half a radian
    lens = side * side * (state[LENS_EVEN] + side * state[LENS_ODD])
    depth = common + (p.scale + state[GAIN]) * ahead
    return depth, wrapped(bearing + state[BEARING] + lens)


@njit(cache=True)
def correct(
    mean: np.ndarray,
    root: np.ndarray,
    place: np.ndarray,
    slot: int,
    measured: np.ndarray,
    rate: float,
    gate: float,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> tuple[int, float]:
    """Update with one sighting of a known landmark; (status, log density) as `corrected`."""
    points, seen, noise = scratch.points, scratch.seen, scratch.noise_seen
    bearing_seen = not math.isnan(measured[1])
    # of the expected depth: by the measured one, the common error would follow each measurement and explain it
    depth, _ = expected(mean, place, slot, 0.0, p, bearing_seen)
    noise[0, 0], noise[1, 1] = deviations(depth, rate, p)
    scratch.measured[0], scratch.measured[1] = measured[0], measured[1]
    if not bearing_seen:
        scratch.measured[1], noise[1, 1] = 0.0, NO_BEARING
    draw(mean, root, weights.reach, points)
    for k in range(points.shape[0]):
        seen[k, 0], seen[k, 1] = expected(points[k], place, slot, noise[0, 0], p, bearing_seen)
    return corrected(
        points, seen, weights.mean, weights.covariance, scratch.measured, noise,
        scratch.angles, scratch.angles_seen, gate, mean, root,
        scratch.innovation, scratch.wide, scratch.away, scratch.work,
    )  # fmt: skip


@njit(cache=True)
def slot_of(mark: int, held: np.ndarray, used: np.ndarray) -> int:
    """The slot of a landmark; else a free one, else the one unused for longest; -1 without slots."""
    found = -1
    for s in range(held.shape[0]):
        if held[s] == mark:
            return s
        if found < 0 or (held[found] >= 0 and (held[s] < 0 or used[s] < used[found])):
            found = s
    return found


@njit(cache=True)
def occupy(
    mean: np.ndarray,
    root: np.ndarray,
    slot: int,
    mark: int,
    time_s: float,
    held: np.ndarray,
    used: np.ndarray,
    p: Parameters,
    wide: np.ndarray,
) -> int:
    """Assign a slot to a landmark; returns the entry of its displacement, -1 for slot -1."""
    if slot < 0:
        return -1
    entry, size = SIZE + 2 * slot, mean.shape[0]
    used[slot] = time_s
    if held[slot] == mark:
        return entry
    held[slot] = mark
    for i in range(size):
        for j in range(size):
            wide[i, j] = root[i, j] if j <= i else 0.0
        wide[i, size] = wide[i, size + 1] = 0.0
    for i in range(entry, entry + 2):
        for j in range(size):
            wide[i, j] = 0.0
        wide[i, size + i - entry] = p.place
        mean[i] = 0.0
    lower(wide, size, size, size + 2, size + 2)
    for i in range(size):
        for j in range(i + 1):
            root[i, j] = wide[i, j]
    return entry


@njit(cache=True)
def log_mixture(log_density: float, p: Parameters) -> float:
    """Log density of a sighting with a share of outliers."""
    bad = math.log(p.outlier * p.outlier_density)
    good = log_density + math.log(1.0 - p.outlier)
    top = max(bad, good)
    return top + math.log(math.exp(bad - top) + math.exp(good - top))


@njit(cache=True)
def inflate(
    mean: np.ndarray,
    root: np.ndarray,
    times: float,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> None:
    """Add `times` the recovery standard deviation to the pose."""
    points, noise = scratch.points, scratch.noise
    draw(mean, root, weights.reach, points)
    for i in range(mean.shape[0]):
        for j in range(mean.shape[0]):
            noise[i, j] = 0.0
    noise[X, X] = noise[Y, Y] = times * p.recovery_m
    noise[YAW, YAW] = min(times * p.recovery_rad, 2.0)
    _predicted(mean, root, weights, scratch)


@njit(cache=True)
def update(
    mean: np.ndarray,
    root: np.ndarray,
    mark: int,
    place: np.ndarray,
    measured: np.ndarray,
    rate: float,
    time_s: float,
    held: np.ndarray,
    used: np.ndarray,
    trust: np.ndarray,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> tuple[int, float]:
    """Update with an identified landmark; inflate the pose after too many rejections in a row.

    `trust` holds the number of rejections in a row and of recoveries so far, and is changed.
    """
    if not math.isfinite(measured[0]) or math.isinf(measured[1]):
        return -1, -math.inf
    entry = occupy(mean, root, slot_of(mark, held, used), mark, time_s, held, used, p, scratch.wide)
    status, density = correct(mean, root, place, entry, measured, rate, p.gate, p, weights, scratch)
    if status == 1:
        trust[0] = 0
        trust[1] = max(trust[1] - 1, 0)
    elif status == 0:
        trust[0] += 1
        if trust[0] >= p.recover_after:
            inflate(mean, root, 2.0 ** min(trust[1], 6), p, weights, scratch)
            trust[0], trust[1] = 0, trust[1] + 1
    return status, density


@njit(cache=True)
def pose_covariance(root: np.ndarray, covariance: np.ndarray) -> None:
    """Covariance of (x, y, yaw), written to (3, 3)."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(min(i, j) + 1):
                total += root[i, k] * root[j, k]
            covariance[i, j] = total


@njit(cache=True)
def filter_journey(
    mean: np.ndarray,
    root: np.ndarray,
    steps: np.ndarray,
    first_row: np.ndarray,
    marks: np.ndarray,
    seen: np.ndarray,
    places: np.ndarray,
    p: Parameters,
    weights: Weights,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Filter a whole run with identified landmarks.

    Args:
        mean, root: Of the start; changed to those of the end.
        steps: (n, 3) dt, path and turn before each instant.
        first_row: (n + 1,) the sightings of instant i are first_row[i] to first_row[i + 1].
        marks, seen: (r,) index of the landmark; (r, 2) depth and bearing, or range and NaN.
        places: (l, 2).

    Returns:
        Means and covariances of (x, y, yaw) at each instant; status, whitened innovation and log density of each
        sighting.
    """
    count, size = steps.shape[0], mean.shape[0]
    means, covariances = np.empty((count, 3)), np.empty((count, 3, 3))
    status, whitened = np.zeros(seen.shape[0], np.int8), np.zeros((seen.shape[0], 2))
    slots = (size - SIZE) // 2
    held, used, trust = np.full(slots, -1), np.zeros(slots), np.zeros(2, np.int64)
    scratch = scratch_space(size)
    densities, time_s = np.zeros(seen.shape[0]), 0.0
    for i in range(count):
        dt, path, turn = steps[i]
        move(mean, root, dt, path, turn, p, weights, scratch)
        time_s += dt
        rate = turn / dt if dt > 1e-3 else 0.0
        for row in range(first_row[i], first_row[i + 1]):
            status[row], density = update(
                mean, root, marks[row], places[marks[row]], seen[row], rate, time_s,
                held, used, trust, p, weights, scratch,
            )  # fmt: skip
            if status[row] >= 0:
                whitened[row] = scratch.innovation
                densities[row] = log_mixture(density, p)
        means[i] = mean[:3]
        pose_covariance(root, covariances[i])
    return means, covariances, status, whitened, densities
