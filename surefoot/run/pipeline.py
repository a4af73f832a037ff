"""The pipeline: from one frame of the sensors to pose, floor, obstacles, tracks and maps.

The order is that of the flow chart of seed 003, with the localiser and the tracker of seed 001 before the maps:
localise, measure depth, find the floor, classify points, track obstacles, map. While depth does not show the floor
ahead, or for a planner by colour, the floor by colour of seed 000 gives detections too. The same pipeline runs live
and over a recording. It is the only place that measures; planners read the `WorldModel` it returns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mapping.io.clouds import CloudBuilder
from perception.depth import points
from perception.depth.flying import without_flying
from perception.depth.health import DepthHealth
from perception.depth.sources import DepthSources
from perception.estimate import Estimate
from perception.floor import choose, classify
from perception.floor.segmented_view import SegmentedView, Sight, lowermost, truncated, uppermost
from perception.localisation import landmarks
from perception.localisation.filter import PoseFilter, UpdateReport
from perception.localisation.given_poses import GivenPoses
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.pose_source import PoseSource
from perception.localisation.registration import RegistrationReport
from perception.localisation.static_points import static_points
from perception.monitoring.agreement import Bias, Surprise
from perception.monitoring.status import SLOW, Doubt, StatusBoard
from perception.monocular.colour_floor import ColourFloor, ColourFloorFinder, seen_by_any
from perception.obstacles import clustering, colour_detection, legs
from perception.obstacles.clustering import Cluster
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker
from perception.odometry.odometry_poses import OdometryPoses
from perception.primitives.frame import ColourView, Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2
from perception.primitives.stopwatch import Stopwatch
from perception.smoothing.lagged_filter import LaggedFilter
from planning.world_model import WorldModel

from ..config.schema import Config
from ..recordings.recording import RecordingInfo
from ..words import count_of
from .frame_watch import FrameWatch
from .ground_watch import GroundWatch
from .maps import RunMaps

FLOORS = 6  # ours: number of floors over which camera and joints are compared; two seconds of two cameras
HEIGHTS, MISPLACED_NIS = 4, 1e3
"""Ours: number of images over which the heights of tags are checked; NIS of an image whose tags are misplaced."""


class Pipeline:
    """Perception of a run. Its state from frame to frame: pose source, tracks, maps."""

    def __init__(self, config: Config, info: RecordingInfo) -> None:
        self.config = config
        self.landmarks = info.landmarks
        self.depth_sources = DepthSources(
            config.tof, config.structured_light, config.stereo, config.depth_sources, info.own_body
        )
        self.floor_config = config.floor_of(info.calibrated)
        self.pose_source = make_pose_source(config, info, self.depth_sources)
        self.tracker = ObstacleTracker(config.tracker)
        self.rng = np.random.default_rng(config.seed)
        self.maps = RunMaps(config)
        self.health = DepthHealth(config.depth_health)
        flow = config.swarm.as_walked.prediction == "flow"
        self.colour_floor = ColourFloorFinder(config.monocular, flow)
        walks = isinstance(self.pose_source, LeggedLocaliser)
        self._watch = FrameWatch(info.own_body, walks)
        self._floors, self._heights = Bias(2, FLOORS), Surprise(1, HEIGHTS)
        self._status = StatusBoard()
        self.ground = GroundWatch(config, self.floor_config)
        self._unreached: dict[str, list[float]] = {}
        """Medians of the images of a sensor that have no depth within reach, m."""

    def cycle(self, frame: Frame) -> WorldModel:
        """Process one frame, from images to tracks and maps."""
        watch = Stopwatch()
        with watch.stage("watch"):
            frame, doubts = self._watch.check(frame)
        with watch.stage("localise"):
            sightings = self._sightings(frame.colour)
            report = self.pose_source.update(frame, sightings)
        views = []
        for sensor, depth in self.depth_sources.images(frame, watch.stage):
            with watch.stage("floor"):
                view = self.segment(sensor, depth)
            if view is not None:
                views.append(view)
        with watch.stage("register"):
            views, registration = self._register(views)
        pose = self.pose_source.pose
        if frame.footstep_due:
            reach = self.config.reach
            self.health.update(
                [
                    (one.depth, one.floor, reach.of(one.sensor, one.depth).farthest_m)
                    for one in views
                ]
            )
        doubts += self._doubts(report)
        by_colour = None
        if pose is not None and self._needs_colour_floor(frame):
            with watch.stage("floor by colour"):
                by_colour = self.colour_floor.find(
                    frame.colour, _pose2(pose), frame.stamp_s, frame.imu
                )
        with watch.stage("obstacles"):
            found, placed, cut = self.cluster(views, pose)
            if pose is not None:
                sight = Sight(views)
                visible = sight.visible
                self.tracker.update(
                    frame.stamp_s,
                    self._detections(placed, frame, by_colour),
                    pose,
                    visible if by_colour is None else seen_by_any(visible, by_colour.shows_free),
                    cut,
                    sight,
                )
        with watch.stage("map"):
            self.maps.update(frame, views, self.tracker.obstacles, pose)
        if self.ground.map is not None:
            with watch.stage("ground"):
                self.ground.update(frame, views, None if pose is None else _pose2(pose))
        estimate = Estimate(
            frame.stamp_s,
            pose,
            tuple(views),
            tuple(found),
            tuple(self.tracker.obstacles) if pose is not None else (),
            report,
            tuple(self.tracker.innovations),
            tuple(sightings),
            watch.milliseconds,
            registration,
            frame.colour,
            by_colour,
            self.health.healthy,
            self._status.update(frame.stamp_s, doubts),
        )
        maps = self.maps
        return WorldModel(estimate, maps.grid, maps.confidence, maps.world, self.landmarks)

    @property
    def cloud(self) -> CloudBuilder:
        """The points of the run."""
        return self.maps.cloud

    def notes(self, frames: int) -> list[str]:
        """Note on every sensor most of whose images have no depth within reach: its scale may be wrong."""
        return [
            f"sensor {sensor}: no depth is within reach in {len(medians)} of {count_of(frames, 'frame')}, the median "
            f"{np.median(medians):.3g} m; check scale_per_metre, else set reach.{sensor}.farthest_m or nearest_m"
            for sensor, medians in self._unreached.items()
            if len(medians) > frames / 2
        ]

    def ground_entries(self) -> dict[str, Any] | None:
        """Content of ground.json; None where no map of surfaces is kept."""
        return self.ground.entries()

    def _sightings(self, colour: ColourView | None) -> list[Sighting]:
        """The landmarks of a picture; none while the camera points elsewhere than the joints say."""
        if colour is None or not self.landmarks:
            return []
        seen = landmarks.detect(colour, self.landmarks, self.config.landmarks)
        if seen.sightings or seen.misplaced:
            wrong = seen.misplaced > len(seen.sightings)
            self._heights.update(MISPLACED_NIS if wrong else 1.0)
        return seen.sightings if self._heights.agrees and self._floors.agrees else []

    def _doubts(self, report: UpdateReport | None) -> list[Doubt]:
        """Doubts of localiser, floor and depth in this frame."""
        found = [] if report is None else list(report.doubts)
        if not (self._floors.agrees and self._heights.agrees):
            found.append(Doubt("camera and joints disagree", SLOW))
        if not self.health.healthy:
            found.append(Doubt("no depth"))
        return found

    def _needs_colour_floor(self, frame: Frame) -> bool:
        """Whether to find the floor by colour: by default if the planner needs it or depth is lost."""
        if self.config.monocular.use != "auto":
            return self.config.monocular.use == "always"
        lost = self.config.depth_health.fall_back and not self.health.healthy
        return self.config.mission.planner == "swarm" or lost

    def segment(self, sensor: str, depth: Depth) -> SegmentedView | None:
        """Points, floor and classes of one depth image; None if the floor is neither visible nor expected."""
        reach = self.config.reach.of(sensor, depth)
        cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
        if not len(cloud) and np.isfinite(depth.z).any():
            self._unreached.setdefault(sensor, []).append(float(np.nanmedian(depth.z)))
        expected = self.pose_source.expected_floor(depth.T_body_camera)
        search = cloud, expected, self.rng, self.floor_config, sensor
        floor = choose.find(*search)
        if depth.T_body_camera is None:
            floor = choose.find_lower(*search) or floor
        elif floor is not None:
            seen = floor.among_points
            spread = expected.covariance + seen.covariance
            self._floors.update(expected.error_to(seen)[:2], spread[:2, :2])
        placed = self.pose_source.place(depth.T_body_camera, None if floor is None else floor.plane)
        if placed is None:
            return None
        cloud = without_flying(cloud, depth)
        upright = placed.T_map_camera.apply(cloud.xyz)
        upright[:, 2] = placed.floor.distance(cloud.xyz)
        return SegmentedView(
            sensor,
            depth,
            cloud,
            classify.classify(
                cloud,
                placed.floor if floor is None else floor.among_points,
                self.config.classes,
            ),
            placed.floor,
            None if floor is None else floor.share,
            placed.T_map_camera,
            upright,
        )

    def _register(
        self, views: list[SegmentedView]
    ) -> tuple[list[SegmentedView], RegistrationReport | None]:
        """Register static points with those of earlier frames, and move the views with the corrected pose."""
        before = self.pose_source.pose
        tracks = self.tracker.obstacles
        report = self.pose_source.register([static_points(view, tracks) for view in views])
        after = self.pose_source.pose
        if report is None or before is None or after is None:
            return views, report
        step = (_pose2(after) @ _pose2(before).inverse()).lifted()
        return [
            replace(
                view,
                T_map_camera=step @ view.T_map_camera,
                upright=step.apply(view.upright),
            )
            for view in views
        ], report

    def cluster(
        self, views: Sequence[SegmentedView], pose: Gaussian | None
    ) -> tuple[list[Cluster], list[Detection], list[Detection]]:
        """Clusters of the obstacle points of all views, body frame.

        Returns:
            The clusters; those with a known centre as detections; and the others, which a border of the image cuts.
        """
        if not views:
            return [], [], []
        T_body_map = (Pose2() if pose is None else _pose2(pose)).inverse().lifted()
        rising = [view.rising for view in views]
        obstacle_points = np.concatenate(
            [
                T_body_map.apply(v.upright.take(k, axis=0))
                for v, k in zip(views, rising, strict=True)
            ]
        )
        own = [view.points.of(k) for view, k in zip(views, rising, strict=True)]
        sensor = T_body_map.apply(views[0].T_map_camera.position)[:2]
        cut, bands, in_space, upper, lower, pitches, before = [], [], [], [], [], [], 0
        for view, chosen in zip(views, own, strict=True):
            reach = self.config.reach.of(view.sensor, view.depth)
            pitches.append(reach.stride / view.depth.camera.fy)
            others = [other for other in views if other is not view]
            beside = truncated(view, chosen, reach, others)
            cut.append(np.where(beside >= 0, beside + before, beside))
            before += len(chosen)
            upper.append(uppermost(view, chosen))
            lower.append(lowermost(view, chosen, reach, others))
            bands.append(classify.band(chosen, view.floor, self.config.classes))
            in_space.append((T_body_map @ view.T_map_camera).apply(chosen.xyz))
        found = clustering.cluster(
            obstacle_points,
            np.concatenate([chosen.sigma for chosen in own]),
            sensor,
            self.config.clusters,
            np.concatenate(cut),
            np.concatenate(bands),
            np.concatenate(upper),
            np.concatenate(lower),
            views[0].floor.offset_m,
            max(pitches),
            min(clustering.rim_of(view.depth) for view in views),
            self.config.classes.top_m,
        )
        found = legs.joined(found)
        points_in_body = np.concatenate(in_space)
        placed, cut_off = list[Detection](), list[Detection]()
        for one in found:
            surface = points_in_body[one.surface]
            seen = Detection(one.centre, one.covariance, one.radius_m, one.height_m, surface)
            (placed if one.placed else cut_off).append(seen)
        return found, placed, cut_off

    def _detections(
        self, placed: list[Detection], frame: Frame, floor: ColourFloor | None
    ) -> list[Detection]:
        """Detections for the tracker: clusters with a known centre, and detections by colour that overlap none."""
        by_colour = [] if floor is None else list(floor.detections)
        if frame.colour is not None:
            by_colour += colour_detection.detect(frame.colour, self.config.coloured)
        return placed + [
            seen
            for seen in by_colour
            if all(
                np.hypot(*(seen.position - other.position)) > seen.radius_m + other.radius_m
                for other in placed
            )
        ]


def make_pose_source(config: Config, info: RecordingInfo, sources: DepthSources) -> PoseSource:
    """The pose source of a recording: its given poses, odometry from images, or legged localisation from its start."""
    if info.poses_given:
        return GivenPoses(info.gravity_up_world, config.prior)
    if info.start is None:
        alone = replace(config.odometer, loops=False)  # loop closure needs the whole recording
        rng = np.random.default_rng(config.seed)
        floor = config.floor_of(info.calibrated)
        return OdometryPoses(rng, alone, floor, sources, config.reach)
    covariance = (
        np.diag(np.square([config.prior.start_m] * 2 + [np.radians(config.prior.start_deg)]))
        if info.start_covariance is None
        else info.start_covariance
    )
    start = Gaussian(info.start.vector, covariance)
    kind = LaggedFilter if config.localiser.lag_s > 0.0 else PoseFilter
    localiser = kind(start, info.landmarks, config.localiser)
    wanted = config.registration.enabled and (
        not info.landmarks or config.registration.beside_landmarks
    )
    return LeggedLocaliser(localiser, config.prior, replace(config.registration, enabled=wanted))


def _pose2(pose: Gaussian) -> Pose2:
    x, y, yaw = (float(v) for v in pose.mean)
    return Pose2(x, y, yaw)
