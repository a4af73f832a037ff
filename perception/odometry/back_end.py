"""The way as a whole: steps, floors, and places seen again, joined in one graph.

Only references are variables; an image between them hangs on its reference by its own step. A new reference
is compared with references that should be in view of it, and with those whose pictures look alike;
what lies over one of them becomes a loop closure, with a loss that lets false ones go.

Source: Kümmerle et al. 2011 (pose graph); robust loss and gate as in `localisation.smoother`; seed 004
(features).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ..floor.levelling import camera_above_floor
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..smoothing.factors import Factor, FloorSeen, LoopClosure, Motion, Placement
from ..smoothing.smoother import SmootherConfig, Solution, solve
from .alignment import AlignConfig, Aligned, align
from .odometry import FIRST, LOST, RESTARTED, Step
from .place_recognition import Place, PlacesConfig, likeness, motion_between, remember
from .pose_uncertainty import Claims, Hung, claims
from .pyramid import Pyramid

ANCHOR_M = 1e-4  # the start is where the world begins: nothing is to be found out about it
ANCHOR_RAD = 1e-4


@dataclass(frozen=True)
class BackEndConfig:
    """Which places are compared, and what is believed of them."""

    align: AlignConfig = field(default_factory=AlignConfig)
    places: PlacesConfig = field(default_factory=PlacesConfig)
    smoother: SmootherConfig = field(default_factory=SmootherConfig)
    near_m: float = 1.0  # ours: references so near ...
    near_deg: float = 40.0  # ours: ... that look the same way, share most of their view
    neighbours: int = 3  # ours: so many of them are compared
    alike: int = 1  # ours: so many by their pictures
    least_alike: float = 0.15  # ours: share of features with a near twin
    least_fitting: float = 0.85  # ours: what lies over each other fits
    most_contradicting: float = 0.03  # ours
    least_visible: float = 0.35  # ours: less in common is a ledge, not a place
    floor_factor: float = 10.0  # ours: floors of one recording err alike, by about so many images
    floors: bool = True
    image_m: float = 0.005  # ours: what an image distorts moves its pose so far, see `claims`
    image_deg: float = 0.5  # ours: likewise

    def __post_init__(self) -> None:
        for name in ("image_m", "image_deg"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"back end: {name}={value} must be finite and not negative")
        for name in ("least_fitting", "most_contradicting", "least_visible", "least_alike"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"back end: {name}={getattr(self, name)} must lie in [0, 1]")
        if not (self.near_m > 0.0 and self.near_deg > 0.0 and self.floor_factor > 0.0):
            raise ConfigError("back end: near_m, near_deg and floor_factor must be positive")
        if self.neighbours < 0 or self.alike < 0:
            raise ConfigError(
                f"back end: neighbours={self.neighbours} and alike={self.alike} must not be negative"
            )

    @property
    def distortion(self) -> Float[np.ndarray, "6 6"]:
        """Covariance of (x, y, z, rotation vector) by what an image distorts, any axes."""
        return np.diag([self.image_m**2] * 3 + [math.radians(self.image_deg) ** 2] * 3)


class BackEnd:
    """Takes the steps of an odometry, and tells the way they make together with the loops."""

    def __init__(self, rng: np.random.Generator, config: BackEndConfig | None = None) -> None:
        self.config = config or BackEndConfig()
        self.factors: list[Factor] = []
        self.places: list[Place] = []
        self.closures = 0
        self._rng = rng
        self._steps: list[Step] = []
        self._at: dict[int, Pose3] = {}  # references as odometry has them
        self._T_world_start: Pose3 | None = None
        self._floors: dict[int, Plane] = {}

    @property
    def T_world_start(self) -> Pose3:
        """The upright world by the first floor that was seen; the first image's axes before."""
        return self._T_world_start or Pose3()

    def take(self, step: Step, image: Pyramid, is_reference: bool) -> None:
        """The next image's step; whether others will be laid over it from now on."""
        number = len(self._steps)
        self._steps.append(step)
        placed = step.state not in (LOST, RESTARTED)
        if image.floor is not None and self._T_world_start is None and placed:
            self._T_world_start = camera_above_floor(image.floor) @ step.T_start_camera.inverse()
        if not is_reference:
            return
        if step.state != FIRST:
            self.factors.append(Motion(step.reference, number, step.motion, step.covariance))
        if image.floor is not None and self.config.floors:
            self._floors[number] = image.floor
        self._at[number] = step.T_start_camera
        place = remember(number, image, self.config.places)
        self._close(place, image, step)
        self.places.append(place)

    def solve(self) -> Solution | None:
        """All references, upright world; None while there is but one."""
        floors = self._floor_factors()
        if not any(isinstance(factor, Motion) for factor in self.factors):
            return None
        firm = np.diag([ANCHOR_M**2] * 3 + [ANCHOR_RAD**2] * 3)
        if floors:  # they say what is up and how high; the start says where and which way
            firm[2, 2], firm[3, 3], firm[4, 4] = 0.1**2, 0.1**2, 0.1**2
        start = Placement(self.T_world_start @ self._at[self.places[0].number], firm)
        return solve([*self.factors, *floors], start, (), self.config.smoother)

    def trajectory(self, solution: Solution | None) -> list[Pose3]:
        """T_world_camera of every image, lost ones at their last pose."""
        way = []
        for number, step in enumerate(self._steps):
            if solution is None:
                way.append(self.T_world_start @ step.T_start_camera)
                continue
            own = solution.poses.get(number)
            anchor = own or solution.poses[step.reference]
            assert isinstance(anchor, Placement)
            way.append(anchor.pose if own is not None else anchor.pose @ step.motion)
        return way

    def claims(self, solution: Solution | None) -> Claims | None:
        """How far each image of `trajectory` that was placed may be off; None without a solution.

        Lost and restarted images have NaN: nobody claims anything of them.
        """
        if solution is None:
            return None
        out = {id(factor) for factor in solution.rejected}
        kept = [one for one in self.factors if id(one) not in out] + self._floor_factors()
        poses = {n: one.pose for n, one in solution.poses.items() if isinstance(one, Placement)}
        way, placed = [], []
        distortion = self.config.distortion
        for number, (step, pose) in enumerate(
            zip(self._steps, self.trajectory(solution), strict=True)
        ):
            if step.state in (LOST, RESTARTED):
                continue
            own = number in poses
            known = number if own else step.reference
            way.append(Hung(pose, known, distortion if own else distortion + step.covariance))
            placed.append(number)
        told = claims(kept, poses, way)
        whole = np.full((2, len(self._steps), 6, 6), np.nan)
        whole[0, placed], whole[1, placed] = told.from_start, told.aligned
        return Claims(whole[0], whole[1])

    def _floor_factors(self) -> list[FloorSeen]:
        factor = self.config.floor_factor
        return [
            FloorSeen(number, replace(plane, covariance=factor * plane.covariance))
            for number, plane in sorted(self._floors.items())
        ]

    def _close(self, place: Place, image: Pyramid, step: Step) -> None:
        """Compare a new place with those it may have seen before."""
        here = self._at[place.number]
        tried = {step.reference}
        for other in self._near(here, tried):
            tried.add(other.number)
            start = self._at[other.number].inverse() @ here
            self._verify(other, place, image, [start], True)
        for other in self._alike(place, tried):
            start_by_features = motion_between(other, place, self._rng, self.config.places)
            if start_by_features is not None:
                self._verify(other, place, image, [start_by_features], False)

    def _near(self, here: Pose3, tried: set[int]) -> Sequence[Place]:
        """Places whose view this one should share, by odometry."""
        c = self.config
        found = []
        for place in self.places:
            if place.number in tried:
                continue
            there = self._at[place.number]
            away = float(np.linalg.norm(there.position - here.position)) / c.near_m
            turn = float(np.clip(there.rotation[:, 2] @ here.rotation[:, 2], -1.0, 1.0))
            off = math.degrees(math.acos(turn)) / c.near_deg
            if away < 1.0 and off < 1.0:
                found.append((away + off, place.number, place))
        return [place for _, _, place in sorted(found, key=lambda one: one[:2])[: c.neighbours]]

    def _alike(self, place: Place, tried: set[int]) -> Sequence[Place]:
        """Places whose pictures look like this one's."""
        c = self.config
        scores = [
            (-likeness(place, other), other.number, other)
            for other in self.places
            if other.number not in tried
        ]
        good = [one for one in scores if -one[0] >= c.least_alike]
        return [other for _, _, other in sorted(good, key=lambda one: one[:2])[: c.alike]]

    def _verify(
        self, other: Place, place: Place, image: Pyramid, starts: Sequence[Pose3], near: bool
    ) -> None:
        """Lay one over the other; believe what fits."""
        aligned = align(other.image.pyramid(), image, starts, self.config.align)
        if aligned is None or not self._believed(aligned):
            return
        if near:
            moved = starts[0].inverse() @ aligned.motion
            if float(np.linalg.norm(moved.position)) > self.config.near_m:
                return
        self.closures += 1
        self.factors.append(
            LoopClosure(other.number, place.number, aligned.motion, aligned.covariance)
        )

    def _believed(self, aligned: Aligned) -> bool:
        c = self.config
        return (
            aligned.fitting >= c.least_fitting
            and aligned.contradicting <= c.most_contradicting
            and aligned.visible >= c.least_visible
        )
