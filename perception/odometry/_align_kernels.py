"""Compiled Gauss-Newton over pixels, each against the plane and grey value of the target there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

HUBER = 1.345  # 95 % efficiency for Gaussian errors
STEEPEST = 0.1  # least cosine between ray and normal: depth at grazing incidence is unreliable
FREE_SIGMAS, FREE_SHARE = 6.0, 0.02
"""A point is in free space if it is nearer than the surface behind it by these (of noise, of depth) and the gate."""

# entries of the totals after the 21 of the information matrix and the 6 of the gradient
GEOMETRIC, GEOMETRIC_COUNT, PHOTOMETRIC, PHOTOMETRIC_COUNT, PHOTOMETRIC_MEAN = 27, 28, 29, 30, 31
VALID, VISIBLE, FITTING, CONTRADICTING = 32, 33, 34, 35
TOTALS = 36


class Source(NamedTuple):
    """The moved image: depth, standard deviation, grey values, pixels that overlap counts, x/z and y/z."""

    z: np.ndarray
    sigma: np.ndarray
    grey: np.ndarray
    counts: np.ndarray
    x: np.ndarray
    y: np.ndarray


class Target(NamedTuple):
    """The fixed image: `pack`ed pixels, and fx, fy, cx, cy in px."""

    packed: np.ndarray
    intrinsics: np.ndarray


@njit(cache=True, nogil=True)
def equations(
    source: Source,
    target: Target,
    T: np.ndarray,
    gate_m: float,
    light: np.ndarray,
    totals: np.ndarray,
) -> None:
    """Fill the totals for T_target_source.

    `light` is (standard deviation, mean) of grey differences; a deviation of 0 leaves them out. `counts` marks the
    pixels that overlap is measured by. Row by row: one vector loop projects all pixels, they are looked up one by
    one, their equations are written to `rows`, and vector loops multiply these out.
    """
    totals[:] = 0.0
    z, grey = source.z, source.grey
    width = z.shape[1]
    near = np.empty((5, width), np.float32)  # qx, qy, qz, u, v
    rows = np.empty((7, 2 * width), np.float32)  # sqrt(weight) * (six of J, residual)
    camera = target.intrinsics.astype(np.float32)
    motion = T.astype(np.float32)
    gate = np.float32(gate_m)
    for row in range(z.shape[0]):
        project(
            z[row], source.x, np.float32(source.y[row]), motion, camera,
            near[0], near[1], near[2], near[3], near[4],
        )  # fmt: skip
        count = look_up(
            z[row], source.sigma[row], grey[min(row, grey.shape[0] - 1)], source.counts[row],
            near, target.packed, camera, gate, light, grey.shape[0] > 1, rows, totals,
        )  # fmt: skip
        multiply_out(rows, count, totals)


@njit(cache=True, nogil=True, fastmath={"contract"})
def project(
    z: np.ndarray,
    x: np.ndarray,
    y: np.float32,
    T: np.ndarray,
    camera: np.ndarray,
    qx: np.ndarray,
    qy: np.ndarray,
    qz: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> None:
    """One row of the source in the target's axes, m, and in its pixels."""
    fx, fy, cx, cy = camera
    a0, a1, a2 = T[0, 0], T[1, 0], T[2, 0]
    b0 = T[0, 1] * y + T[0, 2]
    b1 = T[1, 1] * y + T[1, 2]
    b2 = T[2, 1] * y + T[2, 2]
    t0, t1, t2 = T[0, 3], T[1, 3], T[2, 3]
    one = np.float32(1.0)
    for n in range(len(z)):
        depth, slope = z[n], x[n]
        px = (a0 * slope + b0) * depth + t0
        py = (a1 * slope + b1) * depth + t1
        pz = (a2 * slope + b2) * depth + t2
        inverse = one / pz
        qx[n], qy[n], qz[n] = px, py, pz
        u[n], v[n] = fx * px * inverse + cx, fy * py * inverse + cy


@njit(cache=True, nogil=True, forceinline=True)
def huber_root(size: np.float32) -> np.float32:
    """Square root of the Huber weight of a residual of this size, in standard deviations."""
    root, huber = np.float32(1.0), np.float32(HUBER)
    if size > huber:
        root = np.sqrt(huber / size)
    return root


@njit(cache=True, nogil=True, forceinline=True)
def enter(
    rows: np.ndarray,
    n: int,
    a: np.float32,
    b: np.float32,
    c: np.float32,
    qx: np.float32,
    qy: np.float32,
    qz: np.float32,
    residual: np.float32,
) -> None:
    """Write equation n: a residual that changes by (a, b, c) per metre of the point q, through a motion (v, w) of it.

    Args:
        rows: (7, at least n + 1), the six of J and the residual.
        n: Column.
        a, b, c: Gradient by the point, by v; q x (a, b, c) is that by w.
        qx, qy, qz: The point in the target's axes, m.
        residual: Weighted, as the gradient.
    """
    rows[0, n], rows[1, n], rows[2, n] = a, b, c
    rows[3, n], rows[4, n] = qy * c - qz * b, qz * a - qx * c
    rows[5, n], rows[6, n] = qx * b - qy * a, residual


