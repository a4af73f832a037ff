"""Localisers put to the test on one walk: what each believed, beside what was so.

All walk the same walk at once. Faults are made in what one of them is told, never in the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import nees
from perception.floor.segmented_view import SegmentedView, visibility
from perception.localisation.filter import PoseFilter
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.static_points import static_points
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives.frame import StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.smoothing.fixed_lag import smooth_fixed_lag
from perception.smoothing.walk_factors import Instant, walk_factors, walk_systematics
from sim.truth import ObstacleTruth

from ...config.schema import Config
from ...run.simulate import START_COVARIANCE
from .localisation_walk import WalkInstant

HERE_COVARIANCE = np.diag(np.square([0.001, 0.001, math.radians(0.05)]))
"""Without markers the start is the origin of the map, by definition; it is only not quite a point."""

MATCH_M = 0.2
"""A track that is seen this near to a mover in sight is of it."""

LATELY_S = 3.0
"""What was in sight within this time ought to be known."""

KNEE_M, REACH_M = 0.15, 2.7
"""Height at which a mover is looked for, and how far, by truth."""

BELIEVED = 0.5
"""Probability of moving above which a track counts as a mover."""

Fault = Callable[[WalkInstant], WalkInstant]


@dataclass
class Trial:
    """One localiser on its way.

    Args:
        walker: It.
        landmarks, registration: Whether it is told of them.
        fault: What happens to what it is told.
    """

    walker: LeggedLocaliser
    landmarks: bool = True
    registration: bool = True
    fault: Fault = field(default=lambda moment: moment)
    errors: list[np.ndarray] = field(default_factory=list)
    covariances: list[np.ndarray] = field(default_factory=list)
    in_view: list[bool] = field(default_factory=list)
    told: list[Instant] = field(default_factory=list)
    poses: list[Pose2] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.start = self.walker.pose

    def step(self, moment: WalkInstant, movers: list[Obstacle]) -> None:
        """Take in one instant, and write down the error."""
        told = self.fault(moment)
        self.walker.update(told.frame, told.sightings if self.landmarks else [])
        if self.registration and told.views:
            placed = [at_pose(view, self.walker.pose) for view in told.views]
            self.walker.register([static_points(view, movers) for view in placed])
        pose = self.walker.pose
        error = pose.mean - told.pose.vector
        error[2] = wrap_angle(float(error[2]))
        self.errors.append(error)
        self.covariances.append(pose.covariance)
        self.in_view.append(bool(told.sightings))
        frame, sightings = told.frame, told.sightings if self.landmarks else []
        self.told.append(Instant(frame.stamp_s, frame.odometry, frame.imu, sightings))
        self.poses.append(told.pose)

    @property
    def nees(self) -> Float[np.ndarray, "n"]:
        """Of every instant, per degree of freedom: 1 if consistent."""
        return nees(np.array(self.errors), np.array(self.covariances)) / 3.0

    @property
    def position_m(self) -> Float[np.ndarray, "n"]:
        """Error of every instant."""
        return np.linalg.norm(np.array(self.errors)[:, :2], axis=1)

    @property
    def heading_deg(self) -> Float[np.ndarray, "n"]:
        """Likewise."""
        return np.degrees(np.array(self.errors)[:, 2])


def make_trial(
    start: Pose2,
    marks: tuple[Landmark, ...],
    config: Config,
    rng: np.random.Generator,
    landmarks: bool = True,
    registration: bool = True,
    fault: Fault | None = None,
) -> Trial:
    """A localiser at the start, as unsure of it as it is wrong."""
    covariance = START_COVARIANCE if landmarks else HERE_COVARIANCE
    mean = start.vector + np.sqrt(np.diag(covariance)) * rng.standard_normal(3)
    known = marks if landmarks else ()
    walker = LeggedLocaliser(
        PoseFilter(Gaussian(mean, covariance), known, config.localiser),
        config.prior,
        replace(config.registration, enabled=registration),
    )
    trial = Trial(walker, landmarks, registration)
    return trial if fault is None else replace(trial, fault=fault)


def fixed_lag_errors(
    trial: Trial, marks: tuple[Landmark, ...], config: Config
) -> Float[np.ndarray, "n"]:
    """Position error, m, of every instant as a fixed-lag smoother settles it, told the same but the scans."""
    places = {mark.identity: mark.position[:2] for mark in marks}
    frames = walk_factors(trial.told, places, config.localiser)
    found = smooth_fixed_lag(frames, trial.start, walk_systematics(config.localiser))
    means = np.array([one.mean[:2] for one in found])
    return np.linalg.norm(means - np.array([pose.vector[:2] for pose in trial.poses]), axis=1)


def at_pose(view: SegmentedView, pose: Gaussian) -> SegmentedView:
    """A view in the body frame, placed in the world at a pose."""
    x, y, yaw = (float(v) for v in pose.mean)
    T = Pose2(x, y, yaw).lifted()
    return replace(view, T_map_camera=T @ view.T_map_camera, upright=T.apply(view.upright))


class TrackerTrial:
    """The tracker of moving obstacles at a localiser's poses, and how well it does."""

    def __init__(self, config: Config) -> None:
        self._tracker = ObstacleTracker(config.tracker)
        self.nees: list[float] = []
        """Of tracks on movers that are believed to move, per degree of freedom."""
        self.nees_all: list[float] = []
        """Of all tracks on movers, those taken for furniture among them."""
        self.velocity_mps: list[float] = []
        self.position_m: list[float] = []
        self.places: list[tuple[np.ndarray, np.ndarray]] = []
        """Of each instant: tracks believed to move, and movers, as far as lately in sight; (n, 2), (m, 2)."""
        self._sighted: dict[int, float] = {}
        self._owner: dict[int, int] = {}  # track to mover

    @property
    def obstacles(self) -> list[Obstacle]:
        """Those followed now."""
        return self._tracker.obstacles

    def step(self, moment: WalkInstant, pose: Gaussian) -> None:
        """Take in one instant."""
        stamp = moment.frame.stamp_s
        views = [at_pose(view, pose) for view in moment.views]
        true_views = [at_pose(v, Gaussian(moment.pose.vector, np.eye(3))) for v in moment.views]
        self._tracker.update(stamp, moment.detections, pose, visibility(views))
        tracks = self._tracker.obstacles
        for mover in moment.movers:
            track = self._track_of(
                mover, tracks, stamp, any(is_visible(v, mover) for v in true_views)
            )
            if track is None:
                continue
            error = track.state.mean - np.array(mover[1:5])
            normalised = float(nees(error, track.state.covariance)) / 4.0
            self.nees_all.append(normalised)
            if track.moving > BELIEVED:
                self.nees.append(normalised)
            if track.seen_s == stamp and track.moving > BELIEVED:
                self.position_m.append(float(np.linalg.norm(error[:2])))
                self.velocity_mps.append(float(np.linalg.norm(error[2:])))
        lately = stamp - LATELY_S
        believed = [o.position for o in tracks if o.moving > BELIEVED and o.seen_s >= lately]
        true = [m[1:3] for m in moment.movers if self._sighted.get(m[0], -np.inf) >= lately]
        self.places.append((np.array(believed).reshape(-1, 2), np.array(true).reshape(-1, 2)))

    def _track_of(
        self, mover: ObstacleTruth, tracks: list[Obstacle], stamp: float, seen: bool
    ) -> Obstacle | None:
        """The track that was on the mover when both were seen last; None while there is none."""
        if seen:
            self._sighted[mover[0]] = stamp
            fresh = [one for one in tracks if one.seen_s == stamp]
            near = [one for one in fresh if _apart(one, mover) < MATCH_M]
            if near:
                best = min(near, key=lambda one: _apart(one, mover))
                self._owner[best.track] = mover[0]
        mine = [one for one in tracks if self._owner.get(one.track) == mover[0]]
        return max(mine, key=lambda one: one.seen_s, default=None)


