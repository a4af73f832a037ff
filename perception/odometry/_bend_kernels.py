"""Compiled normal equations of the motion between two images together with the bend of their depth."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit
from ._align_kernels import HUBER, STEEPEST, Source, Target

MOTION = 6
BEND, VERGENCE = 5, 1  # shapes of the error


@njit(cache=True, nogil=True)
def shapes(x: float, y: float, z: float, edge: float, into: np.ndarray) -> None:
    """Relative errors of depth at the ray slopes x, y and depth z, m: five of a bend, or that of the vergence."""
    if len(into) == VERGENCE:
        into[0] = z * (
            1.0 + x * x
        )  # a camera turned about y shifts its image by f (1 + x^2) per rad
        return
    u, v = x / edge, y / edge
    into[0], into[1], into[2], into[3], into[4] = u, v, u * u, u * v, v * v


@njit(cache=True, nogil=True)
def add(row: np.ndarray, error: float, weight: float, H: np.ndarray, g: np.ndarray) -> None:
    """Add one equation to the upper half of J'WJ and to J'We."""
    for i in range(len(row)):
        weighted = weight * row[i]
        for j in range(i, len(row)):
            H[i, j] += weighted * row[j]
        g[i] += weighted * error


@njit(cache=True, nogil=True)
def bend_equations(
    source: Source,
    target: Target,
    T: np.ndarray,
    gate_m: float,
    light: np.ndarray,
    by_depth: bool,
    H: np.ndarray,
    g: np.ndarray,
) -> None:
    """Fill the equations of (motion, bend) at T_target_source, both images with the same bend.

    Args:
        source, target: Finest levels.
        T: (4, 4).
        gate_m: Largest distance to the plane.
        light: (standard deviation, mean) of grey differences; a deviation of 0 leaves them out.
        H, g: (6 + k, 6 + k), upper half, and (6 + k,), of six of the motion and k shapes of the error, see `shapes`.
    """
    H[:], g[:] = 0.0, 0.0
    height, width = target.packed.shape[:2]
    fx, fy, cx, cy = target.intrinsics
    edge = width / (2.0 * fx)
    count = len(g) - MOTION
    here, there, row = np.empty(count), np.empty(count), np.empty(len(g))
    turned, q = np.empty(3), np.empty(3)
    use_grey = source.grey.shape[0] > 1 and light[0] > 0.0
    for v in range(source.z.shape[0]):
        for u in range(source.z.shape[1]):
            z, noise = float(source.z[v, u]), float(source.sigma[v, u])
            if not z > 0.0:
                continue
            for i in range(3):
                turned[i] = (T[i, 0] * source.x[u] + T[i, 1] * source.y[v] + T[i, 2]) * z
                q[i] = turned[i] + T[i, 3]
            if not q[2] >= 0.05:
                continue
            at_u, at_v = fx * q[0] / q[2] + cx, fy * q[1] / q[2] + cy
            if not (-0.5 <= at_u < width - 0.5 and -0.5 <= at_v < height - 0.5):
                continue
            iu, iv = int(at_u + 0.5), int(at_v + 0.5)
            cell = target.packed[iv, iu]
            seen, offset = cell[4], cell[3]
            if not seen > 0.0 or offset < STEEPEST * seen:
                continue
            residual = cell[0] * q[0] + cell[1] * q[1] + cell[2] * q[2] - offset
            if (
                abs(residual) > gate_m + 3.0 * noise
                or abs(seen - q[2]) > 3.0 * gate_m + 6.0 * noise
            ):
                continue
            shapes(source.x[u], source.y[v], z, edge, here)
            shapes((iu - cx) / fx, (iv - cy) / fy, seen, edge, there)
            along = cell[0] * turned[0] + cell[1] * turned[1] + cell[2] * turned[2]
            if by_depth:
                gradient(cell[0], cell[1], cell[2], q, row)
                for k in range(count):
                    row[MOTION + k] = offset * there[k] - along * here[k]
                weight = min(1.0, HUBER * noise / max(abs(residual), 1e-9)) / (noise * noise)
                add(row, residual, weight, H, g)
            if not use_grey:
                continue
            gu, gv = cell[6], cell[7]
            error = (
                cell[5] + gu * (at_u - iu) + gv * (at_v - iv) - source.grey[v, u] - light[1]
            ) / light[0]
            if gu * gu + gv * gv < 1.0 or abs(error) > 6.0:
                continue
            a, b = gu * fx / (light[0] * q[2]), gv * fy / (light[0] * q[2])
            c = -(a * q[0] + b * q[1]) / q[2]
            gradient(a, b, c, q, row)
            for k in range(count):
                row[MOTION + k] = -(a * turned[0] + b * turned[1] + c * turned[2]) * here[k]
            add(row, error, min(1.0, HUBER / max(abs(error), 1e-9)), H, g)


@njit(cache=True, nogil=True)
def gradient(a: float, b: float, c: float, q: np.ndarray, row: np.ndarray) -> None:
    """Derivative by the motion of a residual that changes by (a, b, c) per metre of the point q."""
    row[0], row[1], row[2] = a, b, c
    row[3], row[4], row[5] = q[1] * c - q[2] * b, q[2] * a - q[0] * c, q[0] * b - q[1] * a
