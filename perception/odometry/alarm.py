"""Failure alarm of the odometry: the probability that the pose of an image is wrong.

Three signs are weighed: the innovation (how far the camera jumped from its own motion, in units of what it did lately),
the overlap (outliers and contradicting points of the alignment), and the residual of the inliers. Probability one have lost
images, relocalised ones (they could not be tracked, and no motion confirms where they were found), and images that
repeat the one before, as a frozen driver delivers them: they measure nothing.

The weights are a logistic regression with a normal prior on standardised signs, from 775 images of two sequences broken
on purpose (the first half of Replica's office and 7-Scenes' sweep; experiment `referee`, which reports on others): there
the innovation of good images is below 2.2, of slips above 20.

Source: ours; Bar-Shalom et al. 2001, section 5.4 (innovations as a test of a filter).
"""

from __future__ import annotations

import math
import zlib
from collections import deque
from dataclasses import dataclass

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from .odometry import FIRST, LOST, RELOCALISED, RESTARTED, Step
from .pyramid import Pyramid

OFFSET, INNOVATION, MISFIT, RESIDUAL = -1.7, 1.8, 1.5, 1.0  # logistic regression, see above
TYPICAL = 0.35  # median innovation of good images, taken while there is none
REMEMBERED = 8  # innovations that say what is usual
LEAST_M, LEAST_DEG = 0.005, 0.3  # added to what is usual: noise of a camera that stands still
LEAST_MISFIT = 0.01


@dataclass(frozen=True)
class AlarmConfig:
    """When the odometry raises an alarm."""

    threshold: float = setting(
        0.5, "", "probability of a wrong pose from which an image raises the alarm", "ours"
    )

    def __post_init__(self) -> None:
        if not 0.0 < self.threshold <= 1.0:
            raise ConfigError(
                f"odometry alarm: threshold={self.threshold} must lie above 0 and not above 1"
            )


class Alarm:
    """Watches the steps of an odometry."""

    def __init__(self) -> None:
        self._poses: deque[Pose3] = deque(maxlen=3)
        self._usual: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)  # squares, m^2 and deg^2
        self._image = 0

    def note(self, step: Step, image: Pyramid) -> float:
        """Probability that the pose of this image is wrong."""
        before, self._image = self._image, _fingerprint(image)
        if step.state in (LOST, RESTARTED):
            self._poses.clear()
        else:
            self._poses.append(step.T_start_camera)
        if step.state == FIRST:
            return 0.0
        innovation = self._innovation()
        if step.aligned is None or step.state == RELOCALISED or self._image == before:
            return 1.0
        aligned = step.aligned
        misfit = 1.0 - aligned.fitting + aligned.contradicting + LEAST_MISFIT
        signs = (
            OFFSET
            + INNOVATION * math.log(max(innovation, 1e-3))
            + MISFIT * math.log(max(misfit, 1e-3))
            + RESIDUAL * math.log(max(aligned.error, 1e-3))
        )
        return 1.0 / (1.0 + math.exp(-min(max(signs, -50.0), 50.0)))

    def _innovation(self) -> float:
        """Jump from constant velocity in units of recent ones, the larger of position and rotation."""
        if len(self._poses) < 3:
            return TYPICAL
        first, second, third = self._poses
        jump = (second @ (first.inverse() @ second)).inverse() @ third
        metres = float(np.linalg.norm(jump.position))
        turn = (float(np.trace(jump.rotation)) - 1.0) / 2.0
        degrees = math.degrees(math.acos(min(1.0, max(-1.0, turn))))
        usual = (
            np.sqrt(np.mean(self._usual, axis=0)) if self._usual else np.array([metres, degrees])
        )
        self._usual.append((metres**2, degrees**2))
        return max(metres / (float(usual[0]) + LEAST_M), degrees / (float(usual[1]) + LEAST_DEG))


def _fingerprint(image: Pyramid) -> int:
    level = image.levels[0]
    return zlib.crc32(level.grey.tobytes(), zlib.crc32(level.z.tobytes()))