def is_visible(view: SegmentedView, mover: ObstacleTruth) -> bool:
    """Whether a mover is in a truly placed view, and nothing nearer hides its middle."""
    _, x, y, _, _, radius, height = mover
    seen = view.T_map_camera.inverse().apply(np.array([[x, y, min(KNEE_M, height / 2)]]))
    pixel = view.depth.camera.project(seen)
    if not bool(view.depth.camera.contains(pixel)[0]):
        return False
    u, v = (round(float(value)) for value in pixel[0])
    rows, columns = view.depth.z.shape
    measured = float(view.depth.z[min(max(v, 0), rows - 1), min(max(u, 0), columns - 1)])
    return bool(measured > seen[0, 2] - radius - 0.10) and float(seen[0, 2]) < REACH_M


def _apart(track: Obstacle, mover: ObstacleTruth) -> float:
    return float(np.linalg.norm(track.position - np.array(mover[1:3])))


def outliers(share: float, rng: np.random.Generator) -> Fault:
    """So many of the sightings are of something else: anywhere in view, as sure as the true ones."""

    def fault(moment: WalkInstant) -> WalkInstant:
        sightings = [
            Sighting(
                one.identity,
                np.array([rng.uniform(0.4, 3.0), rng.uniform(-1.5, 1.5)]),
                one.covariance,
            )
            if rng.random() < share
            else one
            for one in moment.sightings
        ]
        return replace(moment, sightings=sightings)

    return fault


