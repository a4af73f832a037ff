"""Recordings without poses: RGB-D odometry as the pose source of the pipeline."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import surefoot
from perception.depth.reach import ReachConfig, ReachesConfig
from perception.localisation.pose_source import PoseSource
from perception.odometry.odometry import FIRST, LOST, TRACKED
from perception.odometry.odometry_poses import OdometryPoses
from perception.odometry.rgbd_odometry import Odometer, OdometerConfig
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, wrap_angle
from surefoot.config.schema import Config
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.run.pipeline import Pipeline


def test_the_map_frame_is_upright_and_the_trajectory_agrees_with_ground_truth(
    recordings: Path,
) -> None:
    recording = open_recording(recordings / "redwood_livingroom")
    info = replace(recording.info, poses_given=False)
    pipeline = Pipeline(Config(), info)
    tracked = pipeline.pose_source
    assert isinstance(tracked, OdometryPoses)
    assert isinstance(tracked, PoseSource)
    heights = (0.443, 0.466, 0.491, 0.516, 0.541)  # m, from the set's own description
    first = None
    for frame, height in zip(recording.frames(), heights, strict=True):
        true = frame.T_world_camera
        assert true is not None
        estimate = pipeline.cycle(replace(frame, T_world_camera=None)).estimate
        found = tracked.T_map_camera
        assert found is not None
        assert estimate.pose is not None
        assert found.translation[2] == pytest.approx(height, abs=0.02)
        first = first or (found, true)
        off = (first[1].inverse() @ true).inverse() @ (first[0].inverse() @ found)
        assert np.linalg.norm(off.position) < 0.005
        assert np.linalg.eigvalsh(estimate.pose.covariance)[0] > 0.0
    assert tracked.odometer.states == [FIRST] + [TRACKED] * 4


@pytest.mark.parametrize("name", ["sevenscenes_redkitchen/pan", "tum_fr3_cabinet"])
def test_live_poses_are_consistent_with_their_covariance(recordings: Path, name: str) -> None:
    """The mean NEES is at most twice the three degrees of freedom."""
    tracked = OdometryPoses(np.random.default_rng(0))
    start: Pose3 | None = None  # T_map_world of ground truth
    squares = []
    for frame in open_recording(recordings / name).frames():
        true = frame.T_world_camera
        assert true is not None
        tracked.update(replace(frame, T_world_camera=None), [])
        found, pose = tracked.T_map_camera, tracked.pose
        if found is None or pose is None:
            continue
        if start is None:
            start = found @ true.inverse()
            continue
        there = start @ true
        ahead = there.rotation[:, 2]
        off = pose.mean - np.array([*there.position[:2], math.atan2(ahead[1], ahead[0])])
        off[2] = wrap_angle(off[2])
        squares.append(off @ np.linalg.solve(pose.covariance, off))
    assert len(squares) > 20
    assert 0.3 < np.mean(squares) < 6.0


def test_unrelated_single_images_are_placed_above_their_own_floor(recordings: Path) -> None:
    recording = open_recording(recordings / "realsense_low_boxes")
    tracked = OdometryPoses(np.random.default_rng(0), OdometerConfig(loops=False))
    for frame in islice(recording.frames(), 3):
        tracked.update(frame, [])
    assert tracked.odometer.states == [FIRST, LOST, LOST]
    assert tracked.pose is None
    floor = Plane(np.array([0.0, -1.0, 0.0]), 0.2)
    placed = tracked.place(None, floor)
    assert placed is not None
    assert placed.T_map_camera.translation == pytest.approx((0.0, 0.0, 0.2))
    assert tracked.place(None, None) is None


def test_the_status_of_a_live_run_says_that_the_camera_is_lost(recordings: Path) -> None:
    """Two unrelated images after each other: where the second was taken is not known."""
    frames = islice(open_recording(recordings / "realsense_low_boxes").frames(), 2)
    pipeline = surefoot.Pipeline()
    first, second = (pipeline.add_frame(replace(one, T_world_camera=None)) for one in frames)
    assert first.estimate.status == ()
    assert [one.words for one in second.estimate.status] == ["lost"]


def test_frames_without_depth_give_no_pose(recordings: Path) -> None:
    tracked = OdometryPoses(np.random.default_rng(0))
    assert tracked.update(Frame(0.0), []) is None
    assert tracked.pose is None
    with pytest.raises(InputError, match="no depth"):
        Odometer(np.random.default_rng(0)).track(Frame(0.0))


def test_the_reach_that_a_user_sets_counts_for_the_floor_of_the_odometry() -> None:
    """A level camera 1.7 m above the floor, whose lowest row sees it 7.4 m ahead."""
    camera = Camera(160, 120, 260.0, 260.0, 79.5, 59.5)
    below = (np.mgrid[:120, :160][0] - 59.5) / 260.0
    z = (1.7 / np.where(below > 0.02, below, np.nan)).astype(np.float32)
    config = Config(reach=ReachesConfig(depth=ReachConfig(0.3, 12.0, 2)))
    source = Pipeline(config, RecordingInfo("hand", "plain")).pose_source
    assert isinstance(source, OdometryPoses)
    source.odometer.track(Frame(0.0, depth=DepthView(z, camera)))
    assert source.odometer.T_world_start is not None
    assert source.odometer.T_world_start.position[2] == pytest.approx(1.7, abs=0.03)
