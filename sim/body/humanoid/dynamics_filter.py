"""The dynamics filter: the centre of mass is moved until the ZMP of all links is the planned one.

The gait plans the walk of a point mass. Legs that swing, and links that turn, move the ZMP of the real body by up to 7 cm
away from that plan. The whole body's ZMP is computed over this step and repeats of it; a pendulum whose ZMP is the
opposite of that error gives the motion by which the centre of mass has to differ.

Source: Kajita et al. 2003, "Biped walking pattern generation by using preview control of zero-moment point", section IV
(second pass); here with the divergent component in place of preview control.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..gait import Step, behind, smooth
from ._momentum_kernels import shifted
from .tree import Tree

MEAN_TICKS = 5  # ours: of the error, against chatter of differences
PASSES = 3  # ours: the second halves what the first leaves
MOST_M = 0.12  # ours: limit of the error


@dataclass(frozen=True, eq=False)
class Plan:
    """One step of the whole body, a row per tick.

    Args:
        com, velocity: Centre of mass on the floor and its velocity, m and m/s.
        pelvis: x, y, z and yaw.
        angles: Of all joints, rad.
        left, right: Soles, x, y, z and yaw.
    """

    com: Float[np.ndarray, "n 2"]
    velocity: Float[np.ndarray, "n 2"]
    pelvis: Float[np.ndarray, "n 4"]
    angles: Float[np.ndarray, "n joints"]
    left: Float[np.ndarray, "n 4"]
    right: Float[np.ndarray, "n 4"]


class DynamicsFilter:
    """Plans step after step; the correction goes on smoothly from one to the next."""

    def __init__(self, tree: Tree, omega: float, tick_s: float) -> None:
        self._tree, self._omega, self._tick_s = tree, omega, tick_s
        self._com = np.zeros(2)
        self._capture = np.zeros(2)

    def plan(
        self,
        steps: Sequence[Step],
        gaze: Float[np.ndarray, "m 2"],
        angles: Float[np.ndarray, "joints"],
    ) -> Plan:
        """The first of these steps, as the whole body has to make it.

        Args:
            steps: The step, and its repeats.
            gaze: Angles of the gaze joints over all of them, rad.
            angles: Of all joints at the tick before.
        """
        com = np.concatenate([step.com for step in steps])
        capture = com + np.concatenate([step.com_velocity for step in steps]) / self._omega
        yaw = np.concatenate([step.body[:, 2] for step in steps])
        left, right = (np.concatenate([sole(step, side) for step in steps]) for side in (1, -1))
        point_mass = capture - np.gradient(capture, self._tick_s, axis=0) / self._omega
        error, moved = np.zeros_like(com), np.zeros_like(com)
        for _ in range(PASSES):
            pelvis, found = self._tree.follow(com + moved, left, right, yaw, gaze, angles)
            zmp = self._tree.zero_moment_points(pelvis, found, self._tick_s)
            error += np.clip(_mean(zmp - point_mass), -MOST_M, MOST_M)
            moved, capture = self._correction(error, steps[0])
        n = steps[0].ticks
        self._com, self._capture = moved[n - 1], capture[n]
        velocity = steps[0].com_velocity + self._omega * (capture[1 : n + 1] - moved[:n])
        com = com[:n] + moved[:n]
        pelvis, found = self._tree.follow(com, left[:n], right[:n], yaw[:n], gaze[:n], angles)
        return Plan(com, velocity, pelvis, found, left[:n], right[:n])

    def _correction(
        self, error: Float[np.ndarray, "m 2"], step: Step
    ) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "k 2"]]:
        """By how much the centre of mass differs tick by tick, and its capture point at the edges of the ticks."""
        capture = np.empty((len(error) + 1, 2))
        shifted(error, self._omega, self._tick_s, capture)
        fade = 1.0 - smooth(np.arange(len(capture)) / step.double_support_ticks)
        capture = capture + fade[:, None] * (self._capture - capture[0])
        return behind(capture, self._com, self._omega, self._tick_s), capture


def sole(step: Step, side: int) -> Float[np.ndarray, "n 4"]:
    """The left (1) or right (-1) sole over a step: x, y, z and yaw."""
    foot, ground_m = (step.left, step.left_m) if side > 0 else (step.right, step.right_m)
    height = step.lift * float(step.swing == side) + ground_m
    return np.column_stack([foot[:, :2], height, foot[:, 2]])


def _mean(values: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Mean over neighbouring ticks."""
    half = MEAN_TICKS // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.mean([padded[k : k + len(values)] for k in range(MEAN_TICKS)], axis=0)