def blackout(begin_s: float, seconds: float) -> Fault:
    """No camera says anything for a while."""

    def fault(moment: WalkInstant) -> WalkInstant:
        dark = begin_s <= moment.frame.stamp_s < begin_s + seconds
        return replace(moment, sightings=[], views=(), detections=[]) if dark else moment

    return fault


def jump(at_s: float, metres: float) -> Fault:
    """The joints report once that the body was thrown ahead."""
    done: list[float] = []

    def fault(moment: WalkInstant) -> WalkInstant:
        odometry = moment.frame.odometry
        if done or odometry is None or moment.frame.stamp_s < at_s:
            return moment
        done.append(at_s)
        thrown = StepOdometry(odometry.motion @ Pose2(metres, 0.0, 0.0), odometry.steps)
        return replace(moment, frame=replace(moment.frame, odometry=thrown))

    return fault


def late(seconds: float) -> Fault:
    """Images are ahead of the body's clock: joints and inertial sensor tell of a moment before.

    The pose asked for is that of the body's clock.
    """
    truth: list[Pose2] = []
    joints = [Pose2(), Pose2()]  # where they had the body, and where they say so
    past: list[tuple[float, np.ndarray]] = []  # stamp and rate of the frame before

    def fault(moment: WalkInstant) -> WalkInstant:
        odometry, imu, stamp = moment.frame.odometry, moment.frame.imu, moment.frame.stamp_s
        if odometry is None or imu is None:
            return moment
        then, rate = past[-1] if past else (stamp - 1.0, imu.angular_velocity)
        before = truth[-1] if truth else moment.pose
        truth.append(moment.pose)
        share = max(1.0 - seconds / (stamp - then), 0.0)
        past.append((stamp, imu.angular_velocity))
        made = odometry.motion
        told = joints[0] @ Pose2(share * made.x, share * made.y, share * made.yaw)
        motion = joints[1].inverse() @ told
        joints[0], joints[1] = joints[0] @ made, told
        mixed = share * imu.angular_velocity + (1.0 - share) * rate
        frame = replace(
            moment.frame,
            odometry=StepOdometry(motion, odometry.steps),
            imu=replace(imu, angular_velocity=mixed),
        )
        way = before.inverse() @ moment.pose
        pose = before @ Pose2(share * way.x, share * way.y, share * way.yaw)
        return replace(moment, frame=frame, pose=pose)

    return fault
