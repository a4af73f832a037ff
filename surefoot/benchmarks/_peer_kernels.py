"""The formulas of two benchmarks as anybody would compile them: one loop after the other, nothing skipped."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def weight_in_view(
    places: np.ndarray,
    weights: np.ndarray,
    rotations: np.ndarray,
    across: float,
    down: float,
    result: np.ndarray,
) -> None:
    """Weight of the points in view of every direction; rotations (p, t, 3, 3), tangents of half the view."""
    for p in range(rotations.shape[0]):
        for t in range(rotations.shape[1]):
            R, total = rotations[p, t], 0.0
            for k in range(places.shape[0]):
                x, y, z = places[k, 0], places[k, 1], places[k, 2]
                forward = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
                if (
                    abs(R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) <= across * forward
                    and abs(R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) <= down * forward
                ):
                    total += weights[k]
            result[p, t] = total


@njit(cache=True)
def field(
    places: np.ndarray,
    goal: np.ndarray,
    goal_heading: float,
    centres: np.ndarray,
    radii: np.ndarray,
    lengths: tuple[float, float, float, float],
    weights: tuple[float, float],
    result: np.ndarray,
) -> None:
    """u_T with angles; lengths d_con, d_e, d_b and K_r, weights of goal and obstacles."""
    d_con, d_e, d_b, k_r = lengths
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        to_x, to_y = goal[0] - x, goal[1] - y
        rho_rg, phi = math.hypot(to_x, to_y), math.atan2(to_y, to_x)
        if rho_rg <= d_con:
            phi += phi - goal_heading
        towards_x, towards_y = math.cos(phi), math.sin(phi)
        sum_x = sum_y = 0.0
        for k in range(radii.shape[0]):
            radius = radii[k]
            or_x, or_y = x - centres[k, 0], y - centres[k, 1]
            rho = math.hypot(or_x, or_y)
            if rho > radius + d_e + d_b:
                continue
            od_x, od_y = goal[0] - centres[k, 0], goal[1] - centres[k, 1]
            inside = rho < radius
            behind = rho_rg + radius < math.hypot(od_x, od_y) or or_x * to_x + or_y * to_y >= 0.0
            if behind and not inside:
                continue
            angle = math.atan2(or_y, or_x)
            if not inside:
                share = (rho - radius) / d_e
                if rho >= radius + d_e:
                    share = 2.0 - (radius + d_e + k_r) / (rho + k_r)
                sign = 1.0 if od_x * or_y - od_y * or_x < 0.0 else -1.0
                angle += sign * 0.5 * math.pi * share
            sum_x += math.cos(angle)
            sum_y += math.sin(angle)
        size = math.hypot(sum_x, sum_y)
        result[i, 0], result[i, 1] = towards_x, towards_y
        if size >= 1e-9:
            result[i, 0] = weights[0] * towards_x + weights[1] * sum_x / size
            result[i, 1] = weights[0] * towards_y + weights[1] * sum_y / size
