"""The pipeline of ground with several levels: from one frame of the sensors to pose, height, surfaces and obstacles.

The map is kept in the frame of the foot that stands, whose ground has height 0. Once a step, while both feet stand, the frame
moves on to the foot that has just landed, and the depth images are fused. The pose is that of the walk on flat ground: steps and
gyro, corrected by scans of the steep surfaces in view; the height is that of the joints. The maps move by steps and gyro alone, so
that no correction makes them jump. There is no floor plane, no occupancy grid and no track. It runs live and over a recording.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mapping.ground.ground_map import GroundMap
from mapping.ground.levels import Levels, LevelView
from mapping.ground.obstacles import ObstacleMap
from mapping.io import ground_file
from mapping.io.clouds import CloudBuilder
from perception.depth import points
from perception.depth.sources import DepthSources
from perception.estimate import Estimate
from perception.floor.segmented_view import colours_of
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.plane_scan import plane_scan
from perception.localisation.registration import RegistrationReport
from perception.monitoring.agreement import Bias
from perception.monitoring.status import SLOW, STAND, Doubt, StatusBoard
from perception.primitives.errors import InputError
from perception.primitives.frame import FeetReading, Frame, StepOdometry
from perception.primitives.pose import Pose2, Pose3
from perception.primitives.stopwatch import Stopwatch
from perception.terrain import segmentation
from planning.world_model import WorldModel

from ..config.schema import Config
from ..recordings.recording import RecordingInfo
from .frame_watch import GAP, FrameWatch
from .pipeline import Pipeline, make_pose_source

START = 5 / 12
"""Ours: radius of level ground assumed round the start, which the camera cannot see; share of the camera's height."""
GROUND_M = 2.2  # ours: edges farther away are not used: their claimed errors become too small over many images
RISE_SIGMA_M = 0.002  # ours: error of the height of one footstep by the joints
# Ours: sway of the trunk, added to tilt and height of the predicted ground.
SWAY_M, SWAY_RAD = 0.005, math.radians(0.5)
UNSEEN_STEP = np.diag(np.square([0.2, 0.1, 0.3, 0.1]))
"""Ours: covariance of a step without odometry: ahead and across, m^2, heading, rad^2, and rise, m^2."""
SENSORS = ("tof", "depth")
TILTS = 6  # ours: number of images over which the tilt of the ground is compared with that by the joints
STILL_M, STILL_RAD = 0.003, math.radians(0.5)
"""Ours: a foot that moved by more has stepped; above the errors of encoders."""


