"""Compiled leg kinematics, centre of mass, attitude update and gear backlash.

A leg is described by `size`: (hip half width with the sign of its side, thigh, shank). Angles run from hip yaw, hip
roll, hip pitch, knee, ankle pitch to ankle roll. A foot is the frame of its ankle.
"""

import math

import numpy as np

from perception.primitives.compiled import njit

from ..pendulum import GRAVITY_MPS2

MOST_SHOCK = 1.0
"""Ours: limit of the accelerometer's deviation from the vertical, multiples of gravity."""


@njit(cache=True)
def leg_inverse(
    pelvis: np.ndarray, bend: np.ndarray, foot: np.ndarray, size: np.ndarray, angles: np.ndarray
) -> None:
    """Angles (6,) that put the ankle at foot (x, y, z, yaw) with a level sole, under a pelvis (same).

    Bend (3, 3) rotates pelvis axes to level axes of its heading.
    """
    c, s = math.cos(pelvis[3]), math.sin(pelvis[3])
    # hip relative to the ankle, in world axes, then in foot axes
    ahead, left = bend[0, 1] * size[0], bend[1, 1] * size[0]
    dx = pelvis[0] + c * ahead - s * left - foot[0]
    dy = pelvis[1] + s * ahead + c * left - foot[1]
    rz = pelvis[2] + bend[2, 1] * size[0] - foot[2]
    cf, sf = math.cos(foot[3]), math.sin(foot[3])
    rx, ry = cf * dx + sf * dy, cf * dy - sf * dx
    a, b = size[1], size[2]
    reach = math.sqrt(rx * rx + ry * ry + rz * rz)
    cosine = (reach * reach - a * a - b * b) / (2.0 * a * b)
    knee = math.acos(min(max(cosine, -1.0), 1.0))
    above = math.asin(min(max(a / reach * math.sin(knee), -1.0), 1.0))
    if reach * reach < a * a - b * b:  # a thigh longer than the shank, folded beyond a right angle
        above = math.pi - above
    roll = math.atan2(ry, rz)
    pitch = -math.atan2(rx, math.sqrt(ry * ry + rz * rz)) - above
    # thigh in level axes of the pelvis's heading: Rz(foot - pelvis) Rx(-roll) Ry(-pitch - knee)
    turn = foot[3] - pelvis[3]
    ct, st = math.cos(turn), math.sin(turn)
    cr, sr = math.cos(-roll), math.sin(-roll)
    cp, sp = math.cos(-pitch - knee), math.sin(-pitch - knee)
    side = (-st * cr, ct * cr, sr)
    front = (ct * cp - st * sr * sp, st * cp + ct * sr * sp, -cr * sp)
    up = (ct * sp + st * sr * cp, st * sp - ct * sr * cp, cr * cp)
    # remaining rotation of the hip, pelvis axes
    r01 = bend[0, 0] * side[0] + bend[1, 0] * side[1] + bend[2, 0] * side[2]
    r11 = bend[0, 1] * side[0] + bend[1, 1] * side[1] + bend[2, 1] * side[2]
    r21 = bend[0, 2] * side[0] + bend[1, 2] * side[1] + bend[2, 2] * side[2]
    r20 = bend[0, 2] * front[0] + bend[1, 2] * front[1] + bend[2, 2] * front[2]
    r22 = bend[0, 2] * up[0] + bend[1, 2] * up[1] + bend[2, 2] * up[2]
    yaw = math.atan2(-r01, r11)
    angles[0] = yaw
    angles[1] = math.atan2(r21, -r01 * math.sin(yaw) + r11 * math.cos(yaw))
    angles[2] = math.atan2(-r20, r22)
    angles[3] = knee
    angles[4] = pitch
    angles[5] = roll


@njit(cache=True)
def _place(rotation: np.ndarray, joints: np.ndarray) -> None:
    """Rotation of the thigh: Rz(yaw) Rx(roll) Ry(pitch)."""
    cy, sy = math.cos(joints[0]), math.sin(joints[0])
    cr, sr = math.cos(joints[1]), math.sin(joints[1])
    cp, sp = math.cos(joints[2]), math.sin(joints[2])
    rotation[0, 0] = cy * cp - sy * sr * sp
    rotation[0, 1] = -sy * cr
    rotation[0, 2] = cy * sp + sy * sr * cp
    rotation[1, 0] = sy * cp + cy * sr * sp
    rotation[1, 1] = cy * cr
    rotation[1, 2] = sy * sp - cy * sr * cp
    rotation[2, 0] = -cr * sp
    rotation[2, 1] = sr
    rotation[2, 2] = cr * cp


@njit(cache=True)
def leg_forward(
    angles: np.ndarray, size: np.ndarray, rotation: np.ndarray, points: np.ndarray
) -> None:
    """Hip, knee and ankle (points, (3, 3)) and the rotation of the foot, pelvis frame."""
    _place(rotation, angles)
    for k in range(3):
        points[0, k] = 0.0
        points[1, k] = -size[1] * rotation[k, 2]
    points[0, 1] = size[0]
    points[1, 1] += size[0]
    c, s = math.cos(angles[3]), math.sin(angles[3])
    for k in range(3):
        x, z = rotation[k, 0], rotation[k, 2]
        points[2, k] = points[1, k] - size[2] * (c * z + s * x)
    c, s = math.cos(angles[3] + angles[4]), math.sin(angles[3] + angles[4])
    cr, sr = math.cos(angles[5]), math.sin(angles[5])
    for k in range(3):
        x, y, z = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        ahead, up = c * x - s * z, c * z + s * x
        rotation[k, 0] = ahead
        rotation[k, 1] = cr * y + sr * up
        rotation[k, 2] = cr * up - sr * y


