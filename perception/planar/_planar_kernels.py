"""Compiled inner loops of planar localisation: motion, sightings of landmarks, and a whole journey at once.

The first entries of the state and the entries of the parameter vector `p` are named here, in the order of
`planar.PlanarConfig`. After the first SIZE entries the state holds displacements (x, y) of the landmarks seen
last, one pair a slot. Scratch arrays are made once per call, by `scratch_space`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..filtering._square_root_kernels import corrected, draw, lower, predicted, wrapped

Weights = tuple[float, np.ndarray, np.ndarray]
"""Reach of the sigma points, and their weights for the mean and for the covariance."""

SIZE = 10
X, Y, YAW, PACE, TURN, DRIFT, DEPTH, BEARING, BOW, SWERVE = range(SIZE)
(
    ALONG,
    ACROSS,
    TURN_PER_PATH,
    TURN_PER_TURN,
    TURN_PER_TIME,
    PACE_WALK,
    TURN_WALK,
    DRIFT_WALK,
    LENS_WALK,
    OFFSET,
    SCALE,
    DEPTH_NEAR,
    DEPTH_FAR,
    BEARING_SIGMA,
    BEARING_TURNING,
    DEPTH_SHARED,
    DEPTH_MEMORY,
    BEARING_SHARED,
    BEARING_MEMORY,
    PLACE,
    PLACE_MEMORY,
    OUTLIER,
    OUTLIER_DENSITY,
    GATE,
    DOUBT_AFTER,
    DOUBT_M,
    DOUBT_RAD,
) = range(27)


@njit(cache=True)
def scratch_space(size: int) -> tuple[np.ndarray, ...]:
    """Points, what they see, wide, away, work, noise, noise of a sighting, innovation, angles of both."""
    angles = np.zeros(size, np.bool_)
    angles[YAW] = True
    return (
        np.empty((2 * size + 1, size)),
        np.empty((2 * size + 1, 2)),
        np.empty((size + 2, 3 * size + 3)),
        np.empty((2, size + 2)),
        np.empty((size + 2, size + 2)),
        np.empty((size, size)),
        np.zeros((2, 2)),
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
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> bool:
    """Advance by what odometry tells; False, and nothing changed, if that is not finite."""
    points, _, wide, away, work, noise, _, _, angles, _ = scratch
    reach, weights_mean, weights_covariance = weights
    size = mean.shape[0]
    keep_depth = math.exp(-dt / p[DEPTH_MEMORY])
    keep_bearing = math.exp(-dt / p[BEARING_MEMORY])
    keep_place = math.exp(-dt / p[PLACE_MEMORY])
    draw(mean, root, reach, points)
    for k in range(points.shape[0]):
        point = points[k]
        ahead = path * point[PACE]
        turned = turn * point[TURN] + point[DRIFT] * dt
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
    along, across = p[ALONG] * math.sqrt(length), p[ACROSS] * math.sqrt(length)
    c, s = math.cos(mean[YAW] + 0.5 * turn), math.sin(mean[YAW] + 0.5 * turn)
    noise[X, X], noise[X, Y] = c * along, -s * across
    noise[Y, X], noise[Y, Y] = s * along, c * across
    noise[YAW, YAW] = math.sqrt(
        p[TURN_PER_PATH] ** 2 * length
        + p[TURN_PER_TURN] ** 2 * abs(turn)
        + p[TURN_PER_TIME] ** 2 * dt
    )
    noise[PACE, PACE] = p[PACE_WALK] * second
    noise[TURN, TURN] = p[TURN_WALK] * second
    noise[DRIFT, DRIFT] = p[DRIFT_WALK] * second
    noise[DEPTH, DEPTH] = p[DEPTH_SHARED] * math.sqrt(1.0 - keep_depth**2)
    noise[BEARING, BEARING] = p[BEARING_SHARED] * math.sqrt(1.0 - keep_bearing**2)
    noise[BOW, BOW] = noise[SWERVE, SWERVE] = p[LENS_WALK] * second
    for j in range(SIZE, size):
        noise[j, j] = p[PLACE] * math.sqrt(1.0 - keep_place**2)
    return predicted(
        points, weights_mean, weights_covariance, noise, angles, mean, root, wide, away, work
    )


@njit(cache=True)
def deviations(depth: float, rate: float, p: np.ndarray) -> tuple[float, float]:
    """Of the depth, m, and of the bearing, rad, of one sighting; rate: turn of the body, rad/s."""
    return math.hypot(p[DEPTH_NEAR], p[DEPTH_FAR] * depth * depth), math.hypot(
        p[BEARING_SIGMA], p[BEARING_TURNING] * rate
    )


@njit(cache=True)
def expected(
    state: np.ndarray, place: np.ndarray, slot: int, sigma_depth: float, p: np.ndarray
) -> tuple[float, float]:
    """Depth and bearing at which a state sees a place; slot: entry of its displacement, or -1."""
    x, y = place[0] - state[X], place[1] - state[Y]
    if slot >= 0:
        x, y = x + state[slot], y + state[slot + 1]
    c, s = math.cos(state[YAW]), math.sin(state[YAW])
    ahead, left = c * x + s * y, c * y - s * x
    bearing = math.atan2(left, ahead)
    side = 2.0 * bearing  # 1 at half a radian
    lens = side * side * (state[BOW] + side * state[SWERVE])
    depth = p[OFFSET] + p[SCALE] * ahead + sigma_depth * state[DEPTH]
    return depth, wrapped(bearing + state[BEARING] + lens)


@njit(cache=True)
def look(
    mean: np.ndarray,
    root: np.ndarray,
    place: np.ndarray,
    slot: int,
    measured: np.ndarray,
    rate: float,
    gate: float,
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> tuple[int, float]:
    """Learn from one sighting of a known place; (status, log density) as `corrected`."""
    points, seen, wide, away, work, _, noise, innovation, angles, angles_seen = scratch
    reach, weights_mean, weights_covariance = weights
    noise[0, 0], noise[1, 1] = deviations(measured[0], rate, p)
    draw(mean, root, reach, points)
    for k in range(points.shape[0]):
        seen[k, 0], seen[k, 1] = expected(points[k], place, slot, noise[0, 0], p)
    return corrected(
        points,
        seen,
        weights_mean,
        weights_covariance,
        measured,
        noise,
        angles,
        angles_seen,
        gate,
        mean,
        root,
        innovation,
        wide,
        away,
        work,
    )


@njit(cache=True)
def slot_of(mark: int, held: np.ndarray, used: np.ndarray) -> int:
    """The slot that holds a landmark; else one that is free, else the one used longest ago; -1 if none."""
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
    clock: float,
    held: np.ndarray,
    used: np.ndarray,
    p: np.ndarray,
    wide: np.ndarray,
) -> int:
    """Let a slot hold this landmark from now on; returns the entry of its displacement, -1 for slot -1."""
    if slot < 0:
        return -1
    entry, size = SIZE + 2 * slot, mean.shape[0]
    used[slot] = clock
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
        wide[i, size + i - entry] = p[PLACE]
        mean[i] = 0.0
    lower(wide, size, size + 2)
    for i in range(size):
        for j in range(i + 1):
            root[i, j] = wide[i, j]
    return entry


@njit(cache=True)
def mixed(log_density: float, p: np.ndarray) -> float:
    """Log density of a sighting that is an outlier now and then."""
    bad = math.log(p[OUTLIER] * p[OUTLIER_DENSITY])
    good = log_density + math.log(1.0 - p[OUTLIER])
    top = max(bad, good)
    return top + math.log(math.exp(bad - top) + math.exp(good - top))


@njit(cache=True)
def widen(
    mean: np.ndarray,
    root: np.ndarray,
    times: float,
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> None:
    """Doubt the pose: add so many times the deviation of doubt to it."""
    points, _, wide, away, work, noise, _, _, angles, _ = scratch
    reach, weights_mean, weights_covariance = weights
    draw(mean, root, reach, points)
    for i in range(mean.shape[0]):
        for j in range(mean.shape[0]):
            noise[i, j] = 0.0
    noise[X, X] = noise[Y, Y] = times * p[DOUBT_M]
    noise[YAW, YAW] = min(times * p[DOUBT_RAD], 2.0)
    predicted(points, weights_mean, weights_covariance, noise, angles, mean, root, wide, away, work)


@njit(cache=True)
def learn(
    mean: np.ndarray,
    root: np.ndarray,
    mark: int,
    place: np.ndarray,
    measured: np.ndarray,
    rate: float,
    clock: float,
    held: np.ndarray,
    used: np.ndarray,
    trust: np.ndarray,
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> tuple[int, float]:
    """Learn from a landmark that tells who it is, and doubt oneself when too many in a row do not fit.

    `trust` holds how many were rejected in a row and how often that has led to doubt, and is changed.
    """
    if not (math.isfinite(measured[0]) and math.isfinite(measured[1])):
        return -1, -math.inf
    entry = occupy(mean, root, slot_of(mark, held, used), mark, clock, held, used, p, scratch[2])
    status, density = look(mean, root, place, entry, measured, rate, p[GATE], p, weights, scratch)
    if status == 1:
        trust[0] = 0
        trust[1] = max(trust[1] - 1, 0)
    elif status == 0:
        trust[0] += 1
        if trust[0] >= p[DOUBT_AFTER]:
            widen(mean, root, 2.0 ** min(trust[1], 6), p, weights, scratch)
            trust[0], trust[1] = 0, trust[1] + 1
    return status, density


@njit(cache=True)
def pose_covariance(root: np.ndarray, covariance: np.ndarray) -> None:
    """Of (x, y, yaw), written to (3, 3)."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(min(i, j) + 1):
                total += root[i, k] * root[j, k]
            covariance[i, j] = total