@njit(cache=True, nogil=True)
def look_up(
    z: np.ndarray,
    sigma: np.ndarray,
    grey: np.ndarray,
    counts: np.ndarray,
    near: np.ndarray,
    target: np.ndarray,
    camera: np.ndarray,
    gate: np.float32,
    light: np.ndarray,
    has_grey: bool,
    rows: np.ndarray,
    totals: np.ndarray,
) -> int:
    """Associate the pixels of one row with the target; returns the number of equations.

    Long, because geometric and photometric equations share most of their values.
    """
    height, width = target.shape[:2]
    half = np.float32(0.5)
    right, bottom = np.float32(width) - half, np.float32(height) - half
    use_grey = has_grey and light[0] > 0.0
    deviation = np.float32(light[0] if use_grey else 1.0)
    per_grey, mean = np.float32(1.0) / deviation, np.float32(light[1])
    fx, fy = camera[0], camera[1]
    one, three, six = np.float32(1.0), np.float32(3.0), np.float32(6.0)
    count, valid, visible, fitting, contradicting = 0, 0, 0, 0, 0
    geometric, geometric_count = np.float32(0.0), 0
    photometric, photometric_mean, photometric_count = np.float32(0.0), np.float32(0.0), 0
    for n in range(len(z)):
        if not z[n] > np.float32(0.0):
            continue
        judged = counts[n]
        valid += judged
        qx, qy, qz, u, v = near[0, n], near[1, n], near[2, n], near[3, n], near[4, n]
        if not (qz >= np.float32(0.05) and -half <= u < right and -half <= v < bottom):
            continue  # also what is not a number
        iu, iv = np.int32(u + half), np.int32(v + half)
        cell = target[iv, iu]
        seen = cell[4]
        if not seen > np.float32(0.0):
            continue
        visible += judged
        nx, ny, nz, offset = cell[0], cell[1], cell[2], cell[3]
        noise = sigma[n]
        along = seen - qz
        if along > gate + np.float32(FREE_SIGMAS) * noise + np.float32(FREE_SHARE) * seen:
            contradicting += judged
        residual = nx * qx + ny * qy + nz * qz - offset
        if abs(residual) > gate + three * noise or abs(along) > three * gate + six * noise:
            continue
        if offset < np.float32(STEEPEST) * seen:
            continue
        scale = one / noise
        e = residual * scale
        size = abs(e)
        if size < three:
            fitting += judged
        root = huber_root(size)
        geometric += root * root * e * e
        geometric_count += 1
        root_scale = root * scale
        a, b, c = nx * root_scale, ny * root_scale, nz * root_scale
        enter(rows, count, a, b, c, qx, qy, qz, root * e)
        count += 1
        if not use_grey:
            continue
        gu, gv = cell[6], cell[7]
        e = (cell[5] + gu * (u - iu) + gv * (v - iv) - grey[n] - mean) * per_grey
        size = abs(e)
        photometric += min(size, three)
        photometric_mean += min(max(e, -three), three)
        photometric_count += 1
        if gu * gu + gv * gv < one or size > six:
            continue
        root = huber_root(size)
        root_scale = root * per_grey / qz
        a, b = gu * fx * root_scale, gv * fy * root_scale
        c = -(a * qx + b * qy) / qz
        enter(rows, count, a, b, c, qx, qy, qz, root * e)
        count += 1
    totals[VALID] += valid
    totals[VISIBLE] += visible
    totals[FITTING] += fitting
    totals[CONTRADICTING] += contradicting
    totals[GEOMETRIC] += geometric
    totals[GEOMETRIC_COUNT] += geometric_count
    totals[PHOTOMETRIC] += photometric
    totals[PHOTOMETRIC_MEAN] += photometric_mean
    totals[PHOTOMETRIC_COUNT] += photometric_count
    return count


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def multiply_out(rows: np.ndarray, count: int, totals: np.ndarray) -> None:
    """Add J'J and J'e of the equations; the order of summation is free but always the same."""
    k = 0
    for i in range(7):
        for j in range(i, 7):
            if i == 6:
                continue
            first, second = rows[i], rows[j]
            total = np.float32(0.0)
            for n in range(count):
                total += first[n] * second[n]
            if j == 6:
                totals[21 + i] += total
            else:
                totals[k] += total
                k += 1


@njit(cache=True, nogil=True)
def step(totals: np.ndarray, T: np.ndarray) -> float:
    """Solve the six equations and move T; returns the length of the step in m and rad, -1 if undetermined."""
    H = np.empty((6, 6))
    k = 0
    for i in range(6):
        for j in range(i, 6):
            H[i, j] = H[j, i] = totals[k]
            k += 1
    for i in range(6):
        H[i, i] = H[i, i] * (1.0 + 1e-6) + 1e-3
    g = totals[21:27].copy()
    for i in range(6):  # Cholesky, in place
        for j in range(i + 1):
            s = H[i, j]
            for m in range(j):
                s -= H[i, m] * H[j, m]
            if i == j:
                if not s > 0.0:
                    return -1.0
                H[i, i] = np.sqrt(s)
            else:
                H[i, j] = s / H[j, j]
    for i in range(6):
        for m in range(i):
            g[i] -= H[i, m] * g[m]
        g[i] /= H[i, i]
    for i in range(5, -1, -1):
        for m in range(i + 1, 6):
            g[i] -= H[m, i] * g[m]
        g[i] /= H[i, i]
    move(T, -g)
    return np.sqrt(np.sum(g * g))


