"""Compiled loops of the plane search: sampling, scoring, random triples, votes.

Every input is finite. A plane n.p + rho = 0 is fitted in inverse depth: along the ray r = p / z it is
1 / z = a.r with a = -n / rho. The ray is exact and all noise is in 1 / z, so the fit is linear and unbiased,
also at grazing incidence. A sample is a `sample.Sample`, a gate a `prior.Gate`.
"""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit

FREE_SUMS = {"reassoc", "contract", "nsz"}  # allows vectorised sums
BLOCK = 256  # points scored between two tests whether the best score can still be reached
TRIES = 1500  # ours: finds a floor of 6 % of the points among tables, 20 of 20 seeds
LOG_MISS = math.log(
    1e-4
)  # ours: probability of overlooking a better plane at which the search stops
NEAREST_OF = 8  # ours: three triples of four take the nearest of this many random points


@njit(cache=True, nogil=True)
def within(xyz: np.ndarray, n: np.ndarray, rho: float, half_m: float, slope: float) -> np.ndarray:
    """Indices of the points within half_m + slope * distance of a plane: those a plane in the gate can reach."""
    count = xyz.shape[0]
    kept = np.empty(count, np.int64)
    k = 0
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        gate = half_m + slope * math.sqrt(x * x + y * y + z * z)
        kept[k] = i
        k += abs(d) <= gate
    return kept[:k]


