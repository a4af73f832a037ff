"""Compiled: Gauss-Newton over pixels, each against the plane and the grey that the target has there."""

from __future__ import annotations

import numpy as np
from numba import njit

HUBER = 1.345  # 95 % as efficient as squares if nothing is wrong
STEEPEST = 0.1  # cosine of the ray to the plane: flatter ones are seen too badly

# columns of the totals behind the 21 of the information and the 6 of the gradient
GEOMETRIC, GEOMETRIC_COUNT, PHOTOMETRIC, PHOTOMETRIC_COUNT, PHOTOMETRIC_MEAN = 27, 28, 29, 30, 31
VALID, VISIBLE, FITTING, CONTRADICTING = 32, 33, 34, 35
TOTALS = 36


@njit(cache=True)
def equations(
    z: np.ndarray,
    sigma: np.ndarray,
    grey: np.ndarray,
    counts: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    target: np.ndarray,
    intrinsics: np.ndarray,
    T: np.ndarray,
    gate_m: float,
    light: np.ndarray,
    stride: int,
    totals: np.ndarray,
) -> None:
    """Fill the totals for T_target_source.

    `light` is (deviation, mean) of grey differences, deviation 0 for none. `counts` marks the pixels that
    overlap is judged by.
    """
    totals[:] = 0.0
    fx, fy, cx, cy = intrinsics
    height, width = target.shape[:2]
    use_grey = light[0] > 0.0 and grey.shape[0] > 1
    J = np.empty(6)
    r00, r01, r02, t0 = T[0]
    r10, r11, r12, t1 = T[1]
    r20, r21, r22, t2 = T[2]
    for row in range(0, z.shape[0], stride):
        for column in range(0, z.shape[1], stride):
            depth = z[row, column]
            if not depth > 0.0:
                continue
            judged = counts[row, column]
            totals[VALID] += judged
            px, py = x[column] * depth, y[row] * depth
            qx = r00 * px + r01 * py + r02 * depth + t0
            qy = r10 * px + r11 * py + r12 * depth + t1
            qz = r20 * px + r21 * py + r22 * depth + t2
            if qz < 0.05:
                continue
            u, v = fx * qx / qz + cx, fy * qy / qz + cy
            if u < -0.5 or v < -0.5 or u >= width - 0.5 or v >= height - 0.5:
                continue
            iu, iv = int(u + 0.5), int(v + 0.5)
            cell = target[iv, iu]
            seen = cell[4]
            if not seen > 0.0:
                continue
            totals[VISIBLE] += judged
            nx, ny, nz = cell[0], cell[1], cell[2]
            residual = nx * qx + ny * qy + nz * qz - cell[3]
            noise = sigma[row, column]
            along = seen - qz
            if along > gate_m + 6.0 * noise + 0.02 * seen:
                totals[CONTRADICTING] += judged
            if abs(residual) > gate_m + 3.0 * noise or abs(along) > 3.0 * gate_m + 6.0 * noise:
                continue
            slope = cell[3] / seen
            if slope < STEEPEST:
                continue
            scale = 1.0 / noise
            e = residual * scale
            if abs(e) < 3.0:
                totals[FITTING] += judged
            weight = 1.0 if abs(e) <= HUBER else HUBER / abs(e)
            totals[GEOMETRIC] += weight * e * e
            totals[GEOMETRIC_COUNT] += 1.0
            add(totals, J, nx, ny, nz, qx, qy, qz, e, scale, weight)
            if not use_grey:
                continue
            gu, gv = cell[6], cell[7]
            difference = cell[5] + gu * (u - iu) + gv * (v - iv) - grey[row, column]
            e = (difference - light[1]) / light[0]
            totals[PHOTOMETRIC] += min(abs(e), 3.0)
            totals[PHOTOMETRIC_MEAN] += min(max(e, -3.0), 3.0)
            totals[PHOTOMETRIC_COUNT] += 1.0
            if gu * gu + gv * gv < 1.0 or abs(e) > 6.0:
                continue
            weight = 1.0 if abs(e) <= HUBER else HUBER / abs(e)
            a, b = gu * fx / qz, gv * fy / qz
            c = -(a * qx + b * qy) / qz
            add(totals, J, a, b, c, qx, qy, qz, e, 1.0 / light[0], weight)


@njit(cache=True, inline="always")
def add(
    totals: np.ndarray,
    J: np.ndarray,
    a: float,
    b: float,
    c: float,
    qx: float,
    qy: float,
    qz: float,
    e: float,
    scale: float,
    weight: float,
) -> None:
    """One residual whose gradient in space is (a, b, c) * scale, at the point q."""
    j0, j1, j2 = a * scale, b * scale, c * scale
    j3, j4, j5 = qy * j2 - qz * j1, qz * j0 - qx * j2, qx * j1 - qy * j0
    w0, w1, w2, w3, w4, w5 = (
        weight * j0,
        weight * j1,
        weight * j2,
        weight * j3,
        weight * j4,
        weight * j5,
    )
    totals[0] += w0 * j0
    totals[1] += w0 * j1
    totals[2] += w0 * j2
    totals[3] += w0 * j3
    totals[4] += w0 * j4
    totals[5] += w0 * j5
    totals[6] += w1 * j1
    totals[7] += w1 * j2
    totals[8] += w1 * j3
    totals[9] += w1 * j4
    totals[10] += w1 * j5
    totals[11] += w2 * j2
    totals[12] += w2 * j3
    totals[13] += w2 * j4
    totals[14] += w2 * j5
    totals[15] += w3 * j3
    totals[16] += w3 * j4
    totals[17] += w3 * j5
    totals[18] += w4 * j4
    totals[19] += w4 * j5
    totals[20] += w5 * j5
    totals[21] += w0 * e
    totals[22] += w1 * e
    totals[23] += w2 * e
    totals[24] += w3 * e
    totals[25] += w4 * e
    totals[26] += w5 * e


@njit(cache=True)
def step(totals: np.ndarray, T: np.ndarray) -> float:
    """Solve the six equations and move T by it; the size of the step in m and rad, -1 if undetermined."""
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


@njit(cache=True)
def move(T: np.ndarray, twist: np.ndarray) -> None:
    """T becomes exp(twist) T to first order in translation, exactly a rotation in rotation."""
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


@njit(cache=True)
def refine(
    z: np.ndarray,
    sigma: np.ndarray,
    grey: np.ndarray,
    counts: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    target: np.ndarray,
    intrinsics: np.ndarray,
    T: np.ndarray,
    gate_m: float,
    least_gate_m: float,
    light: np.ndarray,
    stride: int,
    rounds: int,
    enough: float,
    totals: np.ndarray,
) -> None:
    """Move T until it settles on this level; the gate narrows from round to round."""
    gate = gate_m
    for _ in range(rounds):
        equations(z, sigma, grey, counts, x, y, target, intrinsics, T, gate, light, stride, totals)
        brighten(light, totals)
        size = step(totals, T)
        if size < 0.0 or (size < enough and gate <= least_gate_m * 1.01):
            break
        gate = max(least_gate_m, 0.6 * gate)


@njit(cache=True)
def brighten(light: np.ndarray, totals: np.ndarray) -> None:
    """Learn the difference in exposure and the deviation of grey values from the residuals."""
    count = totals[PHOTOMETRIC_COUNT]
    if light[0] <= 0.0 or count < 100.0:
        return
    light[1] += light[0] * totals[PHOTOMETRIC_MEAN] / count
    deviation = 1.2533 * light[0] * totals[PHOTOMETRIC] / count
    light[0] = min(max(deviation, 2.0), 40.0)
