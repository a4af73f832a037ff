"""How the camera moves from image to image, and when nobody can tell.

Each image is laid over the latest reference image as long as enough of it is in view; then it becomes the
reference itself, so errors add up per reference and not per image. A step that fits badly is tried again
from many starts. What fits badly even then is a loss: it is said, and the camera is looked for among the
references it has left behind.

Source: keyframes after Kerl et al., DVO (2013); judgement by overlap off the floor is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .alignment import AlignConfig, Aligned
from .baselines import aligner
from .hypotheses import HypothesesConfig, large_steps
from .pyramid import Kept, Pyramid, keep

FIRST, TRACKED, DOUBTFUL, RELOCALISED = "first", "tracked", "doubtful", "relocalised"
LOST, RESTARTED = "lost", "restarted"


@dataclass(frozen=True)
class OdometryConfig:
    """When an alignment is believed, and when the reference changes."""

    engine: str = "surefoot"  # or one of `peers`
    align: AlignConfig = field(default_factory=AlignConfig)
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    sure_fitting: float = 0.93  # ours: less of the points fits: other starts are tried
    sure_contradicting: float = 0.02  # ours: more of them contradict: likewise
    sure_visible: float = 0.80  # ours: less in view was a large step: likewise
    least_fitting: float = 0.70  # ours: less, and the camera is lost
    most_contradicting: float = 0.10  # ours: more, and it is lost
    most_sigma_m: float = 0.05  # ours: less sure than that of a step is no step
    keep_visible: float = 0.80  # ours: the reference serves while so much is in view of it
    keep_m: float = 0.30  # ours: and no farther: planes look different from elsewhere
    doubtful_contradicting: float = 0.03  # ours: from here on the step is told as doubtful
    doubtful_factor: float = 25.0  # ours: and its covariance so many times as large
    searched: int = 10  # ours: references tried per lost image; they take turns
    give_up: int = 10  # ours: images lost in a row; then a new reference begins where the last was
    reuse: bool = (
        False  # known views serve again: no new reference, no drift; a graph wants closures instead
    )
    reuse_visible: float = 0.85  # ours: so much of the image in a view that is known serves
    reuse_turn_deg: float = 12.0  # ours: a fifth of the view, as keep_visible
    remembered: int = 200  # ours: references kept to find a lost camera; the memory stays bounded

    def __post_init__(self) -> None:
        for name in (
            "sure_fitting", "sure_contradicting", "sure_visible", "least_fitting",
            "most_contradicting", "keep_visible", "doubtful_contradicting", "reuse_visible",
        ):  # fmt: skip
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"odometry: {name}={getattr(self, name)} must lie in [0, 1]")
        if self.remembered < 1:
            raise ConfigError(f"odometry: remembered={self.remembered} must be at least 1")
        if not self.most_sigma_m > 0.0 or not self.keep_m > 0.0:
            raise ConfigError(
                f"odometry: most_sigma_m={self.most_sigma_m} and keep_m={self.keep_m} must be positive"
            )


@dataclass(frozen=True)
class Step:
    """One image, placed.

    Args:
        state: "first", "tracked", "doubtful" (placed, but something speaks against it), "relocalised", "lost"
            (the pose is only the last one), or "restarted": given up, begun anew from the last pose.
        T_start_camera: The camera in the axes of the first image.
        motion: T_reference_camera.
        covariance: (6, 6) of `motion`, axes of the reference, m and rad.
        reference: Number of the image that it was laid over.
        aligned: What speaks for it; None for the first image and a lost one.
    """

    state: str
    T_start_camera: Pose3
    motion: Pose3
    covariance: Float[np.ndarray, "6 6"]
    reference: int
    aligned: Aligned | None = None


@dataclass(frozen=True, eq=False)
class Reference:
    """An image that others are laid over."""

    number: int
    image: Pyramid | Kept
    T_start_camera: Pose3

    @property
    def pyramid(self) -> Pyramid:
        """Ready for use."""
        return self.image if isinstance(self.image, Pyramid) else self.image.pyramid()


class Odometry:
    """The camera's way, image by image."""

    def __init__(self, config: OdometryConfig | None = None) -> None:
        self.config = config or OdometryConfig()
        self.references: list[Reference] = []
        self.losses = 0
        self.relocalisations = 0
        self._count = 0
        self._pose = Pose3()
        self._velocity = Pose3()
        self._before: Reference | None = None  # the image before this one, if it was placed
        self._lost = 0  # images in a row
        self._turn = 0  # whose turn it is among the references, when lost
        self._align = aligner(self.config.engine)

    def track(self, image: Pyramid) -> Step:
        """Place the next image."""
        number = self._count
        self._count += 1
        if not self.references:
            return self._begin(number, image)
        reference = self.references[-1]
        aligned = self._follow(reference, image)
        if not self._believed(aligned) and self._before is not None:
            reference = self._refer(self._before)
            aligned = self._follow(reference, image)
        state = TRACKED
        if not self._believed(aligned):
            found = self._search(image)
            if found is None:
                return self._lose(number, image)
            reference, aligned = found
            state = RELOCALISED
            self.relocalisations += 1
        assert aligned is not None
        return self._place(number, image, reference, aligned, state)

    def _begin(self, number: int, image: Pyramid) -> Step:
        self._refer(Reference(number, image, self._pose))
        return Step(FIRST, self._pose, Pose3(), np.zeros((6, 6)), number)

    def _place(
        self, number: int, image: Pyramid, reference: Reference, aligned: Aligned, state: str
    ) -> Step:
        """Believe it, and make it the reference if too little of the old one is in view."""
        pose = reference.T_start_camera @ aligned.motion
        tracked = state == TRACKED and self._before is not None
        self._lost = 0
        covariance = aligned.covariance
        if state == TRACKED and aligned.contradicting > self.config.doubtful_contradicting:
            state, covariance = DOUBTFUL, covariance * self.config.doubtful_factor
        self._velocity = self._pose.inverse() @ pose if tracked else Pose3()
        self._pose = pose
        self._before = here = Reference(number, image, pose)
        far = float(np.linalg.norm(aligned.motion.position)) > self.config.keep_m
        if far or aligned.visible < self.config.keep_visible or state == RELOCALISED:
            known = self._known(pose, image) if state == TRACKED and self.config.reuse else None
            if known is not None:
                reference, aligned = known
                self._pose = pose = reference.T_start_camera @ aligned.motion
                self._before = Reference(number, image, pose)
                return Step(
                    state, pose, aligned.motion, aligned.covariance, reference.number, aligned
                )
            self._refer(here)
        return Step(state, pose, aligned.motion, covariance, reference.number, aligned)

    def _known(self, pose: Pose3, image: Pyramid) -> tuple[Reference, Aligned] | None:
        """A reference of before that sees what this image sees, made the current one; None if none does."""
        c = self.config
        best, nearest = None, 1.0
        for reference in self.references[:-1]:
            there = reference.T_start_camera
            away = float(np.linalg.norm(there.position - pose.position)) / c.keep_m
            ahead = float(np.clip(there.rotation[:, 2] @ pose.rotation[:, 2], -1.0, 1.0))
            away += math.degrees(math.acos(ahead)) / c.reuse_turn_deg
            if away < nearest:
                best, nearest = reference, away
        if best is None:
            return None
        pyramid = best.pyramid
        start = best.T_start_camera.inverse() @ pose
        aligned = self._align(pyramid, image, [start], c.align)
        if aligned is None or not self._sure(aligned) or aligned.visible < c.reuse_visible:
            return None
        if float(np.linalg.norm(aligned.motion.position - start.position)) > c.keep_m:
            return None
        self.references.remove(best)
        return self._refer(Reference(best.number, pyramid, best.T_start_camera)), aligned

    def _lose(self, number: int, image: Pyramid) -> Step:
        """Say so; the pose stays where it was last known, and after a while is taken for a new start."""
        self.losses += 1
        self._lost += 1
        self._velocity, self._before = Pose3(), None
        unknown = np.eye(6)
        reference = self.references[-1]
        motion = reference.T_start_camera.inverse() @ self._pose
        if self._lost < self.config.give_up:
            return Step(LOST, self._pose, motion, unknown, reference.number)
        self._lost = 0
        self._before = self._refer(Reference(number, image, self._pose))
        return Step(RESTARTED, self._pose, motion, unknown, reference.number)

    def _refer(self, reference: Reference) -> Reference:
        """Lay what comes over this image from now on."""
        for old in self.references[-1:]:  # the others have been put away before
            if isinstance(old.image, Pyramid):
                self.references[-1] = Reference(old.number, keep(old.image), old.T_start_camera)
        self.references.append(reference)
        if len(self.references) > self.config.remembered:  # thin out the old half, keep its ends
            half = len(self.references) // 2
            self.references = self.references[:half:2] + self.references[half:]
        return reference

    def _follow(self, reference: Reference, image: Pyramid) -> Aligned | None:
        """By constant velocity or rest; from many starts if that fits badly."""
        last = reference.T_start_camera.inverse() @ self._pose
        moving = last @ self._velocity
        starts = [moving, last]
        pyramid = reference.pyramid
        aligned = self._align(pyramid, image, starts, self.config.align)
        if self._sure(aligned):
            return aligned
        for around in (last, moving):
            starts += large_steps(pyramid, around, self.config.hypotheses)
        other = self._align(pyramid, image, starts, self.config.align)
        if other is None or (aligned is not None and aligned.overlap >= other.overlap):
            return aligned
        return other

    def _search(self, image: Pyramid) -> tuple[Reference, Aligned] | None:
        """Among the references, the latest and some others in turn, the first one that is believed."""
        latest, others = self.references[-1], self.references[:-1]
        turn = [
            (self._turn + n) % len(others) for n in range(min(self.config.searched, len(others)))
        ]
        self._turn += len(turn)
        for reference in [latest, *(others[-1 - n] for n in turn)]:
            pyramid = reference.pyramid
            starts = [Pose3(), *large_steps(pyramid, Pose3(), self.config.hypotheses)]
            aligned = self._align(pyramid, image, starts, self.config.align)
            if aligned is not None and self._sure(aligned):
                return reference, aligned
        return None

    def _sure(self, aligned: Aligned | None) -> bool:
        c = self.config
        return (
            self._believed(aligned)
            and aligned is not None
            and aligned.fitting >= c.sure_fitting
            and aligned.contradicting <= c.sure_contradicting
            and aligned.visible >= c.sure_visible
        )

    def _believed(self, aligned: Aligned | None) -> bool:
        c = self.config
        return (
            aligned is not None
            and aligned.fitting >= c.least_fitting
            and aligned.contradicting <= c.most_contradicting
            and float(np.linalg.eigvalsh(aligned.covariance[:3, :3])[-1]) <= c.most_sigma_m**2
        )