@njit(cache=True, nogil=True)
def take(
    xyz: np.ndarray, sigma: np.ndarray, index: np.ndarray, sigmas: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns x, y, z of the indexed points, and their slack sigmas * sigma / z."""
    count = index.shape[0]
    x, y, z = np.empty(count), np.empty(count), np.empty(count)
    slack = np.empty(count)
    for k in range(count):
        i = index[k]
        x[k], y[k], z[k] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        slack[k] = sigmas * sigma[i] / xyz[i, 2]
    return x, y, z, slack


@njit(cache=True, nogil=True, fastmath=FREE_SUMS)
def score(
    sample: tuple[np.ndarray, ...],
    a: float,
    b: float,
    c: float,
    rho: float,
    base: float,
    penalty: float,
    flank: float,
    sharp2: float,
    least: float,
) -> float:
    """Floor score of a plane: points on it count for it, points below it against it.

    With tau = base + slack rho, a point at signed distance d counts max(1 - sharp2 (d / tau)^2, 0), -penalty
    below -2 tau, and -flank within tau where the first term is 0. Returns -inf as soon as `least` cannot be reached.
    """
    x, y, z, slack = sample
    count = x.shape[0]
    total = 0.0
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        part = 0.0
        for i in range(start, stop):
            tau = base + slack[i] * rho
            t = (a * x[i] + b * y[i] + c * z[i] + rho) / tau
            on = 1.0 - sharp2 * t * t
            part += max(on, 0.0) - (penalty if t < -2.0 else 0.0)
            part -= flank if on < 0.0 and abs(t) < 1.0 else 0.0
        total += part
        if total + (count - stop) < least:
            return -np.inf
    return total


@njit(cache=True, nogil=True)
def solve(A: np.ndarray, g: np.ndarray) -> tuple[float, float, float, bool]:
    """Solution of a symmetric 3x3 system by its adjugate; false where it is singular."""
    c00 = A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2]
    c01 = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c02 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    det = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    if not det > 1e-12 * A[0, 0] * A[1, 1] * A[2, 2]:
        return 0.0, 0.0, 0.0, False
    c11 = A[0, 0] * A[2, 2] - A[0, 2] * A[0, 2]
    c12 = A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]
    c22 = A[0, 0] * A[1, 1] - A[0, 1] * A[0, 1]
    return (
        (c00 * g[0] + c01 * g[1] + c02 * g[2]) / det,
        (c01 * g[0] + c11 * g[1] + c12 * g[2]) / det,
        (c02 * g[0] + c12 * g[1] + c22 * g[2]) / det,
        True,
    )


@njit(cache=True, nogil=True)
def fit(
    sample: tuple[np.ndarray, ...],
    n: np.ndarray,
    rho: float,
    wide: float,
    base: float,
) -> tuple[float, float, float, float, bool]:
    """Weighted least squares in inverse depth on the points within tau of a plane: new n and rho.

    Here tau = base + wide slack rho. False if the points do not span a plane.
    """
    x, y, z, slack = sample
    A = np.zeros((3, 3))
    g = np.zeros(3)
    for i in range(x.shape[0]):
        tau = base + slack[i] * wide * rho
        if abs(n[0] * x[i] + n[1] * y[i] + n[2] * z[i] + rho) < tau:
            q = 1.0 / z[i]
            w = (
                rho * z[i] / tau
            ) ** 2  # d = rho z (1/z - a.r), so 1/z has standard deviation tau / (rho z)
            u, v = x[i] * q, y[i] * q
            A[0, 0] += w * u * u
            A[0, 1] += w * u * v
            A[0, 2] += w * u
            A[1, 1] += w * v * v
            A[1, 2] += w * v
            A[2, 2] += w
            g[0] += w * u * q
            g[1] += w * v * q
            g[2] += w * q
    a, b, c, good = solve(A, g)
    norm = math.sqrt(a * a + b * b + c * c)
    if not good or norm < 1e-9:
        return 0.0, 0.0, 0.0, 0.0, False
    return -a / norm, -b / norm, -c / norm, 1.0 / norm, True


@njit(cache=True, nogil=True)
def draw(state: np.uint64) -> tuple[np.uint64, float]:
    """Next state and a random number in [0, 1) (SplitMix64)."""
    state = state + np.uint64(0x9E3779B97F4A7C15)
    s = state
    s = (s ^ (s >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    s = (s ^ (s >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    s = s ^ (s >> np.uint64(31))
    return state, float(s >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
def triple(
    sample: tuple[np.ndarray, ...],
    state: np.uint64,
    near_of: int,
    side: float,
    slacks: float,
) -> tuple[np.uint64, float, float, float, float, bool]:
    """Plane through three random points, the camera on its positive side.

    The second and the third are each the nearest to the first of `near_of` draws, which hits a small floor far
    more often. False if the points are nearly collinear, or closer than `side` or `slacks` times their noise.
    """
    x, y, z, slack = sample
    count = x.shape[0]
    state, r = draw(state)
    i = int(r * count)
    chosen = np.empty(2, np.int64)
    side2 = max(side, slacks * slack[i] * z[i]) ** 2
    for k in range(2):
        best, nearest = -1, np.inf
        for _ in range(near_of):
            state, r = draw(state)
            j = int(r * count)
            d = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
            if side2 < d < nearest and not (k == 1 and j == chosen[0]):
                best, nearest = j, d
        if best < 0:
            return state, 0.0, 0.0, 0.0, 0.0, False
        chosen[k] = best
    j, m = chosen[0], chosen[1]
    ux, uy, uz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
    vx, vy, vz = x[m] - x[i], y[m] - y[i], z[m] - z[i]
    a, b, c = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(a * a + b * b + c * c)
    u2, v2 = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    if area < 1e-6 or area * area < 0.05 * u2 * v2:  # sides at less than 13 deg
        return state, 0.0, 0.0, 0.0, 0.0, False
    a, b, c = a / area, b / area, c / area
    rho = -(a * x[i] + b * y[i] + c * z[i])
    if rho < 0.0:
        a, b, c, rho = -a, -b, -c, -rho
    return state, a, b, c, rho, True


@njit(cache=True, nogil=True)
def msac(
    sample: tuple[np.ndarray, ...],
    gate: tuple[np.ndarray, float, float, float, float],
    base: float,
    penalty: float,
    flank: float,
    sharp: float,
    seed: np.uint64,
) -> tuple[float, float, float, float, float]:
    """Best plane within the gate by random triples, each new best refined by least squares.

    Returns:
        n and rho, and the score; 0 where nothing was found.
    """
    up, _, least_cosine, lowest_rho, highest_rho = gate
    count = sample[0].shape[0]
    n = np.zeros(3)
    best_a, best_b, best_c, best_rho, best = 0.0, 0.0, 0.0, 0.0, 0.0
    state = seed
    k, needed = 0, TRIES
    while k < needed:
        state, a, b, c, rho, good = triple(sample, state, NEAREST_OF if k % 4 else 1, 0.0, 0.0)
        k += 1
        if not good or rho < lowest_rho or rho > highest_rho:
            continue
        if a * up[0] + b * up[1] + c * up[2] < least_cosine:
            continue
        value = score(sample, a, b, c, rho, base, penalty, flank, sharp * sharp, best)
        if value <= best:
            continue
        for wide in (3.0, 1.5, 1.0, 1.0 / sharp, 1.0 / sharp):  # local optimisation, coarse to fine
            n[0], n[1], n[2] = a, b, c
            fa, fb, fc, frho, good = fit(sample, n, rho, wide, base * wide)
            if not good or frho < lowest_rho or frho > highest_rho:
                continue
            if fa * up[0] + fb * up[1] + fc * up[2] < least_cosine:
                continue
            better = score(sample, fa, fb, fc, frho, base, penalty, flank, sharp * sharp, 0.0)
            if better > value:
                a, b, c, rho, value = fa, fb, fc, frho, better
        best_a, best_b, best_c, best_rho, best = a, b, c, rho, value
        share = best / count
        if share > 0.999:
            needed = k
            continue
        missed = math.log(1.0 - share**3)  # by one triple; 0 where hardly anything is on the plane
        if missed * TRIES < LOG_MISS:
            needed = int(LOG_MISS / missed) + 1
    return best_a, best_b, best_c, best_rho, best


@njit(cache=True, nogil=True)
def vote(
    sample: tuple[np.ndarray, ...],
    gate: tuple[np.ndarray, float, float, float, float],
    space: tuple[np.ndarray, np.ndarray, np.ndarray, float, float],
    limits: tuple[int, int, int, int],
    side: float,
    slacks: float,
    seed: np.uint64,
    table: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> int:
    """Randomised Hough transform: votes of random triples in a hash table of plane parameters.

    The distance is measured from an origin amid the points, where errors of tilt and distance are independent;
    at the camera a degree of tilt is centimetres of rho, and the votes for one plane would scatter. Cells
    are found by open addressing; the table size is a power of two and exceeds the number of triples.

    Args:
        sample, gate, space: `Sample`, `Gate` and `HoughSpace`.
        limits: `VoteLimits`: draw `triples`, fewer if a cell reaches `enough`, up to `most` while no cell
            has `least`.
        side, slacks: See `triple`.
        seed: Of the random numbers.
        table: `VoteTable`, set to -1, 0, 0; filled.

    Returns:
        Number of triples drawn.
    """
    up, _, least_cosine, lowest_rho, highest_rho = gate
    first, second, origin, tilt_cell, rho_cell = space
    triples, enough, least, most = limits
    keys, votes, sums = table
    state = seed
    mask = keys.shape[0] - 1
    fullest = 0
    for k in range(most):
        if k >= triples and fullest >= least:
            return k
        state, a, b, c, rho, good = triple(sample, state, NEAREST_OF if k % 4 else 1, side, slacks)
        if not good or rho < lowest_rho or rho > highest_rho:
            continue
        cosine = a * up[0] + b * up[1] + c * up[2]
        if cosine < least_cosine:
            continue
        one = math.atan2(a * first[0] + b * first[1] + c * first[2], cosine)
        two = math.atan2(a * second[0] + b * second[1] + c * second[2], cosine)
        i = math.floor(one / tilt_cell) + 512
        j = math.floor(two / tilt_cell) + 512
        distance = rho + a * origin[0] + b * origin[1] + c * origin[2]
        m = math.floor(distance / rho_cell) + 512
        key = (m * 1024 + j) * 1024 + i
        slot = (key * 2654435761) & mask
        while keys[slot] != -1 and keys[slot] != key:
            slot = (slot + 1) & mask
        keys[slot] = key
        votes[slot] += 1
        sums[slot, 0] += one
        sums[slot, 1] += two
        sums[slot, 2] += distance
        fullest = max(fullest, votes[slot])
        if fullest >= enough:
            return k + 1
    return most
