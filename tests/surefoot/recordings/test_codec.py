"""Encoding of frames: its loss is bounded, and encoding again loses nothing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import ColourView, DepthView, Frame, Imu, RangeView, StepOdometry
from perception.primitives.pose import Pose2, Pose3
from surefoot.recordings.codec import decode, encode

CAMERA = Camera(5, 4, 4.0, 4.0, 2.0, 1.5)
metres = hnp.arrays(
    np.float32,
    (4, 5),
    elements=st.one_of(
        st.just(np.nan), st.floats(0, 30, width=32), st.floats(width=32, allow_subnormal=False)
    ),
)
amplitudes = hnp.arrays(
    np.float32, (4, 5), elements=st.one_of(st.just(np.nan), st.floats(0, 2.0**20, width=32))
)


def again(frame):
    return decode(encode(frame))


@given(metres, metres, amplitudes)
def test_encoding_depth_range_and_amplitude_again_changes_nothing(same, depth, range_m, amplitude):
    once = again(Frame(0.0, RangeView(range_m, amplitude, CAMERA), depth=DepthView(depth, CAMERA)))
    assert same(again(once), once)


@pytest.mark.parametrize("seed", range(10))
def test_encoding_a_frame_again_changes_only_its_colours(same, make_frame, seed):
    once = again(make_frame(seed, colour=None))
    assert same(again(once), once)


@given(hnp.arrays(np.float32, (4, 5), elements=st.floats(2.0**-7, 13.0, width=32)))
def test_depth_is_off_by_at_most_half_a_unit(depth):
    error = np.abs(again(Frame(0.0, depth=DepthView(depth, CAMERA))).depth.depth - depth)
    assert error.max() <= 0.5 / 5000 + 2e-6  # and the rounding of 13 m to float32


@given(hnp.arrays(np.float32, (4, 5), elements=st.floats(2.0**-7, 19.875, width=32)))
def test_range_is_off_by_at_most_half_a_unit(range_m):
    error = np.abs(again(Frame(0.0, RangeView(range_m, None, CAMERA))).tof.range_m - range_m)
    assert error.max() <= 0.5 * 5 / 2**14 + 2e-6


@given(hnp.arrays(np.float32, (4, 5), elements=st.floats(0, 2.0**20, width=32)))
def test_amplitude_is_off_by_at_most_a_65000th_of_the_greatest(amplitude):
    view = RangeView(np.ones((4, 5), np.float32), amplitude, CAMERA)
    error = np.abs(again(Frame(0.0, view)).tof.amplitude - amplitude)
    assert error.max() <= amplitude.max() / 65000


@pytest.mark.parametrize("per_metre", [1000, 5000])
def test_whole_millimetres_and_whole_tum_units_pass_unchanged(same, per_metre):
    units = np.arange(1, 13_000 * per_metre // 1000, 7, dtype=np.float64)
    depth = (units / per_metre).astype(np.float32)[None, :]
    camera = Camera(depth.shape[1], 1, 1.0, 1.0, 0.0, 0.0)
    assert same(again(Frame(0.0, depth=DepthView(depth, camera))).depth.depth, depth)


def test_depth_out_of_range_or_not_finite_is_dropped():
    depth = np.array([[13.2, -1.0, 0.0, np.inf, np.nan, 13.1]], np.float32)
    camera = Camera(6, 1, 1.0, 1.0, 0.0, 0.0)
    decoded = again(Frame(0.0, depth=DepthView(depth, camera))).depth.depth
    assert np.isnan(decoded[0, :5]).all()
    assert decoded[0, 5] == np.float32(13.1)


def test_a_stereo_pair_is_stored_without_loss(same, make_frame):
    frame = make_frame(3)
    assert same(again(frame).stereo, frame.stereo)


def test_colour_changes_by_a_few_grey_levels_and_stays_rgb(make_frame):
    rgb = np.zeros((32, 48, 3), np.uint8)
    rgb[..., 0] = np.linspace(100, 250, 48).astype(np.uint8)
    camera = Camera(48, 32, 40.0, 40.0, 24.0, 16.0)
    decoded = again(Frame(0.0, colour=ColourView(rgb, camera))).colour.rgb
    assert np.abs(decoded.astype(int) - rgb).mean() < 2.0
    assert decoded[..., 0].mean() > decoded[..., 2].mean() + 100


exact = st.floats(-1e11, 1e11)


@given(st.lists(exact, min_size=10, max_size=10), st.lists(exact, min_size=7, max_size=7))
def test_numbers_are_stored_without_loss(same, values, pose):
    turn = np.array(pose[3:]) if any(pose[3:]) else np.ones(4)
    frame = Frame(
        abs(values[0]),
        odometry=StepOdometry(Pose2(*values[1:4]), values[4]),
        imu=Imu(np.array(values[4:7]), np.array(values[7:10])),
        T_world_camera=Pose3(
            tuple(pose[:3]),
            tuple((turn / np.abs(turn).max() / np.linalg.norm(turn / np.abs(turn).max())).tolist()),
        ),
    )
    assert same(again(frame), frame)


@pytest.mark.parametrize(
    ("part", "value", "named"),
    [
        ("stamp_s", math.nan, "stamp_s"),
        ("odometry", StepOdometry(Pose2(math.inf, 0.0, 0.0), 0.5), "odometry"),
        ("imu", Imu(np.array([0.0, math.nan, 0.0]), np.zeros(3)), "imu"),
        ("T_world_camera", Pose3((math.nan, 0.0, 0.0)), "T_world_camera"),
        (
            "depth",
            DepthView(np.ones((4, 5), np.float32), CAMERA, Pose3((0.0, 0.0, math.inf))),
            "depth.T_body_camera",
        ),
    ],
)
def test_a_nonfinite_value_is_refused_by_name(make_frame, part, value, named):
    with pytest.raises(InputError, match=f"{named} is .*finite numbers below"):
        encode(make_frame(1, **{part: value}))
