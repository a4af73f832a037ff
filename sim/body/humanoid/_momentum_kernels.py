"""Compiled momentum and ZMP of the motion of a tree of links; arrays as of `_tree_kernels`."""

import math

import numpy as np

from perception.primitives.compiled import njit

from ._tree_kernels import Arrays, apply, forward, rotation_vector


@njit(cache=True)
def moments(
    tree: Arrays,
    bodies: Arrays,
    pelvis: np.ndarray,
    angles: np.ndarray,
    tick_s: float,
    com: np.ndarray,
    momentum: np.ndarray,
    spin: np.ndarray,
) -> None:
    """Centre of mass (n, 3), and between ticks momentum (n - 1, 3) and angular momentum about the origin (n - 1, 3)."""
    mass, centre, inertia = bodies
    count = len(mass)
    R, p = np.zeros((2, count, 3, 3)), np.zeros((2, count, 3))
    c, v, w = np.zeros((2, count, 3)), np.empty(3), np.empty(3)
    between, left, right, h = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    total = mass.sum()
    momentum[:] = 0.0
    spin[:] = 0.0
    com[:] = 0.0
    for k in range(len(pelvis)):
        now, last = k % 2, (k + 1) % 2
        R[now, 0] = 0.0
        R[now, 0, 0, 0] = R[now, 0, 1, 1] = math.cos(pelvis[k, 3])
        R[now, 0, 1, 0] = math.sin(pelvis[k, 3])
        R[now, 0, 0, 1] = -R[now, 0, 1, 0]
        R[now, 0, 2, 2] = 1.0
        p[now, 0] = pelvis[k, :3]
        forward(tree, angles[k], R[now], p[now])
        for i in range(count):
            apply(R[now, i], p[now, i], centre[i], c[now, i])
            com[k] += mass[i] / total * c[now, i]
            if k == 0:
                continue
            v[:] = (c[now, i] - c[last, i]) / tick_s
            for a in range(3):
                for b in range(3):
                    between[a, b] = (
                        R[now, i, a, 0] * R[last, i, b, 0]
                        + R[now, i, a, 1] * R[last, i, b, 1]
                        + R[now, i, a, 2] * R[last, i, b, 2]
                    )
            rotation_vector(between, w)
            w /= tick_s
            for a in range(3):  # R I R^T w
                left[a] = R[now, i, 0, a] * w[0] + R[now, i, 1, a] * w[1] + R[now, i, 2, a] * w[2]
            for a in range(3):
                right[a] = (
                    inertia[i, a, 0] * left[0]
                    + inertia[i, a, 1] * left[1]
                    + inertia[i, a, 2] * left[2]
                )
            m = (c[now, i] + c[last, i]) / 2.0
            for a in range(3):
                h[a] = (
                    R[now, i, a, 0] * right[0]
                    + R[now, i, a, 1] * right[1]
                    + R[now, i, a, 2] * right[2]
                )
            momentum[k - 1] += mass[i] * v
            spin[k - 1, 0] += h[0] + mass[i] * (m[1] * v[2] - m[2] * v[1])
            spin[k - 1, 1] += h[1] + mass[i] * (m[2] * v[0] - m[0] * v[2])
            spin[k - 1, 2] += h[2] + mass[i] * (m[0] * v[1] - m[1] * v[0])


@njit(cache=True)
def zero_moment_points(
    com: np.ndarray,
    momentum: np.ndarray,
    spin: np.ndarray,
    weight_n: float,
    tick_s: float,
    zmp: np.ndarray,
) -> None:
    """ZMP (n, 2) on the plane z = 0 of a motion, see `moments`; the first and the last tick repeat their neighbours."""
    n = len(com)
    for k in range(1, n - 1):
        force = weight_n + (momentum[k, 2] - momentum[k - 1, 2]) / tick_s
        zmp[k, 0] = (weight_n * com[k, 0] - (spin[k, 1] - spin[k - 1, 1]) / tick_s) / force
        zmp[k, 1] = (weight_n * com[k, 1] + (spin[k, 0] - spin[k - 1, 0]) / tick_s) / force
    zmp[0], zmp[n - 1] = zmp[1], zmp[n - 2]


@njit(cache=True)
def shifted(error: np.ndarray, omega: float, tick_s: float, capture: np.ndarray) -> None:
    """Capture points (n + 1, 2) of a pendulum whose ZMP is moved by -error (n, 2), backwards from rest at the end."""
    n = len(error)
    decay = math.exp(-omega * tick_s)
    capture[n] = 0.0
    for k in range(n - 1, -1, -1):
        for i in range(2):
            capture[k, i] = -error[k, i] + (capture[k + 1, i] + error[k, i]) * decay