class LevelPipeline:
    """Perception of a run over several levels. Its state from frame to frame: pose, height, surfaces, obstacles.

    Raises:
        InputError: The start is not known, or the poses are given.
    """

    maps = None  # of one floor

    def __init__(self, config: Config, info: RecordingInfo) -> None:
        if info.start is None or info.poses_given:
            raise InputError(
                "ground of several levels: the pose comes from steps and joints; a recording with a start pose and without "
                "given poses was expected"
            )
        self.config = config
        self._depths = DepthSources(
            config.tof, config.structured_light, config.stereo, SENSORS, info.own_body
        )
        self._floor = config.floor_of(info.calibrated)
        source = make_pose_source(config, replace(info, landmarks=()), self._depths)
        assert isinstance(source, LeggedLocaliser)
        self.pose_source = source
        start_m = START * config.robot_model.eye_m
        self._ground = GroundMap(replace(config.ground, start_m=start_m, forgets=False))
        self._obstacles = ObstacleMap()
        self.cloud = CloudBuilder(config.cloud)
        self._watch, self._status = FrameWatch(info.own_body, walks=True), StatusBoard()
        self._walked = Pose2()  # the body by steps and gyro alone, which no scan makes jump
        self._stood: Pose2 | None = None  # the standing foot by the same
        self._steps = 0.0
        self._feet: FeetReading | None = None  # of the frame before
        self._landed: FeetReading | None = None  # when the standing foot began to stand
        self._tilts = Bias(2, TILTS)
        self._height_m2 = 0.0  # variance of the height of the ground below the standing foot
        noise, prior = config.localiser, config.prior
        step_sigma = np.array(
            [
                math.hypot(noise.step_x_sigma_m, noise.slip_sigma_m),
                math.hypot(noise.step_y_sigma_m, noise.lateral_slip_sigma_m),
                math.hypot(noise.step_yaw_sigma_rad, noise.drift_sigma_rad),
            ]
        )
        tilt = math.radians(prior.joints_tilt_deg)
        sigma = [SWAY_M, SWAY_M, prior.joints_height_m, tilt, tilt, SWAY_RAD]
        self._camera_covariance = np.diag(np.square(sigma))
        self._step_covariance = np.diag(np.square([*step_sigma, RISE_SIGMA_M]))
        self._levels = Levels(
            (), self._obstacles.voxels, -1, 0, info.start, 0.0, (0.0, 0.0), step_sigma, noise.slip_m
        )  # the gait begins with the left foot

    def cycle(self, frame: Frame) -> WorldModel:
        """Process one frame.

        Raises:
            InputError: The frame does not tell where the feet are.
        """
        feet = frame.feet
        if feet is None:
            raise InputError(
                f"frame at {frame.stamp_s} s: it does not tell where the feet are, as ground of several levels needs"
            )
        watch = Stopwatch()
        with watch.stage("watch"):
            frame, doubts = self._watch.check(frame)
        with watch.stage("localise"):
            if frame.odometry is None:
                doubts.append(Doubt("no odometry"))
            gap = any(one.words == GAP for one in doubts)
            missed = self._missed(feet) if gap or frame.odometry is None else False
            frame = frame if missed else self._bridged(frame, feet, gap)
            self._feet = feet
            before = self.pose_source.pose2
            report = self.pose_source.update(frame, ())
            self._walked = self._walked @ before.inverse() @ self.pose_source.pose2
            if missed:
                self._stood = self._walked @ feet.sole(self._levels.foot).flattened()
        registration: RegistrationReport | None = None
        views: tuple[LevelView, ...] = ()
        self._steps += 0.0 if frame.odometry is None else frame.odometry.steps
        if frame.footstep_due:
            self._follow(feet)
            registration, views = self._observe(frame, feet, watch)
            if not views:
                doubts.append(Doubt("no depth", STAND))
            foot = feet.sole(self._levels.foot)
            with watch.stage("map"):
                self._levels = replace(
                    self._levels,
                    surfaces=self._ground.surfaces,
                    voxels=self._obstacles.voxels,
                    stands=self.pose_source.pose2 @ foot.flattened(),
                )
        body_m = self._height(feet)
        self._levels = replace(self._levels, body_m=body_m, views=views)
        doubts += [] if report is None else report.doubts
        if not self._tilts.agrees:
            doubts.append(Doubt("camera and joints disagree", SLOW))
        estimate = Estimate(
            frame.stamp_s,
            self.pose_source.pose,
            landmarks=report,
            timing_ms=watch.milliseconds,
            registration=registration,
            colour=frame.colour,
            status=self._status.update(frame.stamp_s, doubts),
        )
        return WorldModel(estimate, levels=self._levels)

    def ground_entries(self) -> dict[str, Any] | None:
        """Content of ground.json."""
        now = self._levels
        return {**ground_file.entries(now.surfaces, now.stands), "body_height_m": now.ground_m}

    def _bridged(self, frame: Frame, feet: FeetReading, gap: bool) -> Frame:
        """The frame with its motion by the standing foot, where the steps do not tell that since the frame before."""
        before = self._feet
        if before is None or (frame.odometry is not None and not gap):
            return frame
        foot = self._levels.foot
        motion = before.sole(foot) @ feet.sole(foot).inverse()
        steps = float(_moved(before, feet))
        odometry = StepOdometry(motion.flattened(), steps, float(motion.translation[2]))
        imu = None if gap else frame.imu  # that of a part of the time would contradict the feet
        return replace(frame, odometry=odometry, imu=imu)

    def _missed(self, feet: FeetReading) -> bool:
        """Whether the foot that should stand is in the air: the landing of the other one got lost.

        Then the walk goes on from that one, and the ground is where it was to within a step.
        """
        levels = self._levels
        if not feet.lifted[0 if levels.foot > 0 else 1]:
            return False
        self._ground.move(Pose2(), 0.0, UNSEEN_STEP)
        self._obstacles.move(Pose2(), 0.0, UNSEEN_STEP)
        self._height_m2 += float(UNSEEN_STEP[3, 3])
        self._levels = replace(levels, foot=-levels.foot, landings=levels.landings + 1)
        self._landed, self._steps = None, 0.0
        return True

    def _follow(self, feet: FeetReading) -> None:
        """Move the frame of the maps to the foot that has landed."""
        levels = self._levels
        landed = self._steps > 0.5 or (self._landed is not None and _moved(self._landed, feet))
        now, self._landed = -levels.foot if landed else levels.foot, feet
        there = feet.sole(now)
        stands = self._walked @ there.flattened()
        if self._stood is None:
            self._stood = stands
        elif now != levels.foot:
            motion = self._stood.inverse() @ stands
            rise_m = float(there.translation[2] - feet.sole(-now).translation[2])
            self._ground.move(motion, rise_m, self._step_covariance)
            self._obstacles.move(motion, rise_m, self._step_covariance)
            self._height_m2 += RISE_SIGMA_M**2
            levels = replace(
                levels, landings=levels.landings + 1, ground_m=levels.ground_m + rise_m
            )
            self._stood = stands
        self._levels, self._steps = replace(levels, foot=now), 0.0

    def _observe(
        self, frame: Frame, feet: FeetReading, watch: Stopwatch
    ) -> tuple[RegistrationReport | None, tuple[LevelView, ...]]:
        """Fuse the depth images of a frame into the maps and the pose."""
        T_body_foot = feet.sole(self._levels.foot)
        T_foot_body = T_body_foot.inverse()
        raised = Pose3((0.0, 0.0, self._height(feet)[0]))
        report, views = None, []
        for sensor, depth in self._depths.images(frame, watch.stage):
            if depth.T_body_camera is None:
                continue
            reach = self.config.reach.of(sensor, depth)
            near = replace(reach, farthest_m=min(reach.farthest_m, GROUND_M))
            with watch.stage("ground"):  # risers farther off would be walls
                regions = segmentation.find(depth, near, self._floor, sensor)
                pose = T_foot_body @ depth.T_body_camera
                level = self._ground.observe(regions, pose, self._camera_covariance, depth.camera)
                turn = Rotation.from_matrix(level.rotation @ pose.rotation.T).as_rotvec()[:2]
                self._tilts.update(turn, self._camera_covariance[3:5, 3:5])
            with watch.stage("register"):
                scan = plane_scan(regions, T_body_foot @ level)
                report = self.pose_source.register_scan(scan, depth.T_body_camera) or report
            with watch.stage("obstacles"):
                cloud = points.from_depth(depth, near.nearest_m, near.farthest_m, near.stride)
                self._obstacles.observe(cloud, depth, pose, self._camera_covariance)
            T_map_foot = raised @ self.pose_source.pose2.lifted() @ T_body_foot
            view = LevelView(sensor, depth, T_map_foot @ level)
            with watch.stage("cloud"):
                colours = colours_of(cloud, depth, frame.colour)
                self.cloud.add(view.T_map_camera.apply(cloud.xyz), colours)
            views.append(view)
        return report, tuple(views)

    def _height(self, feet: FeetReading) -> tuple[float, float]:
        """Height of the body frame above the ground of the start, and its standard deviation, m."""
        sole_m = float(feet.sole(self._levels.foot).translation[2])
        return self._levels.ground_m - sole_m, math.sqrt(self._height_m2)


def _moved(before: FeetReading, now: FeetReading) -> bool:
    """Whether a foot stands elsewhere beside the other one than before."""
    one, other = (each.left.inverse() @ each.right for each in (before, now))
    rise_m = (now.right_m - now.left_m) - (before.right_m - before.left_m)
    away_m = math.hypot(other.x - one.x, other.y - one.y)
    turn_rad = abs((one.inverse() @ other).yaw)
    return max(away_m, abs(rise_m)) > STILL_M or turn_rad > STILL_RAD


def make_pipeline(config: Config, info: RecordingInfo) -> Pipeline | LevelPipeline:
    """The pipeline for the ground of a recording or a live run."""
    return LevelPipeline(config, info) if info.levels else Pipeline(config, info)
