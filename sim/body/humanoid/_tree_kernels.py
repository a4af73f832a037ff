"""Compiled kinematics and momentum of a tree of links.

A tree is (parent (n,), rotation (n, 3, 3), place (n, 3), axis (n, 3)): joint i carries link i + 1, see
`perception.primitives.kinematics`. Bodies are (mass (m,), centre (m, 3), inertia (m, 3, 3)) of its m = n + 1 links. Legs
are (chain (2, 6) of joints, tool_rotation (2, 3, 3), tool_place (2, 3) of the sole in its link, range (n, 2)). Poses of pelvis
and soles are (x, y, z, yaw), m and rad, soles level.
"""

import math
from typing import Any

import numpy as np

from perception.primitives.compiled import njit

Arrays = tuple[Any, ...]

DAMPING = 1e-8  # ours: keeps a stretched leg solvable
EXACT = 1e-7  # ours: of the error of a sole, m and rad
STEPS = 12  # ours: two or three are enough from the tick before
LONGEST_RAD = 0.3  # ours: of one step
ROUNDS = 2  # of the fixed point between pelvis and centre of mass


@njit(cache=True)
def turn(axis: np.ndarray, angle: float, out: np.ndarray) -> None:
    """Rotation about a unit vector."""
    c, s = math.cos(angle), math.sin(angle)
    v = 1.0 - c
    x, y, z = axis[0], axis[1], axis[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@njit(cache=True)
def multiply(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Matrix product of (3, 3) with (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def apply(R: np.ndarray, p: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    """A point of a frame in the frame that holds it: R v + p."""
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2] + p[i]


@njit(cache=True)
def forward(tree: Arrays, angles: np.ndarray, R: np.ndarray, p: np.ndarray) -> None:
    """Rotations (m, 3, 3) and places (m, 3) of all links; those of link 0 are given."""
    parent, rotation, place, axis = tree
    own, at = np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(parent)):
        j = parent[k]
        turn(axis[k], angles[k], own)
        multiply(R[j], rotation[k], at)
        multiply(at, own, R[k + 1])
        apply(R[j], p[j], place[k], p[k + 1])


@njit(cache=True)
def centre_of_mass(tree: Arrays, bodies: Arrays, angles: np.ndarray, com: np.ndarray) -> None:
    """Centre of mass (3,) in the frame of link 0."""
    mass, centre, _ = bodies
    R, p, c = np.zeros((len(mass), 3, 3)), np.zeros((len(mass), 3)), np.empty(3)
    for i in range(3):
        R[0, i, i] = 1.0
    forward(tree, angles, R, p)
    total = 0.0
    com[:] = 0.0
    for k in range(len(mass)):
        apply(R[k], p[k], centre[k], c)
        com += mass[k] * c
        total += mass[k]
    com /= total


@njit(cache=True)
def rotation_vector(R: np.ndarray, out: np.ndarray) -> None:
    """Axis times angle of a rotation, rad."""
    out[0] = (R[2, 1] - R[1, 2]) / 2.0
    out[1] = (R[0, 2] - R[2, 0]) / 2.0
    out[2] = (R[1, 0] - R[0, 1]) / 2.0
    sine = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    if sine > 1e-9:
        out *= math.atan2(sine, (R[0, 0] + R[1, 1] + R[2, 2] - 1.0) / 2.0) / sine


@njit(cache=True)
def cholesky_solve(A: np.ndarray, b: np.ndarray) -> None:
    """Solve A x = b for a positive definite matrix, in place."""
    n = len(b)
    for j in range(n):
        for i in range(j, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = math.sqrt(s) if i == j else s / A[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]


@njit(cache=True)
def leg_inverse(
    tree: Arrays, legs: Arrays, side: int, pelvis: np.ndarray, sole: np.ndarray, angles: np.ndarray
) -> None:
    """Angles, in place, that put the sole of one leg (0 left, 1 right) where it is wanted, from angles nearby."""
    _, rotation, place, axis = tree
    chain, tool_rotation, tool_place, limits = legs
    yaw = sole[3] - pelvis[3]
    goal_R = np.zeros((3, 3))
    goal_R[0, 0] = goal_R[1, 1] = math.cos(yaw)
    goal_R[1, 0] = math.sin(yaw)
    goal_R[0, 1] = -goal_R[1, 0]
    goal_R[2, 2] = 1.0
    c, s = math.cos(pelvis[3]), math.sin(pelvis[3])
    dx, dy = sole[0] - pelvis[0], sole[1] - pelvis[1]
    goal = np.array([c * dx + s * dy, c * dy - s * dx, sole[2] - pelvis[2]])
    R, own, at, tip_R = np.eye(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    p, q, tip, miss = np.empty(3), np.empty(3), np.empty(3), np.empty(6)
    joints, axes, J = np.empty((6, 3)), np.empty((6, 3)), np.empty((6, 6))
    A, b = np.empty((6, 6)), np.empty(6)
    for _ in range(STEPS):
        R[:] = 0.0
        p[:] = 0.0
        for i in range(3):
            R[i, i] = 1.0
        for k in range(6):
            j = chain[side, k]
            apply(R, p, place[j], q)
            p[:] = q
            multiply(R, rotation[j], at)
            turn(axis[j], angles[j], own)
            multiply(at, own, R)
            joints[k] = p
            for i in range(3):
                axes[k, i] = R[i, 0] * axis[j, 0] + R[i, 1] * axis[j, 1] + R[i, 2] * axis[j, 2]
        multiply(R, tool_rotation[side], tip_R)
        apply(R, p, tool_place[side], tip)
        for i in range(3):
            miss[i] = goal[i] - tip[i]
            for k in range(3):
                at[i, k] = (
                    goal_R[i, 0] * tip_R[k, 0]
                    + goal_R[i, 1] * tip_R[k, 1]
                    + goal_R[i, 2] * tip_R[k, 2]
                )
        rotation_vector(at, miss[3:])
        error = 0.0
        for i in range(6):
            error = max(error, abs(miss[i]))
        if error < EXACT:
            break
        for k in range(6):
            a, r = axes[k], tip - joints[k]
            J[0, k] = a[1] * r[2] - a[2] * r[1]
            J[1, k] = a[2] * r[0] - a[0] * r[2]
            J[2, k] = a[0] * r[1] - a[1] * r[0]
            J[3, k], J[4, k], J[5, k] = a[0], a[1], a[2]
        for i in range(6):
            b[i] = 0.0
            for r6 in range(6):
                b[i] += J[r6, i] * miss[r6]
            for k in range(6):
                A[i, k] = 0.0
                for r6 in range(6):
                    A[i, k] += J[r6, i] * J[r6, k]
            A[i, i] += DAMPING + error * error / 2.0
        cholesky_solve(A, b)
        most = 1e-12
        for k in range(6):
            most = max(most, abs(b[k]))
        share = min(1.0, LONGEST_RAD / most)
        for k in range(6):
            j = chain[side, k]
            angles[j] = min(max(angles[j] + share * b[k], limits[j, 0]), limits[j, 1])


@njit(cache=True)
def pelvis_over(
    tree: Arrays,
    bodies: Arrays,
    com: np.ndarray,
    height: float,
    yaw: float,
    angles: np.ndarray,
    pelvis: np.ndarray,
) -> None:
    """Pelvis (4,) that puts the centre of mass over com (2,) with these joint angles."""
    offset = np.empty(3)
    centre_of_mass(tree, bodies, angles, offset)
    c, s = math.cos(yaw), math.sin(yaw)
    pelvis[0] = com[0] - c * offset[0] + s * offset[1]
    pelvis[1] = com[1] - s * offset[0] - c * offset[1]
    pelvis[2], pelvis[3] = height, yaw


@njit(cache=True)
def follow(
    tree: Arrays,
    bodies: Arrays,
    legs: Arrays,
    com: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    yaw: np.ndarray,
    height: float,
    gaze: np.ndarray,
    turned: np.ndarray,
    angles: np.ndarray,
    pelvis: np.ndarray,
    found: np.ndarray,
) -> None:
    """Pelvis (n, 4) and angles (n, joints) such that the centre of mass follows com (n, 2) over soles (n, 4).

    The joints gaze (2,) are at turned (n, 2). Angles (joints,) hold the solution before the first tick, and afterwards that of the last one.
    """
    for k in range(len(com)):
        for i in range(len(gaze)):
            angles[gaze[i]] = turned[k, i]
        for _ in range(ROUNDS):
            pelvis_over(tree, bodies, com[k], height, yaw[k], angles, pelvis[k])
            leg_inverse(tree, legs, 0, pelvis[k], left[k], angles)
            leg_inverse(tree, legs, 1, pelvis[k], right[k], angles)
        found[k] = angles
