"""The public pipeline: the same as `process`, and nothing is left aside without a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surefoot
from perception.floor.classify import ClassConfig
from perception.primitives.pose import head_rotation
from surefoot.recordings.open import open_recording

WALK = Path(__file__).resolve().parents[3] / "data" / "walk"
CAMERA = surefoot.Camera.from_view(80, 60, 1.0, 0.8)
MOUNT = surefoot.Pose3.from_rotation(head_rotation(0.0, 0.6), np.array([0.0, 0.0, 0.9]))
UTM = surefoot.Pose3((500000.0, 5.2e6, 120.7), MOUNT.quat_xyzw)


def floor_depth() -> np.ndarray:
    """Depth of the floor as seen by a camera mounted at `MOUNT`, m."""
    rays = CAMERA.rays @ MOUNT.rotation.T
    depth = 0.9 / -rays[..., 2]
    return np.where((depth > 0.0) & (depth < 4.0), depth, np.nan).astype(np.float32)


def test_frames_one_by_one_give_the_poses_and_tracks_of_process():
    recording = open_recording(WALK)
    info = recording.info
    assert info.start is not None
    pipeline = surefoot.Pipeline(
        landmarks=info.landmarks,
        start=info.start,
        start_covariance=info.start_covariance,
        up_world=info.gravity_up_world,
    )
    worlds = []
    for frame in recording.frames():
        worlds.append(pipeline.add_frame(frame))
        if len(worlds) == 8:
            break
    run = surefoot.process(WALK, config=surefoot.Config())
    assert run.trajectory is not None
    for k, world in enumerate(worlds):
        assert world.pose is not None
        np.testing.assert_array_equal(run.trajectory.poses[k], world.pose.mean)
    assert worlds[-1].grid is not None
    assert worlds[-1].confidence is not None
    assert worlds[-1].floor is not None
    assert pipeline.world is worlds[-1]


@pytest.mark.parametrize("height_m", [0.46, 1.3])
def test_what_hangs_is_an_obstacle_of_a_robot_that_does_not_fit_below_it(height_m):
    """A board from 0.75 to 1.1 m above the floor, 1.4 m ahead; the robot passes below it or hits its chest."""
    mount = surefoot.Pose3.from_rotation(head_rotation(0.0, 0.2), np.array([0.0, 0.0, 0.9]))
    rays = CAMERA.rays @ mount.rotation.T
    with np.errstate(divide="ignore"):
        floor, board = np.where(rays[..., 2] < 0.0, -0.9 / rays[..., 2], np.inf), 1.4 / rays[..., 0]
    left, up = board * rays[..., 1], 0.9 + board * rays[..., 2]
    hit = (np.abs(left) < 0.15) & (up > 0.75) & (up < 1.1)
    depth = np.where(hit, board, np.minimum(floor, 3.5 / rays[..., 0])).astype(np.float32)
    config = surefoot.Config(classes=ClassConfig(robot_height_m=height_m))
    pipeline = surefoot.Pipeline(config, start=surefoot.Pose2())
    for k in range(6):
        step = surefoot.Pose2() if k else None
        world = pipeline.add(0.3 * k, depth_m=depth, camera=CAMERA, T_body_camera=mount, step=step)
    near = [one for one in world.tracks if np.hypot(*(one.position - [1.4, 0.0])) < 0.2]
    assert len(near) == (height_m > 0.5)


def test_arrays_of_a_walking_body_give_pose_floor_and_grid():
    pipeline = surefoot.Pipeline(start=surefoot.Pose2(1.0, 2.0, 0.0))
    for k in range(4):
        world = pipeline.add(
            0.3 * k,
            depth_m=floor_depth(),
            camera=CAMERA,
            T_body_camera=MOUNT,
            step=surefoot.Pose2(0.02, 0.0, 0.0) if k else None,
        )
    assert world.pose is not None
    assert world.pose.mean == pytest.approx([1.06, 2.0, 0.0], abs=0.02)
    assert world.floor is not None
    assert world.floor.offset_m == pytest.approx(0.9, abs=0.005)
    assert world.grid is not None
    assert world.grid.known.any()
    assert world.tracks == ()
    assert pipeline.footprints() == []


def test_calibrated_depth_has_a_floor_with_a_smaller_standard_deviation():
    sigma_m = {}
    for calibrated in (False, True):
        pipeline = surefoot.Pipeline(up_world=(0.0, 0.0, 1.0), calibrated=calibrated)
        world = pipeline.add(0.0, depth_m=floor_depth(), camera=CAMERA, T_world_camera=MOUNT)
        assert world.floor is not None
        sigma_m[calibrated] = np.sqrt(world.floor.covariance[2, 2])
    assert sigma_m[True] < sigma_m[False] / 4.0


def test_settings_may_come_from_a_file(tmp_path):
    file = tmp_path / "far.toml"
    file.write_text("[reach.depth]\nfarthest_m = 0.5\n")
    given = {"depth_m": floor_depth(), "camera": CAMERA, "T_body_camera": MOUNT}
    seen = {}
    for config in (None, file):
        world = surefoot.Pipeline(config, start=surefoot.Pose2()).add(0.0, **given)
        seen[config] = sum(len(view.points) for view in world.estimate.views)
    assert seen[None] > 500
    assert seen[file] == 0


def test_given_poses_place_the_camera():
    pipeline = surefoot.Pipeline(up_world=(0.0, 0.0, 1.0))
    for k in range(3):
        pose = surefoot.Pose3.from_rotation(MOUNT.rotation, np.array([0.1 * k, 0.0, 0.9]))
        world = pipeline.add(0.1 * k, depth_m=floor_depth(), camera=CAMERA, T_world_camera=pose)
    assert world.pose is not None
    assert world.pose.mean == pytest.approx([0.2, 0.0, 0.0], abs=1e-6)


def test_millimetres_without_a_scale_are_refused():
    pipeline = surefoot.Pipeline()
    with pytest.raises(surefoot.InputError, match="scale_per_metre"):
        pipeline.add(0.0, depth_m=np.full((60, 80), 1500, np.uint16), camera=CAMERA)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([{}], "empty"),
        ([{"stamp_s": 1.0}, {"stamp_s": 1.0}], "larger than the previous"),
        ([{"left": np.zeros((60, 80), np.uint8)}], "baseline_m"),
        ([{"rgb": np.zeros((60, 80, 3))}], "uint8"),
        ([{"depth": True}, {"depth": True, "T_world_camera": MOUNT}], "comes late"),
        ([{"depth": True, "T_world_camera": UTM}], "within 10000 m"),
    ],
)
def test_frames_that_cannot_be_used_are_refused(frames, message):
    pipeline = surefoot.Pipeline()

    def feed() -> None:
        for k, frame in enumerate(frames):
            given = {"stamp_s": 0.1 * k, "camera": CAMERA, **frame}
            if given.pop("depth", False) or "stamp_s" in frame:
                given["depth_m"] = floor_depth()
            pipeline.add(given.pop("stamp_s"), **given)

    with pytest.raises(surefoot.InputError, match=message):
        feed()


def test_with_a_start_an_image_needs_its_mount():
    pipeline = surefoot.Pipeline(start=surefoot.Pose2())
    with pytest.raises(surefoot.InputError, match="T_body_camera"):
        pipeline.add(0.0, depth_m=floor_depth(), camera=CAMERA)


@pytest.mark.parametrize("place", [np.nan, 1e300])
def test_a_frame_with_an_impossible_pose_is_refused_and_the_next_one_taken(place):
    pipeline = surefoot.Pipeline(up_world=(0.0, 0.0, 1.0))

    def add(k: int, x: float) -> surefoot.WorldModel:
        pose = surefoot.Pose3((x, 0.0, 0.9), MOUNT.quat_xyzw)
        return pipeline.add(0.1 * k, depth_m=floor_depth(), camera=CAMERA, T_world_camera=pose)

    add(0, 0.0)
    with pytest.raises(surefoot.InputError, match=r"T_world_camera.*finite numbers"):
        add(1, place)
    world = add(2, 0.2)
    assert world.pose is not None
    assert world.pose.mean == pytest.approx([0.2, 0.0, 0.0], abs=1e-6)
