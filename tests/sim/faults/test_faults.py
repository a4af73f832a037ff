"""Each fault does to a frame what its name says, while it lasts and not otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import ColourView, Frame, Imu, RangeView, StepOdometry
from perception.primitives.pose import Pose2, Pose3
from sim.faults.injection import KINDS, FaultConfig, FaultInjector, parsed

CAMERA = Camera(16, 12, 10.0, 10.0, 7.5, 5.5)
LOOKS_AHEAD = Pose3.from_rotation(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 0.4])
)
EVERY_S = 0.3


def frame(number: int) -> Frame:
    """The frame of that number: every picture has its number as content."""
    return Frame(
        EVERY_S * number,
        tof=RangeView(np.full((12, 16), 1.0 + number, np.float32), None, CAMERA, LOOKS_AHEAD),
        colour=ColourView(np.full((12, 16, 3), 20 + number % 200, np.uint8), CAMERA, LOOKS_AHEAD),
        odometry=StepOdometry(Pose2(0.03, 0.0, 0.0), 0.5),
        imu=Imu(np.zeros(3), np.array([0.0, 0.0, 9.81])),
    )


def arrived(fault: str, count: int = 20, seed: int = 0) -> list[Frame | None]:
    """The frames as the stack receives them: the fault acts on those from 3.0 to 4.5 s (10 to 14)."""
    injector = FaultInjector(FaultConfig((fault,), begin_s=2.95, last_s=1.5), seed)
    return [injector.apply(frame(number)) for number in range(count)]


@pytest.mark.parametrize("fault", [name for name in KINDS if name != "clock-drift"])
def test_a_fault_changes_frames_only_while_it_lasts(fault):
    def numbers(one: Frame) -> tuple[object, ...]:
        assert one.tof is not None
        assert one.colour is not None
        assert one.imu is not None
        poses = (one.tof.T_body_camera, one.odometry, one.stamp_s, one.imu.angular_velocity[2])
        return (one.tof.range_m.tobytes(), one.colour.rgb.tobytes(), *poses)

    changed = [
        number
        for number, one in enumerate(arrived(fault))
        if one is None or one.tof is None or numbers(one) != numbers(frame(number))
    ]
    assert changed
    assert set(changed) <= set(range(10, 15))


def test_frozen_cameras_repeat_the_last_picture_before():
    for one in arrived("frozen")[10:15]:
        assert one.tof.range_m[0, 0] == 1.0 + 9
        assert one.colour.rgb[0, 0, 0] == 20 + 9
        assert one.odometry is not None


def test_late_pictures_are_the_newest_that_are_old_enough():
    shown = [one.tof.range_m[0, 0] - 1.0 for one in arrived("late:0.5")[10:15]]
    assert shown == [8, 9, 10, 11, 12]


def test_half_blind_cameras_show_the_right_half():
    one = arrived("half-blind")[12]
    assert np.isnan(one.tof.range_m[:, :8]).all()
    assert np.isfinite(one.tof.range_m[:, 8:]).all()
    assert not one.colour.rgb[:, :8].any()
    assert one.colour.rgb[:, 8:].all()


def test_a_blackout_leaves_nothing():
    one = arrived("blackout")[12]
    assert np.isnan(one.tof.range_m).all()
    assert not one.colour.rgb.any()


def test_a_miscalibrated_camera_points_elsewhere_than_it_is_said_to():
    said = arrived("miscalibrated:3")[12].tof.T_body_camera
    axis = said.rotation[:, 2]
    assert math.degrees(math.asin(axis[2])) == pytest.approx(3.0, abs=0.01)  # up
    assert math.degrees(math.atan2(axis[1], axis[0])) == pytest.approx(-3.0, abs=0.01)  # right


def test_an_encoder_offset_turns_the_cameras_about_the_vertical():
    said = arrived("encoder-offset:5")[12].tof.T_body_camera
    x, y, z = said.rotation[:, 2]
    assert math.degrees(math.atan2(y, x)) == pytest.approx(5.0)
    assert z == pytest.approx(0.0, abs=1e-12)


def test_a_clock_that_jumps_comes_back():
    stamps = np.array([one.stamp_s for one in arrived("clock-jump:-2")])
    shift = stamps - EVERY_S * np.arange(20)
    np.testing.assert_allclose(shift[10:15], -2.0)
    np.testing.assert_array_equal(np.delete(shift, range(10, 15)), 0.0)


def test_a_drifting_clock_keeps_what_it_gained():
    stamps = np.array([one.stamp_s for one in arrived("clock-drift:0.1")])
    shift = stamps - EVERY_S * np.arange(20)
    np.testing.assert_allclose(shift[:10], 0.0)
    np.testing.assert_allclose(shift[14:], 0.1 * 5 * EVERY_S)


def test_a_slipping_foot_makes_the_joints_report_more_than_the_body_walks():
    odometry = arrived("slipping-foot:0.5")[12].odometry
    assert odometry.motion.x == pytest.approx(2 * 0.03)
    assert odometry.motion.yaw > 0.0
    standing = frame(12)
    injector = FaultInjector(FaultConfig(("slipping-foot",), begin_s=0.0), 0)
    still = injector.apply(replace(standing, odometry=StepOdometry(Pose2(), 0.0)))
    assert still.odometry.motion == Pose2()


def test_a_step_of_the_gyros_bias_is_about_the_vertical():
    rate = arrived("gyro-bias:10")[12].imu.angular_velocity
    np.testing.assert_allclose(np.degrees(rate), [0.0, 0.0, 10.0])


def test_lost_odometry_leaves_the_gyro():
    one = arrived("lost-odometry")[12]
    assert one.odometry is None
    assert one.imu is not None


def test_frames_are_dropped_with_their_share_and_the_same_with_the_same_seed():
    def lost(seed: int) -> list[bool]:
        injector = FaultInjector(FaultConfig(("dropped:0.2",), begin_s=0.0, last_s=1e4), seed)
        return [injector.apply(frame(number)) is None for number in range(1000)]

    assert 150 < sum(lost(1)) < 250  # 4 sigma
    assert lost(1) == lost(1)
    assert lost(1) != lost(2)


def test_the_evaluation_is_told_which_faults_touched_the_frames_since_it_asked():
    injector = FaultInjector(FaultConfig(("frozen", "lost-odometry"), begin_s=0.5), 0)
    told = []
    for number in range(4):
        injector.apply(frame(number))
        told.append(injector.touched())
    assert told == [[], [], ["frozen", "lost-odometry"], ["frozen", "lost-odometry"]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("froozen", "'froozen' is unknown; did you mean 'frozen'"),
        ("nothing", "choose frozen, late, "),
        ("frozen:1", "takes no value"),
        ("dropped:1.5", "between 0 and 1, such as dropped:0.2"),
        ("dropped:x", "expected a number"),
        ("dropped:", "expected a number"),
        ("late:nan", "expected a number"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_with_what_can(text, message):
    with pytest.raises(ConfigError, match=message):
        FaultConfig((text,))


def test_a_value_may_be_left_out():
    assert parsed("dropped") == ("dropped", 0.2)
    assert parsed("dropped:0.5") == ("dropped", 0.5)
