"""Trials of localisers and of the obstacle tracker on one walk: their estimates, errors and covariances.

All localisers process the same walk in parallel. Faults change the inputs of one localiser, never the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import nees
from perception.floor.segmented_view import SegmentedView, Sight
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
from perception.smoothing.lagged_filter import LaggedFilter
from perception.smoothing.walk_factors import Instant, walk_factors, walk_systematics
from sim.truth import ObstacleTruth

from ...config.schema import Config
from ...run.simulate import START_COVARIANCE
from .localisation_walk import WalkInstant

ORIGIN_COVARIANCE = np.diag(np.square([0.001, 0.001, math.radians(0.05)]))
"""Of the start without markers: it is the origin of the map by definition; not 0 for numerical reasons."""

MATCH_M = 0.2
"""A track within this distance of a visible moving obstacle is assigned to it."""

LAG_S = 10.0
"""Of the smoother whose newest pose is compared with the filter's; as `SmootherConfig` has it."""

RECENT_S = 3.0
"""Obstacles visible within this time should have a track."""

KNEE_M, REACH_M = 0.15, 2.7
"""Height above the floor at which the visibility of an obstacle is tested, and greatest range."""

MOVES = 0.5
"""Probability of moving above which a track counts as a moving obstacle."""

Fault = Callable[[WalkInstant], WalkInstant]


@dataclass
class Trial:
    """One localiser and its errors so far.

    Args:
        localiser: The localiser.
        landmarks, registration: Whether it uses them.
        fault: Changes its inputs.
    """

    localiser: LeggedLocaliser
    landmarks: bool = True
    registration: bool = True
    fault: Fault = field(default=lambda instant: instant)
    errors: list[np.ndarray] = field(default_factory=list)
    covariances: list[np.ndarray] = field(default_factory=list)
    in_view: list[bool] = field(default_factory=list)
    instants: list[Instant] = field(default_factory=list)
    poses: list[Pose2] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.start = self.localiser.pose

    def step(self, instant: WalkInstant, tracks: list[Obstacle]) -> None:
        """Process one instant and record the error."""
        given = self.fault(instant)
        self.localiser.update(given.frame, given.sightings if self.landmarks else [])
        if self.registration and given.views:
            placed = [at_pose(view, self.localiser.pose) for view in given.views]
            self.localiser.register([static_points(view, tracks) for view in placed])
        pose = self.localiser.pose
        error = pose.mean - given.pose.vector
        error[2] = wrap_angle(float(error[2]))
        self.errors.append(error)
        self.covariances.append(pose.covariance)
        self.in_view.append(bool(given.sightings))
        frame, sightings = given.frame, given.sightings if self.landmarks else []
        self.instants.append(Instant(frame.stamp_s, frame.odometry, frame.imu, sightings))
        self.poses.append(given.pose)

    @property
    def nees(self) -> Float[np.ndarray, "n"]:
        """NEES of every instant, per degree of freedom: 1 if consistent."""
        return nees(np.array(self.errors), np.array(self.covariances)) / 3.0

    @property
    def position_m(self) -> Float[np.ndarray, "n"]:
        """Position error of every instant, m."""
        return np.linalg.norm(np.array(self.errors)[:, :2], axis=1)

    @property
    def heading_deg(self) -> Float[np.ndarray, "n"]:
        """Heading error of every instant, deg."""
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
    """A localiser at the start, with an initial error drawn from its covariance."""
    covariance = START_COVARIANCE if landmarks else ORIGIN_COVARIANCE
    mean = start.vector + np.sqrt(np.diag(covariance)) * rng.standard_normal(3)
    known = marks if landmarks else ()
    localiser = LeggedLocaliser(
        PoseFilter(Gaussian(mean, covariance), known, config.localiser),
        config.prior,
        replace(config.registration, enabled=registration),
    )
    trial = Trial(localiser, landmarks, registration)
    return trial if fault is None else replace(trial, fault=fault)


