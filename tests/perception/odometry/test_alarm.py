"""The failure alarm: silent on good motion, loud on jumps, misfits, losses and frozen pictures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.odometry.alarm import Alarm, AlarmConfig
from perception.odometry.alignment import Alignment
from perception.odometry.odometry import FIRST, LOST, RELOCALISED, RESTARTED, TRACKED, Step
from perception.odometry.pyramid import Level, Pyramid
from perception.odometry.rgbd_odometry import Odometer, OdometerConfig
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.pose import Pose3

SMALL = Camera(4, 3, 4.0, 4.0, 1.5, 1.0)


def picture(number: int) -> Pyramid:
    z = np.full((3, 4), 1.0 + 0.001 * number, np.float32)
    return Pyramid((Level(z, z, z, SMALL, np.ones((3, 4), np.uint8)),))


def step(pose: Pose3, state: str = TRACKED, fitting: float = 0.95) -> Step:
    good = Alignment(pose, 1e-6 * np.eye(6), fitting, 0.9, 0.005, 1.0)
    aligned = None if state in (FIRST, LOST, RESTARTED) else good
    return Step(state, pose, pose, np.eye(6), 0, aligned)


def swing(n: int, seed: int = 0) -> list[Pose3]:
    """A camera that swings by hand, with noise of a millimetre and a tenth of a degree."""
    rng = np.random.default_rng(seed)
    poses = []
    for k in range(n):
        off, turn = 0.001 * rng.normal(size=3), 0.002 * rng.normal(size=3)
        R = Rotation.from_rotvec(np.array([0.1 * np.sin(k / 20), 0.5 * np.sin(k / 35), 0]) + turn)
        poses.append(
            Pose3.from_rotation(R.as_matrix(), np.array([np.sin(k / 25), 0, k / 99]) + off)
        )
    return poses


def heard(steps: list[Step], pictures: list[Pyramid] | None = None) -> list[float]:
    alarm = Alarm()
    pictures = pictures or [picture(n) for n in range(len(steps))]
    return [alarm.note(one, image) for one, image in zip(steps, pictures, strict=True)]


def test_a_camera_that_swings_by_hand_raises_no_alarm():
    steps = [step(pose, FIRST if n == 0 else TRACKED) for n, pose in enumerate(swing(1000))]
    assert max(heard(steps)) < 0.5


@pytest.mark.parametrize(("metres", "degrees"), [(0.3, 0.0), (0.0, 15.0)])
def test_a_jump_raises_the_alarm_at_once(metres, degrees):
    poses = swing(60)
    jump = Pose3.from_rotation(
        Rotation.from_euler("y", degrees, degrees=True).as_matrix(), np.array([metres, 0.0, 0.0])
    )
    moved = poses[:40] + [jump @ pose for pose in poses[40:]]
    found = heard([step(pose, FIRST if n == 0 else TRACKED) for n, pose in enumerate(moved)])
    assert max(found[:40]) < 0.5 <= found[40]


def test_worse_overlap_makes_a_failure_more_probable():
    poses = swing(30)
    found = [
        heard([step(pose) for pose in poses[:-1]] + [step(poses[-1], fitting=share)])[-1]
        for share in (0.98, 0.9, 0.8, 0.7)
    ]
    assert found == sorted(found)
    assert found[-1] > 5 * found[0]


def test_lost_and_relocalised_images_raise_the_alarm_and_the_next_ones_do_not():
    poses = swing(30)
    states = [FIRST] + [TRACKED] * 9 + [LOST] * 3 + [RESTARTED, RELOCALISED] + [TRACKED] * 15
    found = heard([step(pose, state) for pose, state in zip(poses, states, strict=True)])
    assert found[10:15] == [1.0] * 5
    assert max(found[15:]) < 0.5


def test_a_picture_that_repeats_the_one_before_raises_the_alarm():
    poses = swing(30)
    pictures = [picture(n if n < 20 else 19) for n in range(30)]
    found = heard([step(pose) for pose in poses], pictures)
    assert max(found[:20]) < 0.5
    assert found[20:] == [1.0] * 10


def test_a_frozen_camera_is_noticed_by_the_odometer():
    rng = np.random.default_rng(0)
    camera = Camera(80, 60, 70.0, 70.0, 39.5, 29.5)
    slope = np.linspace(1.0, 1.6, 80, dtype=np.float32)
    odometer = Odometer(np.random.default_rng(0), OdometerConfig(loops=False))
    views = [slope + 0.003 * rng.standard_normal((60, 80)).astype(np.float32) for _ in range(3)]
    for n, view in enumerate([*views, views[-1]]):
        odometer.track(Frame(0.1 * n, depth=DepthView(view, camera)))
    assert len(odometer.failures) == 4
    assert odometer.failures[-1] == 1.0


def test_a_threshold_outside_of_the_probabilities_is_refused():
    with pytest.raises(ConfigError, match=r"threshold=0.0 must lie above 0"):
        AlarmConfig(0.0)