@njit(cache=True, nogil=True)
def move(T: np.ndarray, twist: np.ndarray) -> None:
    """T becomes exp(twist) T, to first order in translation and exactly in rotation."""
    wx, wy, wz = twist[3], twist[4], twist[5]
    angle2 = wx * wx + wy * wy + wz * wz
    angle = np.sqrt(angle2)
    if angle > 1e-8:
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    else:
        s, c = 1.0, 0.5
    K = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    R = np.eye(3) + s * K + c * (K @ K)
    for j in range(4):
        a, b, c = T[0, j], T[1, j], T[2, j]
        for i in range(3):
            T[i, j] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c
    for i in range(3):
        T[i, 3] += twist[i]


@njit(cache=True, nogil=True)
def refine(
    source: Source,
    target: Target,
    T: np.ndarray,
    gate_m: float,
    least_gate_m: float,
    light: np.ndarray,
    rounds: int,
    converged: float,
    totals: np.ndarray,
) -> None:
    """Refine T on one level until it converges; the gate narrows with every iteration."""
    gate = gate_m
    for _ in range(rounds):
        equations(source, target, T, gate, light, totals)
        brighten(light, totals)
        size = step(totals, T)
        if size < 0.0 or (size < converged and gate <= least_gate_m * 1.01):
            break
        gate = max(least_gate_m, 0.6 * gate)


@njit(cache=True, nogil=True)
def brighten(light: np.ndarray, totals: np.ndarray) -> None:
    """Estimate the exposure difference and the standard deviation of grey values from the residuals."""
    count = totals[PHOTOMETRIC_COUNT]
    if light[0] <= 0.0 or count < 100.0:
        return
    light[1] += light[0] * totals[PHOTOMETRIC_MEAN] / count
    deviation = 1.2533 * light[0] * totals[PHOTOMETRIC] / count
    light[0] = min(max(deviation, 2.0), 40.0)


@njit(cache=True, nogil=True)
def bends(
    source: Source,
    target: Target,
    T: np.ndarray,
    gate_m: float,
    side_px: float,
    pulls: np.ndarray,
) -> float:
    """Gradient of the motion by a relative depth error of each patch of the source.

    Rows of `pulls` are patches, row by row: the sum of J' w (derivative of the residual by the relative depth
    error). Returns the root mean square displacement of pixels between the images, px.
    """
    pulls[:] = 0.0
    z, sigma, x, y = source.z, source.sigma, source.x, source.y
    packed = target.packed
    height, width = packed.shape[:2]
    fx, fy, cx, cy = target.intrinsics
    columns = int(np.ceil(z.shape[1] / side_px))
    moved, count = 0.0, 0
    for row in range(z.shape[0]):
        for column in range(z.shape[1]):
            depth = z[row, column]
            if not depth > 0.0:
                continue
            px, py = x[column] * depth, y[row] * depth
            qx = T[0, 0] * px + T[0, 1] * py + T[0, 2] * depth + T[0, 3]
            qy = T[1, 0] * px + T[1, 1] * py + T[1, 2] * depth + T[1, 3]
            qz = T[2, 0] * px + T[2, 1] * py + T[2, 2] * depth + T[2, 3]
            if not qz >= 0.05:
                continue
            u, v = fx * qx / qz + cx, fy * qy / qz + cy
            if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                continue
            cell = packed[int(v + 0.5), int(u + 0.5)]
            seen, noise = cell[4], sigma[row, column]
            if not seen > 0.0 or cell[3] < STEEPEST * seen:
                continue
            nx, ny, nz = cell[0], cell[1], cell[2]
            residual = nx * qx + ny * qy + nz * qz - cell[3]
            if abs(residual) > gate_m + 3.0 * noise or abs(seen - qz) > 3.0 * gate_m + 6.0 * noise:
                continue
            weight = min(1.0, HUBER * noise / max(abs(residual), 1e-9)) / (noise * noise)
            weight *= nx * (qx - T[0, 3]) + ny * (qy - T[1, 3]) + nz * (qz - T[2, 3])
            patch = pulls[int(row / side_px) * columns + int(column / side_px)]
            patch[0] += weight * nx
            patch[1] += weight * ny
            patch[2] += weight * nz
            patch[3] += weight * (qy * nz - qz * ny)
            patch[4] += weight * (qz * nx - qx * nz)
            patch[5] += weight * (qx * ny - qy * nx)
            moved += (u - column) ** 2 + (v - row) ** 2
            count += 1
    return np.sqrt(moved / max(count, 1))