def smoothed_live(trial: Trial, marks: tuple[Landmark, ...], config: Config) -> Trial:
    """A trial from the same start whose pose is the newest one of a fixed-lag smoother; landmarks alone."""
    lagging = replace(config.localiser, lag_s=LAG_S)
    smoother = LaggedFilter(trial.start, marks, lagging)
    alone = replace(config.registration, enabled=False)
    return Trial(LeggedLocaliser(smoother, config.prior, alone), registration=False)


def fixed_lag_errors(
    trial: Trial, marks: tuple[Landmark, ...], config: Config
) -> Float[np.ndarray, "n"]:
    """Position error of every instant by a fixed-lag smoother with the same inputs but the scans, m."""
    places = {mark.identity: mark.position[:2] for mark in marks}
    frames = walk_factors(trial.instants, places, config.localiser)
    found = smooth_fixed_lag(frames, trial.start, walk_systematics(config.localiser))
    means = np.array([one.mean[:2] for one in found])
    return np.linalg.norm(means - np.array([pose.vector[:2] for pose in trial.poses]), axis=1)


def at_pose(view: SegmentedView, pose: Gaussian) -> SegmentedView:
    """A view in the body frame, transformed to the world by a pose."""
    x, y, yaw = (float(v) for v in pose.mean)
    T = Pose2(x, y, yaw).lifted()
    return replace(view, T_map_camera=T @ view.T_map_camera, upright=T.apply(view.upright))


class TrackerTrial:
    """The obstacle tracker at a localiser's poses, and its errors so far."""

    def __init__(self, config: Config) -> None:
        self._tracker = ObstacleTracker(config.tracker)
        self.nees: list[float] = []
        """NEES per degree of freedom of tracks of moving obstacles that are classified as moving."""
        self.nees_all: list[float] = []
        """NEES of all tracks of moving obstacles, including those classified as static."""
        self.velocity_mps: list[float] = []
        self.position_m: list[float] = []
        self.places: list[tuple[np.ndarray, np.ndarray]] = []
        """Positions of moving tracks (n, 2) and moving obstacles (m, 2) of each instant, if recently visible."""
        self._sighted: dict[int, float] = {}
        self._owner: dict[int, int] = {}  # track to obstacle

    @property
    def obstacles(self) -> list[Obstacle]:
        """Current tracks."""
        return self._tracker.obstacles

    def step(self, instant: WalkInstant, pose: Gaussian) -> None:
        """Process one instant."""
        stamp = instant.frame.stamp_s
        views = [at_pose(view, pose) for view in instant.views]
        true_views = [at_pose(v, Gaussian(instant.pose.vector, np.eye(3))) for v in instant.views]
        sight = Sight(views)
        self._tracker.update(stamp, instant.detections, pose, sight.visible, instant.cut, sight)
        tracks = self._tracker.obstacles
        for obstacle in instant.moving:
            track = self._track_of(
                obstacle, tracks, stamp, any(is_visible(v, obstacle) for v in true_views)
            )
            if track is None:
                continue
            error = track.state.mean - np.array(obstacle[1:5])
            normalised = float(nees(error, track.state.covariance)) / 4.0
            self.nees_all.append(normalised)
            if track.moving > MOVES:
                self.nees.append(normalised)
            if track.seen_s == stamp and track.moving > MOVES:
                self.position_m.append(float(np.linalg.norm(error[:2])))
                self.velocity_mps.append(float(np.linalg.norm(error[2:])))
        recent = stamp - RECENT_S
        moving_tracks = [o.position for o in tracks if o.moving > MOVES and o.seen_s >= recent]
        true = [m[1:3] for m in instant.moving if self._sighted.get(m[0], -np.inf) >= recent]
        self.places.append((np.array(moving_tracks).reshape(-1, 2), np.array(true).reshape(-1, 2)))

    def _track_of(
        self, obstacle: ObstacleTruth, tracks: list[Obstacle], stamp: float, seen: bool
    ) -> Obstacle | None:
        """The track assigned to an obstacle when both were last seen; None if there is none."""
        if seen:
            self._sighted[obstacle[0]] = stamp
            fresh = [one for one in tracks if one.seen_s == stamp]
            near = [one for one in fresh if _apart(one, obstacle) < MATCH_M]
            if near:
                best = min(near, key=lambda one: _apart(one, obstacle))
                self._owner[best.track] = obstacle[0]
        assigned = [one for one in tracks if self._owner.get(one.track) == obstacle[0]]
        return max(assigned, key=lambda one: one.seen_s, default=None)


