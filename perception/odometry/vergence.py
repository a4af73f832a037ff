"""Vergence of a stereo pair from its own motion: near and far points tell one motion only if disparity is right.

A right camera that is turned outwards by psi more than calibrated adds f psi (1 + x^2) to every disparity, x the ray slope:
1/z errs by psi (1 + x^2) / B. Motions by what is far are then too long or too short, and those by what is near are right.
All images share the error: it grows with the path, and the residuals of an alignment hardly show it.

The motion of each new reference and the vergence are estimated together, at the tracked motion, by grey values: matching
by blocks shapes surfaces a little by the view, which passes for vergence of 1 to 2 px. Claims count the vergence
that calibrated pairs have, or what shows beyond the noise of the estimate. At a motion that is far off one estimate finds
about half.

Source: Cvišić et al. 2021 (images of KITTI tell that its calibration is wrong); joint least squares and claims ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from ..depth.distortion import Distortion
from ..primitives.frame import Depth
from ..primitives.pose import Pose3
from . import _bend_kernels as kernels
from .depth_bend import MOST_IMAGES, MOST_ROUNDS, of_pair
from .odometry import TRACKED, Odometry, Step
from .pose_uncertainty import PoseUncertainty, error_transport, rigid_alignment
from .pyramid import CompressedImage, Pyramid, build, compress

COARSE = 1  # ours: level of the pyramids that tells what the vergence does to a pose
CONVERGED = 0.1  # ours: of the standard deviation; what is left is noise


@dataclass(frozen=True)
class Vergence:
    """What the motion of a stereo pair tells of its vergence.

    Args:
        angle: That the right camera is turned outwards more than calibrated, rad: then disparities are too large.
        sigma: Its standard deviation, rad; infinite if the motion tells nothing.
        usual: Standard deviation of the angle of calibrated pairs, rad.
        baseline_m: Of the pair.
        pairs: Number of pairs of images.
    """

    angle: float = 0.0
    sigma: float = math.inf
    usual: float = 0.0
    baseline_m: float = math.inf
    pairs: int = 0

    @property
    def share_per_m(self) -> float:
        """By how much depth in the middle of the image is too small, as a share of depth, per m of depth."""
        return self.angle / self.baseline_m

    @property
    def known(self) -> bool:
        """Whether the motion tells more than that pairs are usually calibrated."""
        return self.sigma < self.usual

    @property
    def size(self) -> float:
        """Standard deviation of `share_per_m` that claims count: the usual one, or what shows beyond the noise, 1/m."""
        beyond = self.angle**2 - self.sigma**2 if math.isfinite(self.sigma) else 0.0
        return math.sqrt(max(self.usual**2, beyond)) / self.baseline_m


class VergenceOfPairs:
    """Estimates the vergence from each new reference of an odometry and the one before, and what it does to all poses.

    Attributes:
        moved: Of every image, change of its pose by an error of inverse depth of 1/m in the middle of the image:
            (x, y, z, rotation vector) since the first image, in its axes.
    """

    def __init__(self, distortion: Distortion) -> None:
        """Begin without images; `distortion` is the size that calibrated pairs have."""
        self._distortion = distortion
        self._before: tuple[int, Pyramid] | None = None  # the latest reference
        self._information, self._pull, self._pairs = 0.0, 0.0, 0
        self._baseline_m, self._usual = math.inf, 0.0
        self.moved: list[Float[np.ndarray, "6"]] = []

    def note(self, step: Step, image: Pyramid, baseline_m: float, is_reference: bool) -> None:
        """Take the next image, after the odometry has tracked it.

        Args:
            step, image: The image and how it was tracked.
            baseline_m: Of the pair; 0 for an image of another sensor, which tells nothing.
            is_reference: Whether later images are aligned with it.
        """
        is_of_pair = baseline_m > 0.0
        if is_of_pair and not math.isfinite(self._baseline_m):
            self._baseline_m, self._usual = baseline_m, _usual(image, self._distortion, baseline_m)
        found = self._moved(step, image, is_of_pair, is_reference) if self.moved else np.zeros(6)
        self.moved.append(found)
        if is_reference:
            self._before = (len(self.moved) - 1, image) if is_of_pair else None

    def _moved(
        self, step: Step, image: Pyramid, is_of_pair: bool, is_reference: bool
    ) -> Float[np.ndarray, "6"]:
        reference = step.T_start_camera @ step.motion.inverse()
        arm = reference.rotation @ step.motion.position
        found = error_transport(arm) @ self.moved[step.reference]
        if (
            not is_of_pair
            or self._before is None
            or step.reference != self._before[0]
            or step.aligned is None
        ):
            return np.asarray(found)
        pair = (self._before[1], image, step.motion, step.aligned.error)
        if is_reference and step.state == TRACKED:
            told = of_pair(*pair, 0, kernels.VERGENCE, by_depth=False)
            self._information += float(told.information[0, 0])
            self._pull += float(told.pull[0])
            self._pairs += 1
        level = min(COARSE, len(self._before[1].levels) - 1, len(image.levels) - 1)
        moved = of_pair(*pair, level, kernels.VERGENCE).moved
        return np.asarray(found + (moved.reshape(2, 3) @ reference.rotation.T).ravel())

    def solve(self) -> Vergence:
        """The vergence by all pairs so far."""
        if not self._information > 0.0:
            return Vergence(usual=self._usual, baseline_m=self._baseline_m)
        angle = self._baseline_m * self._pull / self._information
        sigma = self._baseline_m / math.sqrt(self._information)
        return Vergence(angle, sigma, self._usual, self._baseline_m, self._pairs)

    def of_image(self, number: int) -> Float[np.ndarray, "6 6"]:
        """Covariance of a pose since the first image by the vergence, axes of the first image, m and rad."""
        if not self.moved:
            return np.zeros((6, 6))
        return np.asarray(self.solve().size ** 2 * np.outer(self.moved[number], self.moved[number]))

    def covariances(self, poses: Sequence[Pose3], T_world_start: Pose3) -> PoseUncertainty:
        """Covariances that the vergence gives to a trajectory; zero without images of a pair.

        Args:
            poses: T_world_camera of every image.
            T_world_start: The first image in the world.
        """
        if not self.moved:
            return PoseUncertainty(np.zeros((len(poses), 6, 6)), np.zeros((len(poses), 6, 6)))
        off = self.solve().size * np.array(self.moved).reshape(-1, 2, 3) @ T_world_start.rotation.T
        off = off.reshape(-1, 6)
        moves, best = rigid_alignment(np.array([one.position for one in poses]))
        left = off - moves @ np.einsum("nij,nj->i", best, off)
        return PoseUncertainty(*(np.einsum("ni,nj->nij", one, one) for one in (off, left)))


def _usual(image: Pyramid, distortion: Distortion, baseline_m: float) -> float:
    """The angle whose error of depth is the usual one, in the middle of the images; 0 without depth."""
    level = image.levels[-1]
    z, sigma = level.z.astype(float), level.sigma.astype(float)
    seen = z > 0.0
    if not seen.any():
        return 0.0
    return baseline_m * float(np.median(distortion.size(z[seen], sigma[seen]) / z[seen]))


class VergenceEstimator:
    """Collects the images of a pair, in the order of time, and takes the vergence out until none is left."""

    def __init__(self, distortion: Distortion) -> None:
        """Begin without images; `distortion` is the size that calibrated pairs have."""
        self._distortion = distortion
        self._baseline_m = math.inf
        self._images: list[CompressedImage] = []

    @property
    def is_full(self) -> bool:
        """Whether there are `MOST_IMAGES`; more take memory and time."""
        return len(self._images) >= MOST_IMAGES

    def add(self, depth: Depth, rgb: UInt8[np.ndarray, "h w 3"] | None) -> None:
        """Take the next image of a pair, with its picture if there is one."""
        self._baseline_m = depth.baseline_m
        self._images.append(compress(build(depth, rgb, distortion=self._distortion)))

    def solve(self) -> Vergence:
        """The vergence by all images so far."""
        found, angle = Vergence(), 0.0
        for _ in range(MOST_ROUNDS):
            found = self._round(angle)
            angle += found.angle
            if not abs(found.angle) > CONVERGED * found.sigma:
                break
        return replace(found, angle=angle)

    def _round(self, angle: float) -> Vergence:
        """Track the images without this vergence and estimate the rest."""
        odometry, pairs = Odometry(), VergenceOfPairs(self._distortion)
        for number, compressed in enumerate(self._images):
            image = _turned(compressed.pyramid(), angle / self._baseline_m)
            step = odometry.track(image)
            is_reference = odometry.references[-1].number == number
            pairs.note(step, image, self._baseline_m, is_reference)
        return pairs.solve()


def _turned(image: Pyramid, per_m: float) -> Pyramid:
    """The image without an error of inverse depth, 1/m in the middle of the image."""
    levels = []
    for level in image.levels:
        x = level.slopes[0]
        with np.errstate(divide="ignore"):
            z = 1.0 / (1.0 / level.z - np.float32(per_m) * (1.0 + x * x))
        levels.append(replace(level, z=np.where(z > 0.0, z, np.float32(np.nan))))
    return Pyramid(tuple(levels), image.floor, image.bend)