@njit(cache=True)
def follow(
    mean: np.ndarray,
    root: np.ndarray,
    steps: np.ndarray,
    first_row: np.ndarray,
    marks: np.ndarray,
    seen: np.ndarray,
    places: np.ndarray,
    p: np.ndarray,
    weights: Weights,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Filter a whole journey whose landmarks tell who they are.

    Args:
        mean, root: Of the start; changed to those of the end.
        steps: (n, 3) dt, path and turn before each instant.
        first_row: (n + 1,) the sightings of instant i are first_row[i] to first_row[i + 1].
        marks, seen: (r,) index of the landmark; (r, 2) depth and bearing.
        places: (l, 2).

    Returns:
        Means and covariances of (x, y, yaw) at each instant, status and whitened innovation of each
        sighting, and the log likelihood of all of them.
    """
    count, size = steps.shape[0], mean.shape[0]
    means, covariances = np.empty((count, 3)), np.empty((count, 3, 3))
    status, whitened = np.zeros(seen.shape[0], np.int8), np.zeros((seen.shape[0], 2))
    slots = (size - SIZE) // 2
    held, used, trust = np.full(slots, -1), np.zeros(slots), np.zeros(2, np.int64)
    scratch = scratch_space(size)
    total, clock = 0.0, 0.0
    for i in range(count):
        dt, path, turn = steps[i]
        move(mean, root, dt, path, turn, p, weights, scratch)
        clock += dt
        rate = turn / dt if dt > 1e-3 else 0.0
        for row in range(first_row[i], first_row[i + 1]):
            status[row], density = learn(
                mean, root, marks[row], places[marks[row]], seen[row], rate, clock,
                held, used, trust, p, weights, scratch,
            )  # fmt: skip
            if status[row] >= 0:
                whitened[row] = scratch[7]
                total += mixed(density, p)
        means[i] = mean[:3]
        pose_covariance(root, covariances[i])
    return means, covariances, status, whitened, total
