"""Pose graph of an RGB-D trajectory: odometry steps, floors and loop closures.

Only references are variables; every other image hangs on its reference by its own step. A new reference is
compared with references whose view it should share and with those of similar appearance. An alignment that
fits becomes a loop closure, with a robust loss against false ones.

Source: Kümmerle et al. 2011 (pose graph); robust loss and gate as in `smoothing.smoother`; seed 004 (features).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ..floor.levelling import camera_above_floor
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..smoothing.factors import Factor, FloorSeen, LoopClosure, Motion, Placement
from ..smoothing.smoother import Solution, solve
from .alignment import AlignConfig, Alignment, align
from .odometry import FIRST, LOST, RESTARTED, Step
from .place_recognition import Place, PlacesConfig, describe, motion_between, similarity
from .pose_uncertainty import AttachedImage, PoseUncertainty, pose_uncertainty
from .pyramid import Pyramid
from .view_errors import view_error_covariances

ANCHOR_M = 1e-4  # the first pose defines the world frame and is no unknown
ANCHOR_RAD = 1e-4


NEAR_M = 1.0  # ours: references this close ...
NEAR_DEG = 40.0  # ours: ... with this difference of view share most of it
NEIGHBOURS = 3  # ours: number of close references compared
ALIKE = 1  # ours: number of references of similar appearance compared
LEAST_ALIKE = 0.15  # ours: share of features with a close match
LEAST_FITTING = 0.85  # ours: share of inliers of a loop closure
MOST_CONTRADICTING = 0.03  # ours
LEAST_VISIBLE = 0.35  # ours: a smaller overlap may be a single edge
FLOOR_FACTOR = 10.0  # ours: floor errors are correlated over about ten images


def world_by_floor(step: Step, image: Pyramid) -> Pose3 | None:
    """The first image in the upright world that an image's floor defines; None without a floor or a known pose."""
    if image.floor is None or step.state in (LOST, RESTARTED):
        return None
    return camera_above_floor(image.floor) @ step.T_start_camera.inverse()


@dataclass(frozen=True)
class BackEndConfig:
    """Place recognition."""

    places: PlacesConfig = field(default_factory=PlacesConfig)


