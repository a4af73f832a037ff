"""The pipeline: from one frame of the sensors to pose, floor, obstacles, tracks and maps.

The order is that of the flow chart of seed 003, with the localiser and the tracker of seed 001 before the maps:
localise, measure depth, find the floor, classify points, track obstacles, map. While depth does not show the floor
ahead, or for a planner by colour, the floor by colour of seed 000 gives detections too. The same pipeline runs live
and over a recording. It is the only place that measures; planners read the `WorldModel` it returns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mapping.grid.confidence import ConfidenceLayer, looked_at
from mapping.grid.dynamic_traces import DynamicTraces
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.world_map import WorldMap
from mapping.io.clouds import CloudBuilder
from mapping.objects import footprints
from mapping.objects.footprints import Footprint
from perception.depth import points, stereo, structured_light, time_of_flight
from perception.depth.health import DepthHealth
from perception.depth.reach import ReachConfig
from perception.depth.rectification import rectified
from perception.estimate import Estimate
from perception.floor import choose, classify
from perception.floor.segmented_view import (
    OBSTACLES,
    RISING,
    SegmentedView,
    colours_of,
    near_moving_obstacles,
    truncated,
    visibility,
)
from perception.localisation import landmarks
from perception.localisation.filter import PoseFilter
from perception.localisation.given_poses import GivenPoses
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.pose_source import PoseSource
from perception.localisation.registration import RegistrationReport
from perception.localisation.static_points import static_points
from perception.monocular.colour_floor import ColourFloor, ColourFloorFinder, either
from perception.obstacles import clustering, colour_detection
from perception.obstacles.clustering import Cluster
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker
from perception.odometry.odometry_poses import OdometryPoses
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from perception.primitives.stopwatch import Stopwatch
from planning.world_model import WorldModel

from ..config.schema import Config
from ..recordings.recording import RecordingInfo


class Pipeline:
    """Everything that lives from one frame to the next: whereabouts, tracks, maps, cloud."""

    def __init__(self, config: Config, info: RecordingInfo) -> None:
        self.config = config
        self.landmarks = info.landmarks
        self.whereabouts = _whereabouts(config, info)
        self.tracker = ObstacleTracker(config.tracker)
        self.rng = np.random.default_rng(config.seed)
        self.cloud = CloudBuilder(config.cloud)
        self.obstacle_cloud = CloudBuilder(config.obstacle_cloud)
        self.health = DepthHealth(config.depth_health)
        flow = config.swarm.as_walked.prediction == "flow"
        self.colour_floor = ColourFloorFinder(config.monocular, flow)
        self._forget()

    def _forget(self) -> None:
        """Start the maps anew."""
        self.world = WorldMap(self.config.world_map)
        self.grid: EgocentricGrid | None = None
        self.confidence: ConfidenceLayer | None = None
        self._mapped_s: float | None = None
        self._traces = DynamicTraces()

    def cycle(self, frame: Frame) -> WorldModel:
        """Take one frame from pixels to the maps."""
        watch = Stopwatch()
        with watch.stage("locate"):
            sightings = (
                landmarks.detect(frame.colour, self.landmarks, self.config.landmarks)
                if frame.colour is not None and self.landmarks
                else []
            )
            report = self.whereabouts.update(frame, sightings)
        views = []
        for sensor, depth in self._depths(frame, watch):
            with watch.stage("floor"):
                view = self._understand(sensor, depth)
            if view is not None:
                views.append(view)
        with watch.stage("register"):
            views, registration = self._register(views)
        pose = self.whereabouts.pose
        if frame.footstep_due and self.config.depth_health.fall_back:
            self.health.update([(view.depth, view.floor) for view in views])
        by_colour = None
        if pose is not None and self._needs_colour_floor(frame):
            with watch.stage("floor by colour"):
                by_colour = self.colour_floor.find(frame.colour, _pose2(pose), frame.stamp_s)
        with watch.stage("obstacles"):
            found = self._cluster(views, pose)
            if pose is not None:
                visible = visibility(views)
                self.tracker.update(
                    frame.stamp_s,
                    self._detections(found, frame, by_colour),
                    pose,
                    visible if by_colour is None else either(visible, by_colour.shows_free),
                    [_detection(cluster) for cluster in found if not cluster.placed],
                )
        with watch.stage("map"):
            self._remember(frame, views, pose)
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
        )
        return WorldModel(estimate, self.grid, self.confidence, self.world, self.landmarks)

    def _needs_colour_floor(self, frame: Frame) -> bool:
        """Whether obstacles are looked for by colour: the planner needs it, or depth is lost."""
        if self.config.monocular.use != "auto":
            return self.config.monocular.use == "always"
        return self.config.mission.planner == "swarm" or not self.health.healthy

    def footprints(self) -> list[Footprint]:
        """Ground plans of what stands, from the obstacle points that the world map believes in."""
        points, _ = self.obstacle_cloud.cloud()
        sightings, probability = self.obstacle_cloud.sightings, self.world.probability
        if not len(points) or not probability.size:
            return []
        rows, columns = self.world.cell_of(points[:, :2]).T
        inside = (rows >= 0) & (columns >= 0)
        inside &= (rows < probability.shape[0]) & (columns < probability.shape[1])
        believed = np.zeros(len(points), dtype=bool)
        believed[inside] = probability[rows[inside], columns[inside]] > 0.5
        return footprints.find(points[believed], self.config.footprints, sightings[believed])

    def _depths(self, frame: Frame, watch: Stopwatch) -> Iterator[tuple[str, Depth]]:
        """Every depth image of the frame, whatever sensor it comes from."""
        with watch.stage("depth"):
            tof = None if frame.tof is None else time_of_flight.depth(frame.tof, self.config.tof)
        if tof is not None:
            yield "tof", tof
        if frame.depth is not None:
            yield "depth", structured_light.depth(frame.depth, self.config.structured_light)
        if frame.stereo is not None:
            with watch.stage("stereo"):
                pair = stereo.depth(rectified(frame.stereo), self.config.stereo)
            yield "stereo", pair

    def _understand(self, sensor: str, depth: Depth) -> SegmentedView | None:
        """Points, floor and classes of one depth image; None where there is nothing to stand on."""
        reach: ReachConfig = getattr(self.config.reach, sensor)
        cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
        expected = self.whereabouts.expected_floor(depth.T_body_camera)
        floor = choose.find(cloud, expected, self.rng, self.config.floor, sensor)
        placed = self.whereabouts.place(depth.T_body_camera, None if floor is None else floor.plane)
        if placed is None:
            return None
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
        """Lay what stands over what was seen before; the views go along with the pose."""
        before = self.whereabouts.pose
        movers = self.tracker.obstacles
        report = self.whereabouts.register([static_points(view, movers) for view in views])
        after = self.whereabouts.pose
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

    def _cluster(self, views: Sequence[SegmentedView], pose: Gaussian | None) -> list[Cluster]:
        """Obstacle points of all views, in the body frame, grouped."""
        if not views:
            return []
        T_body_map = (Pose2() if pose is None else _pose2(pose)).inverse().lifted()
        rising = [np.isin(view.classes, RISING) for view in views]
        obstacle_points = np.concatenate(
            [T_body_map.apply(v.upright[mask]) for v, mask in zip(views, rising, strict=True)]
        )
        sigma = np.concatenate(
            [v.points.sigma[mask] for v, mask in zip(views, rising, strict=True)]
        )
        sensor = T_body_map.apply(views[0].T_map_camera.position)[:2]
        cut = []
        for view, mask in zip(views, rising, strict=True):
            reach: ReachConfig = getattr(self.config.reach, view.sensor)
            others = [other for other in views if other is not view]
            cut.append(truncated(view, reach, others)[mask])
        return clustering.cluster(
            obstacle_points, sigma, sensor, self.config.clusters, np.concatenate(cut)
        )

    def _detections(
        self, found: Sequence[Cluster], frame: Frame, floor: ColourFloor | None
    ) -> list[Detection]:
        """Detections for the tracker: clusters with a known centre, and by colour what depth does not show."""
        placed = [_detection(cluster) for cluster in found if cluster.placed]
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

    def _remember(
        self, frame: Frame, views: Sequence[SegmentedView], pose: Gaussian | None
    ) -> None:
        """Put floor and obstacles into the maps and the cloud."""
        if not views:
            return
        if pose is None:  # nothing relates this frame to the one before
            self._forget()
        here = np.zeros(2) if pose is None else pose.mean[:2]
        elapsed = 0.0 if self._mapped_s is None else frame.stamp_s - self._mapped_s
        self._mapped_s = frame.stamp_s
        if self.grid is None:
            self.grid = EgocentricGrid(self.config.grid, here)
            self.confidence = ConfidenceLayer(self.grid, self.config.confidence)
        assert self.confidence is not None
        self.grid.move(here)
        self.confidence.decay(elapsed)
        for view in views:
            self._remember_view(frame, view, pose)
            self.confidence.see(
                looked_at(view, self.grid, getattr(self.config.reach, view.sensor).farthest_m)
            )
        traces = self._traces.update(self.tracker.obstacles, frame.stamp_s)
        for one in (self.grid, self.world):
            one.mark_moving(*traces)
            one.age(elapsed)

    def _remember_view(self, frame: Frame, view: SegmentedView, pose: Gaussian | None) -> None:
        """One depth image into grid, world map and clouds."""
        assert self.grid is not None
        used = np.isin(view.classes, (*OBSTACLES, classify.FLOOR))
        upright, classes = view.upright[used], view.classes[used]
        is_obstacle = np.isin(classes, OBSTACLES)
        is_moving = is_obstacle & near_moving_obstacles(upright[:, :2], self.tracker.obstacles)
        camera = view.T_map_camera.position
        drop = np.abs(upright[:, 2] - view.floor.offset_m) / view.points.xyz[used, 2]
        self.grid.update(
            upright,
            is_obstacle,
            frame.stamp_s,
            camera[:2],
            is_moving=is_moving,
            sensor_height_m=view.floor.offset_m,
            sigma_m=view.points.sigma[used] * drop,
            floor=view.floor.moved(view.T_map_camera),
            pose=pose,
        )
        self.world.update(
            upright[:, :2],
            is_obstacle,
            frame.stamp_s,
            heights_m=upright[:, 2],
            is_moving=is_moving,
        )
        colours = colours_of(view, frame.colour)
        self.cloud.add(view.upright, colours)
        self.obstacle_cloud.add(upright[is_obstacle & ~is_moving], None)


def _whereabouts(config: Config, info: RecordingInfo) -> PoseSource:
    """Who can say where the body is."""
    if info.poses_given:
        return GivenPoses(info.gravity_up_world, config.prior)
    if info.start is None:
        alone = replace(config.odometer, loops=False)  # closing them takes the whole recording
        return OdometryPoses(
            np.random.default_rng(config.seed), alone, config.floor, config.structured_light
        )
    covariance = (
        np.diag(np.square([config.prior.start_m] * 2 + [np.radians(config.prior.start_deg)]))
        if info.start_covariance is None
        else info.start_covariance
    )
    start = Gaussian(info.start.vector, covariance)
    localiser = PoseFilter(start, info.landmarks, config.localiser)
    wanted = config.registration.enabled and (
        not info.landmarks or config.registration.beside_landmarks
    )
    return LeggedLocaliser(localiser, config.prior, replace(config.registration, enabled=wanted))


def _pose2(pose: Gaussian) -> Pose2:
    x, y, yaw = (float(v) for v in pose.mean)
    return Pose2(x, y, yaw)


def _detection(cluster: Cluster) -> Detection:
    return Detection(cluster.centre, cluster.covariance, cluster.radius_m, cluster.height_m)
