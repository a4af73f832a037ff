"""Bend of a depth camera from its own motion: points keep their place in the room only if depth is straight.

The bend is fixed to the pixels, so it turns what the camera sees elsewhere in the image into a shift of the room. The
images are tracked, and the motion of each new reference and the bend of both images are estimated together; this is
repeated with straightened images until the bend stays. A common scale does not show.

Source: Teichman, Miller and Thrun 2013 (calibration of depth by what the moving sensor itself maps); joint least
squares of motion and bend ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..depth.distortion import MOST_BEND, Bend, Distortion
from ..primitives.frame import Depth
from ..primitives.pose import Pose3
from . import _bend_kernels as kernels
from .alignment import FINEST_GATE_M, fitted_light
from .likelihood import COMMON_PX
from .odometry import TRACKED, Odometry, OdometryConfig, Step
from .pose_uncertainty import error_transport
from .pyramid import CompressedImage, Pyramid, build, compress

MOST_IMAGES = 160  # ours: some seconds of a recording
MOST_ROUNDS = 8  # ours: each halves what is left of the bend, or better
CONVERGED = 3e-4  # ours: of a coefficient
MODEL = 20.0  # ours: pixels that share an error, as multiples of those of an alignment: the bend is no exact quadric
KNOWN = 0.5  # ours: of the prior's standard deviation; a coefficient is known if its own is below


@dataclass(frozen=True)
class MotionBend:
    """What the motion of a camera tells of the bend of its depth.

    Args:
        bend: Coefficients that are not known are 0.
        covariance: (5, 5) of the coefficients.
        known: Which of them the recording tells.
        pairs: Number of pairs of images.
    """

    bend: Bend
    covariance: Float[np.ndarray, "5 5"]
    known: Bool[np.ndarray, "5"]
    pairs: int


class BendOfPairs:
    """Estimates the bend from each new reference of an odometry and the reference before it, at the tracked motion.

    One such estimate finds about half of the bend, as the tracked motion has taken up the rest.
    """

    def __init__(self, level: int) -> None:
        """Begin without images; `level` of the pyramids is used, 0 is the finest."""
        self._level = level
        self._before: tuple[int, Pyramid] | None = None  # the latest reference
        self._information = np.zeros((kernels.BEND, kernels.BEND))
        self._pull = np.zeros(kernels.BEND)
        self._size = 0.0
        self.pairs = 0

    def note(self, step: Step, number: int, image: Pyramid) -> None:
        """Take an image that became a reference, after the odometry has tracked it.

        Args:
            step: Of the odometry.
            number: Of the image.
            image: The image.
        """
        before, self._before = self._before, (number, image)
        self._size = self._size or image.bend
        if before is None or step.state != TRACKED or step.aligned is None:
            return
        if step.reference == before[0] and self._level < min(
            len(before[1].levels), len(image.levels)
        ):
            found = step.aligned
            told = of_pair(before[1], image, found.motion, found.error, self._level)
            self._information += told.information
            self._pull += told.pull
            self.pairs += 1

    def solve(self, before: Float[np.ndarray, "5"] | None = None) -> MotionBend:
        """The bend by all pairs; `before` of it was taken out of the images already, none if None."""
        before = np.zeros(kernels.BEND) if before is None else before
        if not self._size > 0.0:
            return MotionBend(Bend(), np.zeros((5, 5)), np.zeros(5, bool), self.pairs)
        prior = np.eye(kernels.BEND) / self._size**2
        covariance = np.linalg.inv(self._information + prior)
        found = covariance @ (self._information @ before - self._pull)
        known = np.sqrt(np.diag(covariance)) < KNOWN * self._size
        found = np.clip(np.where(known, found, 0.0), -MOST_BEND, MOST_BEND)
        return MotionBend(Bend(*map(float, found)), covariance, known, self.pairs)


class BendEstimator:
    """Collects the images of a recording, in the order of time."""

    def __init__(self, distortion: Distortion) -> None:
        """Begin without images; `distortion` is the published size of the bend, its prior."""
        self._distortion = distortion
        self._images: list[CompressedImage] = []

    @property
    def is_full(self) -> bool:
        """Whether there are `MOST_IMAGES`; more take memory and time."""
        return len(self._images) >= MOST_IMAGES

    def add(self, depth: Depth, rgb: UInt8[np.ndarray, "h w 3"] | None) -> None:
        """Take the next image, with its registered colour image if there is one."""
        self._images.append(compress(build(depth, rgb, distortion=self._distortion)))

    def solve(self) -> MotionBend:
        """The bend by all images so far."""
        found = self._round(Bend())
        for _ in range(MOST_ROUNDS - 1 if found.known.any() else 0):
            before, found = found.bend, self._round(found.bend)
            if np.max(np.abs(found.bend.coefficients - before.coefficients)) < CONVERGED:
                break
        return found

    def _round(self, bend: Bend) -> MotionBend:
        """Track the straightened images and estimate the bend anew."""
        odometry, pairs = Odometry(OdometryConfig()), BendOfPairs(level=0)
        for number, compressed in enumerate(self._images):
            image = _straightened(compressed.pyramid(), bend)
            step = odometry.track(image)
            if odometry.references[-1].number == number:
                pairs.note(step, number, image)
        return pairs.solve(bend.coefficients)


def _straightened(image: Pyramid, bend: Bend) -> Pyramid:
    levels = [replace(level, z=bend.straightened(level.z, level.camera)) for level in image.levels]
    return Pyramid(tuple(levels), image.floor, image.bend)


class OfPair(NamedTuple):
    """What two images tell of k shapes of a depth error that is fixed to the pixels.

    Args:
        information: Of the coefficients, the motion eliminated.
        pull: Its gradient.
        moved: Change of the motion, (x, y, z, rotation vector) of T_target_source in axes of the target, m and rad, by
            taking out one unit of each shape.
    """

    information: Float[np.ndarray, "k k"]
    pull: Float[np.ndarray, "k"]
    moved: Float[np.ndarray, "6 k"]


def of_pair(
    target: Pyramid,
    source: Pyramid,
    motion: Pose3,
    error: float,
    level: int,
    shapes: int = kernels.BEND,
    by_depth: bool = True,
) -> OfPair:
    """Joint equations of the motion between two images and a depth error that both share.

    Args:
        target, source: The images.
        motion: T_target_source.
        error: Root mean square distance to the surfaces, in standard deviations.
        level: Of the pyramids.
        shapes: Those of a bend, or that of the vergence, see `_bend_kernels`.
        by_depth: False leaves out the distances to surfaces; grey values remain.
    """
    to, of = target.levels[level], source.levels[level]
    m = kernels.MOTION
    H, g = np.zeros((m + shapes, m + shapes)), np.zeros(m + shapes)
    T = motion.matrix
    light = fitted_light(to, of, T)
    kernels.bend_equations(of.as_source, to.as_target, T, FINEST_GATE_M, light, by_depth, H, g)
    H = np.triu(H) + np.triu(H, 1).T
    common = max(error, 1.0) ** 2 * COMMON_PX * MODEL / 4**level
    moved = -np.linalg.solve(H[:m, :m] + 1e-3 * np.eye(m), H[:m, m:])
    information = (H[m:, m:] + moved.T @ H[:m, m:]) / common
    pull = (g[m:] + moved.T @ g[:m]) / common
    return OfPair(information, pull, error_transport(motion.position) @ moved)