class BackEnd:
    """Collects the steps of an odometry and optimises the trajectory with loop closures."""

    def __init__(
        self,
        rng: np.random.Generator,
        config: BackEndConfig | None = None,
        align: AlignConfig | None = None,
    ) -> None:
        self.config = config or BackEndConfig()
        self._align_config = align or AlignConfig()
        self.factors: list[Factor] = []
        self.places: list[Place] = []
        self.closures = 0
        self._rng = rng
        self._steps: list[Step] = []
        self._at: dict[int, Pose3] = {}  # poses of references by odometry
        self._T_world_start: Pose3 | None = None
        self._floors: dict[int, Plane] = {}

    @property
    def T_world_start(self) -> Pose3:
        """The first image in the upright world of the first floor; identity before a floor is found."""
        return self._T_world_start or Pose3()

    def take(self, step: Step, image: Pyramid, is_reference: bool) -> None:
        """Add the step of the next image; `is_reference` if later images are aligned with it."""
        number = len(self._steps)
        self._steps.append(step)
        self._T_world_start = self._T_world_start or world_by_floor(step, image)
        if number > 0:
            self._hold(step.reference)
        if not is_reference:
            return
        if step.state != FIRST:
            self.factors.append(Motion(step.reference, number, step.motion, step.covariance))
        if image.floor is not None:
            self._floors[number] = image.floor
        self._at[number] = step.T_start_camera
        place = describe(number, image, self.config.places)
        self._close(place, image, step)
        self.places.append(place)

    def _hold(self, number: int) -> None:
        """Add an image to the graph that became a reference only when the next one could not be aligned."""
        if number in self._at:
            return
        step = self._steps[number]
        self._at[number] = step.T_start_camera
        self.factors.append(Motion(step.reference, number, step.motion, step.covariance))

    def solve(self) -> Solution | None:
        """Poses of all references in the upright world; None if there is only one."""
        floors = self._floor_factors()
        if not any(isinstance(factor, Motion) for factor in self.factors):
            return None
        firm = np.diag([ANCHOR_M**2] * 3 + [ANCHOR_RAD**2] * 3)
        if floors:  # floors determine height, roll and pitch; the start the rest
            firm[2, 2], firm[3, 3], firm[4, 4] = 0.1**2, 0.1**2, 0.1**2
        start = Placement(self.T_world_start @ self._at[self.places[0].number], firm)
        return solve([*self.factors, *floors], start, ())

    def trajectory(self, solution: Solution | None) -> list[Pose3]:
        """T_world_camera of every image; the last known pose for lost ones."""
        poses = []
        for number, step in enumerate(self._steps):
            if solution is None:
                poses.append(self.T_world_start @ step.T_start_camera)
                continue
            own = solution.poses.get(number)
            anchor = own or solution.poses[step.reference]
            assert isinstance(anchor, Placement)
            poses.append(anchor.pose if own is not None else anchor.pose @ step.motion)
        return poses

    def uncertainty(
        self, solution: Solution | None, of_view: Float[np.ndarray, "6 6"]
    ) -> PoseUncertainty | None:
        """Covariance of every pose of `trajectory`; NaN for lost and restarted images, None without two poses.

        Args:
            solution: Of the pose graph.
            of_view: Covariance of one image's view error, see `view_errors`.
        """
        if sum(step.state not in (LOST, RESTARTED) for step in self._steps) < 2:
            return None
        kept: list[Factor] = []
        if solution is None:  # every image is attached to the first one
            poses = {n: self.T_world_start @ pose for n, pose in self._at.items()}
        else:
            rejected = {id(factor) for factor in solution.rejected}
            kept = [one for one in self.factors if id(one) not in rejected]
            kept += self._floor_factors()
            poses = {n: one.pose for n, one in solution.poses.items() if isinstance(one, Placement)}
        images, placed = [], []
        for number, (step, pose) in enumerate(
            zip(self._steps, self.trajectory(solution), strict=True)
        ):
            if step.state in (LOST, RESTARTED):
                continue
            own = number in poses
            covariance = np.zeros((6, 6)) if own else step.covariance
            images.append(AttachedImage(pose, number if own else step.reference, covariance))
            placed.append(number)
        found = pose_uncertainty(kept, poses, images)
        views = view_error_covariances(
            np.array([one.pose.position for one in images]),
            np.array([one.pose.rotation for one in images]),
            of_view,
        )
        whole = np.full((2, len(self._steps), 6, 6), np.nan)
        whole[0, placed] = found.from_start + views.from_start
        whole[1, placed] = found.aligned + views.aligned
        return PoseUncertainty(whole[0], whole[1])

    def _floor_factors(self) -> list[FloorSeen]:
        return [
            FloorSeen(number, replace(plane, covariance=FLOOR_FACTOR * plane.covariance))
            for number, plane in sorted(self._floors.items())
        ]

    def _close(self, place: Place, image: Pyramid, step: Step) -> None:
        """Look for loop closures of a new place."""
        here = self._at[place.number]
        tried = {step.reference}
        for other in self._near(here, tried):
            tried.add(other.number)
            start = self._at[other.number].inverse() @ here
            self._verify(other, place, image, [start], True)
        for other in self._similar(place, tried):
            start_by_features = motion_between(other, place, self._rng, self.config.places)
            if start_by_features is not None:
                self._verify(other, place, image, [start_by_features], False)

    def _near(self, here: Pose3, tried: set[int]) -> Sequence[Place]:
        """Places whose view this one should share, by odometry."""
        found = []
        for place in self.places:
            if place.number in tried:
                continue
            there = self._at[place.number]
            away = float(np.linalg.norm(there.position - here.position)) / NEAR_M
            turn = float(np.clip(there.rotation[:, 2] @ here.rotation[:, 2], -1.0, 1.0))
            off = math.degrees(math.acos(turn)) / NEAR_DEG
            if away < 1.0 and off < 1.0:
                found.append((away + off, place.number, place))
        return [place for _, _, place in sorted(found, key=lambda one: one[:2])[:NEIGHBOURS]]

    def _similar(self, place: Place, tried: set[int]) -> Sequence[Place]:
        """Places of similar appearance."""
        scores = [
            (-similarity(place, other), other.number, other)
            for other in self.places
            if other.number not in tried
        ]
        good = [one for one in scores if -one[0] >= LEAST_ALIKE]
        return [other for _, _, other in sorted(good, key=lambda one: one[:2])[:ALIKE]]

    def _verify(
        self, other: Place, place: Place, image: Pyramid, starts: Sequence[Pose3], near: bool
    ) -> None:
        """Align the two places; a good alignment becomes a loop closure."""
        aligned = align(other.image.pyramid(), image, starts, self._align_config)
        if aligned is None or not self._acceptable(aligned):
            return
        if near:
            moved = starts[0].inverse() @ aligned.motion
            if float(np.linalg.norm(moved.position)) > NEAR_M:
                return
        self.closures += 1
        self.factors.append(
            LoopClosure(other.number, place.number, aligned.motion, aligned.covariance)
        )

    def _acceptable(self, aligned: Alignment) -> bool:
        return (
            aligned.fitting >= LEAST_FITTING
            and aligned.contradicting <= MOST_CONTRADICTING
            and aligned.visible >= LEAST_VISIBLE
        )
