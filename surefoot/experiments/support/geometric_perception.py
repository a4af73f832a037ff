"""Geometric perception: detections and range scans computed from the simulator's geometry instead of from images.

Rendering the images of a 500 s walk takes minutes. Here `sim.sensors.geometric_sensor` computes what the cameras
would detect; with `perfect`, everything is known without error, for comparison. Tracker, egocentric grid and
confidence layer are those of the pipeline, and so is the localiser, by odometry, gyro and the tags of the scene.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.dynamic_traces import DynamicTraces
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.world_map import WorldMap
from perception.depth.sources import DepthSources
from perception.estimate import Estimate
from perception.floor.segmented_view import near_moving_obstacles
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker, Visible
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from planning.world_model import WorldModel
from sim.robot import SimulatedRobot
from sim.sensors.geometric_sensor import TOF_ACROSS_DEG, GeometricSensor
from sim.truth import Truth

from ...config.schema import Config
from ...recordings.recording import RecordingInfo
from ...run.pipeline import make_pose_source
from .tag_sensor import TagNoise, TagSensor

RAYS = 45  # one per degree of the time-of-flight camera's field of view
SPACING_M = 0.04  # of floor points along a ray: at least one per cell
SAME_M = 0.35  # a track within this distance of an object is assigned to it
HIT_POINTS = 4  # points on an obstacle per ray, one above the other
RANGE_SIGMA_M, FLYING_SHARE, FLYING_M = 0.010, 0.016, (-0.3, 0.2)
"""Errors of obstacle points along the ray, as in images (554 frames of the hard course, seeds 1000 and 1001): standard
deviation of most, share of the others, and their range, m."""


@dataclass
class ObservationTimes:
    """When an object was observed; this decides the class of a contact.

    Args:
        since_s: Start of the current period without a gap longer than the tracker's memory.
        seen_s: Last observation; -inf: never.
    """

    since_s: float = math.inf
    seen_s: float = -math.inf


class GeometricPerception:
    """A perception source without images."""

    def __init__(
        self, config: Config, robot: SimulatedRobot, info: RecordingInfo, perfect: bool = False
    ) -> None:
        """Start on the mark.

        Args:
            config: Configuration of localiser, tracker, grid and confidence; its seed is that of all errors.
            robot: The simulated robot.
            info: What is known beforehand, as for the pipeline.
            perfect: Everything is known everywhere without error or delay.
        """
        self.config = config
        self.landmarks = info.landmarks
        self._pose_source = make_pose_source(config, info, DepthSources())
        self.tracker = ObstacleTracker(config.tracker)
        self.grid: EgocentricGrid | None = None
        self.confidence: ConfidenceLayer | None = None
        self._traces = DynamicTraces()
        self.world = WorldMap(config.world_map)
        self.truth = Truth(robot)
        self.followed: dict[int, ObservationTimes] = {}
        self.tracking_ms = 0.0
        """Computing time of the tracker in the latest frame, ms; 0 for perfect perception."""
        self._sightings: tuple[Sighting, ...] = ()
        self._robot, self._perfect = robot, perfect
        self.walls = np.array(robot.world.scene.extent, float)
        """x_min, y_min, x_max, y_max of the room, m."""
        self._rng, tags, look = (
            np.random.default_rng(s) for s in np.random.SeedSequence([config.seed, 40]).spawn(3)
        )
        self._tags = TagSensor(robot.world.scene, TagNoise(), config.landmarks, tags)
        self._sensor = GeometricSensor(look)
        self._stamp_s = 0.0
        self._turned_s: dict[int, float] = {}
        self._velocities: dict[int, tuple[float, float]] = {}
        objects = self.truth.obstacles()
        self.discs = np.array([[x, y, radius] for _, x, y, _, _, radius, _ in objects])
        """True x, y and radius of all objects now, m; moving objects first."""
        self.movers = len(robot.world.scene.moving_objects)
        """Number of moving objects, the first rows of `discs`."""
        self._heights_m = [height for *_, height in objects]

    def cycle(self, frame: Frame) -> WorldModel:
        """Pose, tracks and maps after one frame."""
        elapsed, self._stamp_s = frame.stamp_s - self._stamp_s, frame.stamp_s
        true = self.truth.robot_pose()
        self._move_on(frame.stamp_s)
        pose = self._estimated(frame, true)
        if self._perfect:
            obstacles = self._everything(frame.stamp_s)
            if frame.footstep_due:
                self._map_everything(pose, frame.stamp_s)
        else:
            obstacles = self._look(frame, true, pose)
            self._map_view(frame.stamp_s, true, pose, elapsed)
        estimate = Estimate(
            frame.stamp_s, pose, obstacles=tuple(obstacles), sightings=self._sightings
        )
        return WorldModel(estimate, self.grid, self.confidence, self.world, self.landmarks)

    def watch(self, stamp_s: float, obstacles: Sequence[Obstacle]) -> None:
        """Record which objects the present tracks, of any perception source, belong to."""
        self._stamp_s = stamp_s
        self._move_on(stamp_s)
        for one in obstacles:
            away = np.hypot(*(self.discs[:, :2] - one.position).T)
            if one.seen_s == stamp_s and away.min() < SAME_M:
                self._note(int(np.argmin(away)), stamp_s)

    def _move_on(self, stamp_s: float) -> None:
        """Update position and velocity of the moving objects, and the time of their last reversal."""
        for k, (x, y, vx, vy) in enumerate(self._robot.world.moving_states()):
            self.discs[k, :2] = x, y
            before = self._velocities.get(k, (vx, vy))
            if before[0] * vx + before[1] * vy < 0.0:
                self._turned_s[k] = stamp_s
            self._velocities[k] = (vx, vy)

    def since_turned(self, index: int) -> float:
        """Time since a moving object last reversed, s; infinite for static objects."""
        return self._stamp_s - self._turned_s.get(index, -math.inf)

    def _estimated(self, frame: Frame, true: Pose2) -> Gaussian:
        """The localiser's pose; the true one for perfect perception."""
        if self._perfect:
            return Gaussian(true.vector, np.eye(3) * 1e-8)
        self._sightings = tuple(self._look_for_tags()) if frame.footstep_due else ()
        self._pose_source.update(frame, self._sightings)
        pose = self._pose_source.pose
        assert pose is not None
        return pose

    def _look_for_tags(self) -> list[Sighting]:
        """Sightings of the tags that the colour camera would decode now."""
        robot, image = self._robot, self._robot.config.colour_camera
        seen_from = robot.camera_in_world(image.mount_m)
        by_joints = robot.measured_camera(image.mount_m)
        return self._tags.look(robot.world.rays, image, seen_from, by_joints)

    def _everything(self, stamp_s: float) -> list[Obstacle]:
        found = []
        for k, (x, y, radius) in enumerate(self.discs.tolist()):
            velocity = self._velocities.get(k, (0.0, 0.0))
            state = Gaussian(np.array([x, y, *velocity]), np.eye(4) * 1e-8)
            moving = float(k in self._velocities)
            found.append(Obstacle(state, radius, self._heights_m[k], k, moving, stamp_s, 0.0))
        return found

    def _look(self, frame: Frame, true: Pose2, pose: Gaussian) -> list[Obstacle]:
        """Tracks after an update with the detections of this frame, body frame."""
        in_body = self.discs.copy()
        in_body[:, :2] = true.inverse().apply(self.discs[:, :2])
        pan, tilt = self.head(true)
        seen = self._sensor.look(in_body, pan, tilt, frame.footstep_due)
        given = [Detection(one.position, one.covariance, one.radius_m, 0.4) for one in seen]
        whole = [one for one, found in zip(given, seen, strict=True) if found.whole]
        cut = [one for one, found in zip(given, seen, strict=True) if not found.whole]
        visible = self._visible(pose, pan, tilt)
        began = time.thread_time()
        self.tracker.update(frame.stamp_s, whole, pose, visible, cut)
        obstacles = self.tracker.obstacles
        self.tracking_ms = 1e3 * (time.thread_time() - began)
        return obstacles

    def _note(self, index: int, stamp_s: float) -> None:
        record = self.followed.setdefault(index, ObservationTimes())
        if stamp_s - record.seen_s > self.config.tracker.oldest_s:
            record.since_s = stamp_s
        record.seen_s = stamp_s

    def head(self, true: Pose2) -> tuple[float, float]:
        """True pan and tilt of the camera relative to the body, including sway, rad."""
        axis = self._robot.camera_in_world(self._robot.config.tof_mount_m).rotation[:, 2]
        pan = wrap_angle(math.atan2(axis[1], axis[0]) - true.yaw)
        return pan, math.atan2(-axis[2], math.hypot(axis[0], axis[1]))

    def free_m(
        self, true: Pose2, places: Float[np.ndarray, "n 2"], without: int | None = None
    ) -> Float[np.ndarray, "n"]:
        """Length of the free line from the robot towards each place, world frame, m.

        Args:
            true: Pose of the robot.
            places: World frame, m.
            without: Index of a disc that does not count.
        """
        apart = places - (true.x, true.y)
        bearing = np.arctan2(apart[:, 1], apart[:, 0])
        rays = np.column_stack([np.broadcast_to((true.x, true.y), apart.shape), bearing])
        discs = self.discs if without is None else np.delete(self.discs, without, axis=0)
        return self._sensor.rays(discs, self.walls, rays)[0]

    def _visible(self, pose: Gaussian, pan: float, tilt: float) -> Visible:
        """A test like `Sight.visible`: positions whose line of sight the time-of-flight camera sees as free."""
        here, nearest, farthest = pose.mean, *self._sensor.floor_reach(tilt)
        half = math.radians(TOF_ACROSS_DEG) / 2

        def visible(xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
            apart = xy - here[:2]
            away, bearing = np.hypot(apart[:, 0], apart[:, 1]), np.arctan2(apart[:, 1], apart[:, 0])
            rays = np.column_stack([np.broadcast_to(here[:2], apart.shape), bearing])
            free, _ = self._sensor.rays(self.discs, self.walls, rays)
            off = np.abs((bearing - here[2] - pan + math.pi) % (2 * math.pi) - math.pi)
            inside = (off <= half) & (away > nearest) & (away < farthest)
            return np.asarray(inside & (free > away + 0.15))

        return visible

    def _map_view(self, stamp_s: float, true: Pose2, pose: Gaussian, elapsed: float) -> None:
        """Add the floor and obstacle points of one range scan to grid and confidence."""
        if self.grid is None:
            self.grid = EgocentricGrid(self.config.grid, pose.mean[:2])
            self.confidence = ConfidenceLayer(self.grid, self.config.confidence)
        assert self.confidence is not None
        self.grid.move(pose.mean[:2])
        self.confidence.decay(elapsed)
        pan, tilt = self.head(true)
        nearest, farthest = self._sensor.floor_reach(tilt)
        half = math.radians(TOF_ACROSS_DEG) / 2
        fan = pan + np.linspace(-half, half, RAYS)
        origin = np.column_stack([np.full(RAYS, true.x), np.full(RAYS, true.y), true.yaw + fan])
        free, _ = self._sensor.rays(self.discs, self.walls, origin)
        along = np.arange(nearest, farthest, SPACING_M)
        ray, step = np.nonzero(along[None] < free[:, None] - 0.03)
        hits = np.flatnonzero(free < farthest)
        fronts = np.repeat(free[hits] + 0.01, HIT_POINTS) + self._range_errors(
            HIT_POINTS * len(hits)
        )
        distances = np.concatenate([along[step], fronts])
        which = np.concatenate([ray, np.repeat(hits, HIT_POINTS)])
        is_obstacle = np.arange(len(which)) >= len(ray)
        directions = pose.mean[2] + fan[which]
        points = pose.mean[:2] + distances[:, None] * np.column_stack(
            [np.cos(directions), np.sin(directions)]
        )
        is_moving = is_obstacle & near_moving_obstacles(points, self.tracker.obstacles)
        self.grid.update(
            points, is_obstacle, stamp_s, pose.mean[:2], is_moving=is_moving, pose=pose
        )
        self.grid.mark_moving(*self._traces.update(self.tracker.obstacles, stamp_s))
        self.grid.age(elapsed)
        self.confidence.see(self._looked_at(pose, pan, half, nearest, farthest))

    def _range_errors(self, count: int) -> Float[np.ndarray, "n"]:
        """Errors of the ranges of obstacle points, m: noise, and a few flying pixels."""
        noise = RANGE_SIGMA_M * self._rng.standard_normal(count)
        flies = self._rng.random(count) < FLYING_SHARE
        return np.where(flies, self._rng.uniform(*FLYING_M, count), noise)

    def _looked_at(
        self, pose: Gaussian, pan: float, half: float, nearest: float, farthest: float
    ) -> Bool[np.ndarray, "n n"]:
        assert self.grid is not None
        apart = self.grid.centres() - pose.mean[:2]
        away = np.hypot(apart[..., 0], apart[..., 1])
        bearing = np.arctan2(apart[..., 1], apart[..., 0]) - pose.mean[2] - pan
        off = np.abs((bearing + math.pi) % (2 * math.pi) - math.pi)
        return np.asarray((off <= half) & (away >= nearest) & (away <= farthest))

    def _map_everything(self, pose: Gaussian, stamp_s: float) -> None:
        """Set all cells around the robot to the truth, without moving objects, which the tracks represent."""
        if self.grid is None:
            self.grid = EgocentricGrid(self.config.grid, pose.mean[:2])
            self.confidence = ConfidenceLayer(self.grid, self.config.confidence)
        assert self.confidence is not None
        self.grid.move(pose.mean[:2])
        centres = self.grid.centres().reshape(-1, 2)
        x0, y0, x1, y1 = self.walls
        half = self.grid.cell_m / 2  # a partly covered cell counts as covered
        covered = (centres[:, 0] < x0 + half) | (centres[:, 0] > x1 - half)
        covered |= (centres[:, 1] < y0 + half) | (centres[:, 1] > y1 - half)
        for x, y, radius in self.discs[len(self._robot.world.scene.moving_objects) :]:
            away = (centres[:, 0] - x) ** 2 + (centres[:, 1] - y) ** 2
            covered |= away < (radius + half) ** 2
        many = np.repeat(np.arange(len(centres)), np.where(covered, HIT_POINTS, 1))
        self.grid.update(centres[many], covered[many], stamp_s, pose.mean[:2])
        self.confidence.see(np.ones((self.grid.config.cells,) * 2, np.bool_))
