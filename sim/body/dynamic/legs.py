"""Leg kinematics: joint angles from foot poses in closed form, and back.

The hip axes meet in a point, and so do the ankle axes. The knee follows from the distance between the two points, the
ankle from the direction of the hip, and the hip from the remaining rotation. Soles stay level, and the pelvis too
unless it is bent; the balance control adds its corrections afterwards.

Source: Kajita et al., Introduction to Humanoid Robotics, section 2.5.2 (analytical inverse kinematics).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, Pose3, times

from ..gait import Step
from ._legs_kernels import centre_of_mass, leg_forward, leg_inverse, pelvis_trajectory
from .anatomy import LEG_JOINTS, Anatomy, links

UPRIGHT = np.zeros(2)
STRETCHED = 0.95  # ours: longest leg, relative to a straight one
SINK_MPS = 0.08  # ours: at which the pelvis goes up and down for long steps
_LEGS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in LEG_JOINTS)


def tilt_rotation(tilt: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3 3"]:
    """Rotation from axes with that roll and pitch (rad) to level axes of the same heading."""
    roll, pitch = tilt.tolist()
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


class Legs:
    """The legs of one body; angles are (12,), left then right, from hip yaw to ankle roll."""

    joints = _LEGS

    def __init__(self, body: Anatomy) -> None:
        self.body = body
        self.size = np.array([body.hip_half_m, body.thigh_m, body.shank_m])
        self._masses = np.array(body.leg_kg)
        self._sole = np.array([0.0, body.foot_outward_m, body.foot_m[2] / 2 - body.ankle_m])
        self._upper = _upper(body)
        self._other = self.size * np.array([-1.0, 1.0, 1.0])

    def solve(
        self,
        pelvis: Float[np.ndarray, "4"],
        left: Float[np.ndarray, "4"],
        right: Float[np.ndarray, "4"],
        bend: Float[np.ndarray, "2"] = UPRIGHT,
    ) -> Float[np.ndarray, "12"]:
        """Joint angles for level soles.

        Args:
            pelvis, left, right: (x, y, z, yaw), m and rad; a foot is its ankle. If it is out of reach, the leg is
                stretched towards it.
            bend: Roll and pitch of the pelvis, rad.
        """
        angles = np.empty(12)
        turned = tilt_rotation(bend)
        leg_inverse(pelvis, turned, left, self.size, angles[:6])
        leg_inverse(pelvis, turned, right, self._other, angles[6:])
        return angles

    def feet(self, angles: Float[np.ndarray, "12"]) -> tuple[Pose3, Pose3]:
        """Left and right ankle with the rotation of the foot, pelvis frame."""
        found = []
        for own, size in ((angles[:6], self.size), (angles[6:], self._other)):
            rotation, points = np.empty((3, 3)), np.empty((3, 3))
            leg_forward(own, size, rotation, points)
            found.append(Pose3.from_rotation(rotation, points[2].copy()))
        return found[0], found[1]

    def footprints(
        self, angles: Float[np.ndarray, "12"], bend: Float[np.ndarray, "2"] = UPRIGHT
    ) -> tuple[Pose2, Pose2]:
        """Left and right foot projected on the floor, from a pelvis with that roll and pitch (rad)."""
        prints = []
        turned = tilt_rotation(bend)
        for foot in self.feet(angles):
            x, y, _ = times(turned, foot.position).tolist()
            ahead = times(turned, foot.rotation[:, 0])
            prints.append(Pose2(x, y, math.atan2(ahead[1], ahead[0])))
        return prints[0], prints[1]

    def heights(
        self, angles: Float[np.ndarray, "12"], bend: Float[np.ndarray, "2"] = UPRIGHT
    ) -> tuple[float, float]:
        """Heights of left and right sole above a pelvis with that roll and pitch (rad), negative, m."""
        up = tilt_rotation(bend)[2]
        left, right = (float(up @ foot.position) - self.body.ankle_m for foot in self.feet(angles))
        return left, right

    def com_shift(self, bend: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Shift of the whole body's centre of mass along and across when only the pelvis bends, m.

        Args:
            bend: Roll and pitch, rad.
        """
        above = self._upper[1:]
        share = self._upper[0] / (self._upper[0] + 2.0 * self._masses.sum())
        return np.asarray(share * (times(tilt_rotation(bend), above) - above)[:2])

    def centre_of_mass(self, angles: Float[np.ndarray, "12"]) -> Float[np.ndarray, "3"]:
        """Centre of mass of the whole body with head and arms at zero, pelvis frame, m."""
        com = np.empty(3)
        centre_of_mass(angles, self.size, self._masses, self._sole, self._upper, com)
        return com

    def pelvis_trajectory(
        self, step: Step, angles: Float[np.ndarray, "12"], tick_s: float, before_m: float
    ) -> Float[np.ndarray, "n 4"]:
        """Pelvis (x, y, z, yaw) over a step such that the centre of mass follows the pendulum.

        Args:
            step: Trajectories of feet and centre of mass.
            angles: Joint angles at the tick before the step, the initial guess.
            tick_s: Period.
            before_m: Height of the pelvis at the tick before the step.
        """
        pelvis = np.empty((step.ticks, 4))
        left, right = self.ankles(step)
        yaw = np.unwrap(step.body[:, 2])
        hip = self._hip_heights(step, left, right, SINK_MPS * tick_s, before_m)
        self._carry(step.com, left, right, yaw, hip, angles.copy(), pelvis)
        return pelvis

    def _hip_heights(
        self,
        step: Step,
        left: Float[np.ndarray, "n 4"],
        right: Float[np.ndarray, "n 4"],
        change_m: float,
        before_m: float,
    ) -> Float[np.ndarray, "n"]:
        """Heights of the pelvis: as on flat ground, or as low as both legs reach their feet without being stretched."""
        body = self.body
        hip = body.hip_m + step.body_m - step.lowered_m
        if not step.lowered_m.any() and before_m > hip[0] - 1e-9:
            return hip  # level steps are short
        longest = STRETCHED * (body.thigh_m + body.shank_m)
        c, s = np.cos(step.body[:, 2]), np.sin(step.body[:, 2])
        for feet, side in ((left, 1.0), (right, -1.0)):
            joint = step.com + side * body.hip_half_m * np.column_stack([-s, c])
            away2 = ((feet[:, :2] - joint) ** 2).sum(axis=1)
            hip = np.minimum(hip, feet[:, 2] + np.sqrt(np.maximum(longest**2 - away2, 0.0)))
        for k in range(len(hip) - 2, -1, -1):
            hip[k] = min(hip[k], hip[k + 1] + change_m)
        for k in range(len(hip)):
            hip[k] = min(hip[k], (hip[k - 1] if k else before_m) + change_m)
        return hip

    def stand(self, com: Float[np.ndarray, "2"], apart_m: float) -> Float[np.ndarray, "12"]:
        """Joint angles of standing with parallel feet and the centre of mass over a point between them, m."""
        angles, pelvis = np.zeros(12), np.empty((8, 4))
        left, right = (
            np.tile([0.0, side * apart_m / 2, self.body.ankle_m, 0.0], (8, 1)) for side in (1, -1)
        )
        hip = np.full(8, self.body.hip_m)
        self._carry(np.tile(com, (8, 1)), left, right, np.zeros(8), hip, angles, pelvis)
        return angles

    def ankles(self, step: Step) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
        """Left and right ankle (x, y, z, yaw) over a step."""
        found = []
        for feet, ground_m, side in ((step.left, step.left_m, 1), (step.right, step.right_m, -1)):
            height = step.lift * float(step.swing == side) + ground_m + self.body.ankle_m
            found.append(np.column_stack([feet[:, :2], height, feet[:, 2]]))
        return found[0], found[1]

    def _carry(
        self,
        com: np.ndarray,
        left: np.ndarray,
        right: np.ndarray,
        yaw: np.ndarray,
        hip: np.ndarray,
        angles: np.ndarray,
        pelvis: np.ndarray,
    ) -> None:
        args = (self.size, self._masses, self._sole, self._upper)
        pelvis_trajectory(com, left, right, yaw, hip, angles, *args, pelvis)


def _upper(body: Anatomy) -> Float[np.ndarray, "4"]:
    """Mass and centre of mass of all links but the legs, joints at zero, pelvis frame."""
    places: dict[str, np.ndarray] = {"": np.zeros(3)}
    mass, moment = 0.0, np.zeros(3)
    for link in links(body):
        place = places[link.name] = places[link.parent] + np.array(link.origin)
        if link.name not in _LEGS:
            mass += link.mass
            moment += link.mass * (place + link.centre_of_mass)
    return np.array([mass, *(moment / mass)])
