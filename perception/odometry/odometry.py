"""Odometry by keyframes: the pose of each image, and detection of losses.

Each image is aligned with the latest reference image while enough of it is in view, and then becomes the
reference itself, so drift accumulates per reference and not per image. A poor alignment is repeated from
several initial poses. If it is still poor, the camera is lost: the step says so, and relocalisation searches
for the camera among earlier references.

Source: keyframes after Kerl et al., DVO (2013); acceptance by overlap off the floor is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from .alignment import AlignConfig, Alignment, explains_better, same
from .baselines import Aligner, aligner
from .hypotheses import rotation_starts
from .pyramid import CompressedImage, Pyramid, compress

FIRST, TRACKED, DOUBTFUL, RELOCALISED = "first", "tracked", "doubtful", "relocalised"
LOST, RESTARTED = "lost", "restarted"

# Thresholds on shares of points; all ours, from recordings with ground truth.
SURE_FITTING = 0.93  # a smaller share of inliers: other initial poses are tried
SURE_CONTRADICTING = 0.02  # a larger share of contradicting points: likewise
SURE_VISIBLE = 0.80  # a smaller share in view was a large step: likewise
SURE_JUMP_M = 0.10  # a larger distance from constant velocity: likewise
LEAST_FITTING = 0.70  # a smaller share of inliers: lost
MOST_CONTRADICTING = 0.10  # a larger share of contradicting points: lost
MOST_SIGMA_M = 0.05  # a larger standard deviation of the step: lost
KEEP_VISIBLE = 0.80  # a reference is used while this share of the image is in view of it
DOUBTFUL_CONTRADICTING = 0.03  # from this share on the step is reported as doubtful ...
DOUBTFUL_FACTOR = 25.0  # ... and its covariance multiplied by this
SEARCHED = 10  # references tried per lost image, in turn
REUSE_VISIBLE = 0.85  # share of the image in view of an earlier reference that is used again
REUSE_TURN_DEG = 12.0  # a fifth of the field of view, as KEEP_VISIBLE


@dataclass(frozen=True)
class OdometryConfig:
    """Which alignment is used, and when the reference changes."""

    aligner: str = setting(
        "surefoot",
        "",
        "alignment of two images; open3d, open3d-intensity, open3d-depth and small_gicp for comparison",
        "ours: baselines need their package",
    )
    keep_m: float = 0.30  # ours: farther from the reference, planes look different
    give_up: int = 10  # ours: images lost in a row before a new reference starts at the last pose
    remembered: int = 200  # ours: references kept for relocalisation; bounds the memory
    reuse: bool = False  # use earlier references again, which stops drift; loop closures do without

    def __post_init__(self) -> None:
        if self.remembered < 1:
            raise ConfigError(f"odometry: remembered={self.remembered} must be at least 1")
        if not self.keep_m > 0.0:
            raise ConfigError(f"odometry: keep_m={self.keep_m} must be positive")


@dataclass(frozen=True)
class Step:
    """The pose of one image.

    Args:
        state: "first", "tracked", "doubtful" (pose accepted, but contradicting points are many), "relocalised",
            "lost" (the pose is the last known one) or "restarted" (a new reference starts at the last known pose).
        T_start_camera: The camera in the frame of the first image.
        motion: T_reference_camera.
        covariance: (6, 6) of `motion`, axes of the reference, m and rad.
        reference: Number of the image it is aligned with.
        aligned: The alignment; None for the first image and lost ones.
    """

    state: str
    T_start_camera: Pose3
    motion: Pose3
    covariance: Float[np.ndarray, "6 6"]
    reference: int
    aligned: Alignment | None = None


@dataclass(frozen=True, eq=False)
class Reference:
    """An image that later images are aligned with."""

    number: int
    image: Pyramid | CompressedImage
    T_start_camera: Pose3

    @property
    def pyramid(self) -> Pyramid:
        """The image pyramid, decompressed if necessary."""
        return self.image if isinstance(self.image, Pyramid) else self.image.pyramid()


class Odometry:
    """Estimates the camera's trajectory image by image."""

    def __init__(
        self, config: OdometryConfig | None = None, align: AlignConfig | None = None
    ) -> None:
        self.config = config or OdometryConfig()
        self._align_config = align or AlignConfig()
        self.references: list[Reference] = []
        self.losses = 0
        self._count = 0
        self._pose = Pose3()
        self._velocity = Pose3()
        self._before: Reference | None = None  # the previous image, if its pose is known
        self._lost = 0  # lost images in a row
        self._next = 0  # reference that the search for a lost camera tries next
        aligner(self.config.aligner)  # refuses an unknown name

    @property
    def _align(self) -> Aligner:
        return aligner(self.config.aligner)

    def track(self, image: Pyramid) -> Step:
        """Estimate the pose of the next image."""
        number = self._count
        self._count += 1
        if not self.references:
            return self._begin(number, image)
        reference = self.references[-1]
        aligned = self._align_from_motion(reference, image)
        if not self._acceptable(aligned) and self._before is not None:
            reference = self._set_reference(self._before)
            aligned = self._align_from_motion(reference, image)
        state = TRACKED
        if not self._acceptable(aligned):
            found = self._relocalise(image)
            if found is None:
                return self._lose(number, image)
            reference, aligned = found
            state = RELOCALISED
        assert aligned is not None
        return self._accept(number, image, reference, aligned, state)

    def _begin(self, number: int, image: Pyramid) -> Step:
        self._set_reference(Reference(number, image, self._pose))
        return Step(FIRST, self._pose, Pose3(), np.zeros((6, 6)), number)

    def _accept(
        self, number: int, image: Pyramid, reference: Reference, aligned: Alignment, state: str
    ) -> Step:
        """Take over the pose, and make the image the reference if too little of the old one is in view."""
        pose = reference.T_start_camera @ aligned.motion
        tracked = state == TRACKED and self._before is not None
        self._lost = 0
        covariance = aligned.covariance
        if state == TRACKED and aligned.contradicting > DOUBTFUL_CONTRADICTING:
            state, covariance = DOUBTFUL, covariance * DOUBTFUL_FACTOR
        self._velocity = self._pose.inverse() @ pose if tracked else Pose3()
        self._pose = pose
        self._before = here = Reference(number, image, pose)
        far = float(np.linalg.norm(aligned.motion.position)) > self.config.keep_m
        if far or aligned.visible < KEEP_VISIBLE or state == RELOCALISED:
            known = (
                self._earlier_reference(pose, image)
                if state == TRACKED and self.config.reuse
                else None
            )
            if known is not None:
                reference, aligned = known
                self._pose = pose = reference.T_start_camera @ aligned.motion
                self._before = Reference(number, image, pose)
                return Step(
                    state, pose, aligned.motion, aligned.covariance, reference.number, aligned
                )
            self._set_reference(here)
        return Step(state, pose, aligned.motion, covariance, reference.number, aligned)

    def _earlier_reference(self, pose: Pose3, image: Pyramid) -> tuple[Reference, Alignment] | None:
        """An earlier reference with the same view, made the current one, and the alignment; None if there is none."""
        keep_m = self.config.keep_m
        best, nearest = None, 1.0
        for reference in self.references[:-1]:
            there = reference.T_start_camera
            away = float(np.linalg.norm(there.position - pose.position)) / keep_m
            ahead = float(np.clip(there.rotation[:, 2] @ pose.rotation[:, 2], -1.0, 1.0))
            away += math.degrees(math.acos(ahead)) / REUSE_TURN_DEG
            if away < nearest:
                best, nearest = reference, away
        if best is None:
            return None
        pyramid = best.pyramid
        start = best.T_start_camera.inverse() @ pose
        aligned = self._align(pyramid, image, [start], self._align_config)
        if aligned is None or not self._sure(aligned) or aligned.visible < REUSE_VISIBLE:
            return None
        if float(np.linalg.norm(aligned.motion.position - start.position)) > keep_m:
            return None
        self.references.remove(best)
        return self._set_reference(Reference(best.number, pyramid, best.T_start_camera)), aligned

    def _lose(self, number: int, image: Pyramid) -> Step:
        """Report a loss. The pose stays the last known one; after several losses a new reference starts there."""
        self.losses += 1
        self._lost += 1
        self._velocity, self._before = Pose3(), None
        unknown = np.eye(6)
        reference = self.references[-1]
        motion = reference.T_start_camera.inverse() @ self._pose
        if self._lost < self.config.give_up:
            return Step(LOST, self._pose, motion, unknown, reference.number)
        self._lost = 0
        self._before = self._set_reference(Reference(number, image, self._pose))
        return Step(RESTARTED, self._pose, motion, unknown, reference.number)

    def _set_reference(self, reference: Reference) -> Reference:
        """Align later images with this one."""
        for old in self.references[-1:]:  # earlier ones are compressed already
            if isinstance(old.image, Pyramid):
                self.references[-1] = Reference(old.number, compress(old.image), old.T_start_camera)
        self.references.append(reference)
        if len(self.references) > self.config.remembered:  # drop every other one of the old half
            half = len(self.references) // 2
            self.references = self.references[:half:2] + self.references[half:]
        return reference

    def _align_from_motion(self, reference: Reference, image: Pyramid) -> Alignment | None:
        """Align from constant velocity and from rest; if that is poor, from rotated initial poses too.

        An alignment that fits stays unless a distinct one explains the images better.
        """
        last = reference.T_start_camera.inverse() @ self._pose
        moving = last @ self._velocity
        starts = [moving, last]
        pyramid = reference.pyramid
        aligned = self._align(pyramid, image, starts, self._align_config)
        if aligned is not None and self._sure(aligned):
            jump = aligned.motion.position - moving.position
            if float(np.linalg.norm(jump)) <= SURE_JUMP_M:
                return aligned
        for around in (last, moving):
            starts += rotation_starts(pyramid, around)
        other = self._align(pyramid, image, starts, self._align_config)
        if aligned is None or other is None:
            return aligned or other
        if self._fits(aligned) and not same(aligned.motion.matrix, other.motion.matrix):
            found, kept = other.motion, aligned.motion
            better = explains_better(pyramid, image, found, kept, self._align_config)
        else:
            better = other.overlap > aligned.overlap
        return other if better else aligned

    def _relocalise(self, image: Pyramid) -> tuple[Reference, Alignment] | None:
        """The first reliable alignment with the latest reference or some of the others, in turn."""
        latest, others = self.references[-1], self.references[:-1]
        order = [(self._next + n) % len(others) for n in range(min(SEARCHED, len(others)))]
        self._next += len(order)
        for reference in [latest, *(others[-1 - n] for n in order)]:
            pyramid = reference.pyramid
            starts = [Pose3(), *rotation_starts(pyramid, Pose3())]
            aligned = self._align(pyramid, image, starts, self._align_config)
            if aligned is not None and self._sure(aligned):
                return reference, aligned
        return None

    def _sure(self, aligned: Alignment | None) -> bool:
        return (
            self._acceptable(aligned)
            and aligned is not None
            and self._fits(aligned)
            and aligned.visible >= SURE_VISIBLE
        )

    def _fits(self, aligned: Alignment) -> bool:
        return aligned.fitting >= SURE_FITTING and aligned.contradicting <= SURE_CONTRADICTING

    def _acceptable(self, aligned: Alignment | None) -> bool:
        return (
            aligned is not None
            and aligned.fitting >= LEAST_FITTING
            and aligned.contradicting <= MOST_CONTRADICTING
            and float(np.linalg.eigvalsh(aligned.covariance[:3, :3])[-1]) <= MOST_SIGMA_M**2
        )