@njit(cache=True)
def centre_of_mass(
    angles: np.ndarray,
    size: np.ndarray,
    masses: np.ndarray,
    sole: np.ndarray,
    upper: np.ndarray,
    com: np.ndarray,
) -> None:
    """Centre of mass (com, (3,)) in the pelvis frame.

    Args: angles (12,) left then right; size (3,) of the left leg; masses (6,) of a leg's links; sole (3,) centre of
    the left foot in its own frame; upper (4,) mass and centre of all links but the legs.
    """
    rotation, points, leg = np.empty((3, 3)), np.empty((3, 3)), size.copy()
    total = upper[0]
    for k in range(3):
        com[k] = upper[0] * upper[1 + k]
    for side in range(2):
        sign = 1.0 - 2.0 * side
        leg[0] = sign * size[0]
        leg_forward(angles[6 * side : 6 * side + 6], leg, rotation, points)
        for k in range(3):
            com[k] += (masses[0] + masses[1]) * points[0, k]
            com[k] += masses[2] * (points[0, k] + points[1, k]) / 2.0
            com[k] += masses[3] * (points[1, k] + points[2, k]) / 2.0
            com[k] += masses[4] * points[2, k]
            foot = rotation[k, 0] * sole[0] + rotation[k, 1] * sign * sole[1]
            com[k] += masses[5] * (points[2, k] + foot + rotation[k, 2] * sole[2])
        for mass in masses:
            total += mass
    for k in range(3):
        com[k] /= total


@njit(cache=True)
def pelvis_trajectory(
    com: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    yaw: np.ndarray,
    hip: np.ndarray,
    angles: np.ndarray,
    size: np.ndarray,
    masses: np.ndarray,
    sole: np.ndarray,
    upper: np.ndarray,
    pelvis: np.ndarray,
) -> None:
    """Pelvis (n, 4) at heights hip (n,) such that the centre of mass follows com (n, 2) over feet (n, 4).

    Two fixed-point iterations per tick start from the solution of the tick before. Angles (12,) hold the solution
    before the first tick, and afterwards that of the last one.
    """
    offset, leg, level = np.empty(3), size.copy(), np.eye(3)
    for k in range(len(com)):
        for _ in range(2):
            centre_of_mass(angles, size, masses, sole, upper, offset)
            c, s = math.cos(yaw[k]), math.sin(yaw[k])
            pelvis[k, 0] = com[k, 0] - c * offset[0] + s * offset[1]
            pelvis[k, 1] = com[k, 1] - s * offset[0] - c * offset[1]
            pelvis[k, 2] = hip[k]
            pelvis[k, 3] = yaw[k]
            leg[0] = size[0]
            leg_inverse(pelvis[k], level, left[k], leg, angles[:6])
            leg[0] = -size[0]
            leg_inverse(pelvis[k], level, right[k], leg, angles[6:])


@njit(cache=True)
def update_vertical(
    up: np.ndarray,
    bias: np.ndarray,
    rate: np.ndarray,
    force: np.ndarray,
    tick: float,
    share: float,
    learn: float,
) -> None:
    """Rotate the vertical in trunk axes (up, (3,)) by the gyro and correct it towards the accelerometer, in place.

    The persistent part of the correction is learnt as the gyro's bias, (3,). Force (3,) is without planned
    acceleration. It is divided by gravity, not normalised: gear chatter shakes it by half a gravity, and the mean of
    such directions would tilt by degrees.
    """
    ex = force[0] / GRAVITY_MPS2 - up[0]
    ey = force[1] / GRAVITY_MPS2 - up[1]
    ez = force[2] / GRAVITY_MPS2 - up[2]
    most = 1.0 / max(1.0, math.sqrt(ex * ex + ey * ey + ez * ez) / MOST_SHOCK)
    fx, fy, fz = up[0] + most * ex, up[1] + most * ey, up[2] + most * ez
    wx, wy, wz = rate[0] - bias[0], rate[1] - bias[1], rate[2] - bias[2]
    bias[0] -= learn * (fy * up[2] - fz * up[1])
    bias[1] -= learn * (fz * up[0] - fx * up[2])
    bias[2] -= learn * (fx * up[1] - fy * up[0])
    x = up[0] + tick * (up[1] * wz - up[2] * wy) + share * (fx - up[0])
    y = up[1] + tick * (up[2] * wx - up[0] * wz) + share * (fy - up[1])
    z = up[2] + tick * (up[0] * wy - up[1] * wx) + share * (fz - up[2])
    length = math.sqrt(x * x + y * y + z * z)
    up[0], up[1], up[2] = x / length, y / length, z / length


@njit(cache=True)
def apply_backlash(
    wanted: np.ndarray, found: np.ndarray, half_backlash: np.ndarray, setpoint: np.ndarray
) -> None:
    """Motor setpoints through gears with half backlash (n,): a motor moves its joint only at a flank."""
    for k in range(len(wanted)):
        error = wanted[k] - found[k]
        half = half_backlash[k]
        if error > half:
            setpoint[k] = wanted[k] - half
        elif error < -half:
            setpoint[k] = wanted[k] + half
        else:
            setpoint[k] = found[k]