def is_visible(view: SegmentedView, obstacle: ObstacleTruth) -> bool:
    """Whether an obstacle lies in a view placed at the true pose, and nothing occludes its centre."""
    _, x, y, _, _, radius, height = obstacle
    seen = view.T_map_camera.inverse().apply(np.array([[x, y, min(KNEE_M, height / 2)]]))
    pixel = view.depth.camera.project(seen)
    if not bool(view.depth.camera.contains(pixel)[0]):
        return False
    u, v = (round(float(value)) for value in pixel[0])
    rows, columns = view.depth.z.shape
    measured = float(view.depth.z[min(max(v, 0), rows - 1), min(max(u, 0), columns - 1)])
    return bool(measured > seen[0, 2] - radius - 0.10) and float(seen[0, 2]) < REACH_M


def _apart(track: Obstacle, obstacle: ObstacleTruth) -> float:
    return float(np.linalg.norm(track.position - np.array(obstacle[1:3])))


def outliers(share: float, rng: np.random.Generator) -> Fault:
    """Replace a share of the sightings by random ones in the field of view with the same covariance."""

    def fault(instant: WalkInstant) -> WalkInstant:
        sightings = [
            Sighting(
                one.identity,
                np.array([rng.uniform(0.4, 3.0), rng.uniform(-1.5, 1.5)]),
                one.covariance,
            )
            if rng.random() < share
            else one
            for one in instant.sightings
        ]
        return replace(instant, sightings=sightings)

    return fault


def blackout(begin_s: float, seconds: float) -> Fault:
    """Remove all camera measurements for a period."""

    def fault(instant: WalkInstant) -> WalkInstant:
        dark = begin_s <= instant.frame.stamp_s < begin_s + seconds
        return replace(instant, sightings=[], views=(), detections=[], cut=[]) if dark else instant

    return fault


def jump(at_s: float, metres: float) -> Fault:
    """Add a forward displacement to the odometry once."""
    done: list[float] = []

    def fault(instant: WalkInstant) -> WalkInstant:
        odometry = instant.frame.odometry
        if done or odometry is None or instant.frame.stamp_s < at_s:
            return instant
        done.append(at_s)
        displaced = StepOdometry(odometry.motion @ Pose2(metres, 0.0, 0.0), odometry.steps)
        return replace(instant, frame=replace(instant.frame, odometry=displaced))

    return fault


def late(seconds: float) -> Fault:
    """Delay joints and inertial sensor against the images; the true pose is that of the body's clock."""
    truth: list[Pose2] = []
    joints = [Pose2(), Pose2()]  # pose by odometry, without and with delay
    past: list[tuple[float, np.ndarray]] = []  # stamp and angular rate of earlier frames

    def fault(instant: WalkInstant) -> WalkInstant:
        odometry, imu, stamp = instant.frame.odometry, instant.frame.imu, instant.frame.stamp_s
        if odometry is None or imu is None:
            return instant
        then, rate = past[-1] if past else (stamp - 1.0, imu.angular_velocity)
        before = truth[-1] if truth else instant.pose
        truth.append(instant.pose)
        share = max(1.0 - seconds / (stamp - then), 0.0)
        past.append((stamp, imu.angular_velocity))
        made = odometry.motion
        delayed = joints[0] @ Pose2(share * made.x, share * made.y, share * made.yaw)
        motion = joints[1].inverse() @ delayed
        joints[0], joints[1] = joints[0] @ made, delayed
        mixed = share * imu.angular_velocity + (1.0 - share) * rate
        frame = replace(
            instant.frame,
            odometry=StepOdometry(motion, odometry.steps),
            imu=replace(imu, angular_velocity=mixed),
        )
        path = before.inverse() @ instant.pose
        pose = before @ Pose2(share * path.x, share * path.y, share * path.yaw)
        return replace(instant, frame=frame, pose=pose)

    return fault
