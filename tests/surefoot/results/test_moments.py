"""Moments come back from estimates.mcap as they were written; Foxglove's own reader decodes every message."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from mapping.objects.footprints import Footprint
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3
from planning.gaze.selection import DirectionMap
from surefoot.mcap_file import TopicWriter, messages
from surefoot.results.moment import (
    UNKNOWN,
    FloorSeen,
    Layers,
    Moment,
    Prediction,
    SurfaceSeen,
)
from surefoot.results.moment_messages import JSON_TOPICS, MOMENT
from surefoot.results.moments import ESTIMATES, MomentWriter, held, read_moments
from surefoot.results.run_folder import RunFolder

LENS = Camera(64, 48, 60.0, 61.0, 31.0, 23.0, (0.1, 0.0, 0.0, 0.0, 0.01))


def gaussian(rng, n):
    root = rng.standard_normal((n, n))
    return Gaussian(rng.standard_normal(n), root @ root.T)


def full_moment(rng, stamp_s):
    probability = rng.integers(0, 256, (7, 7)).astype(np.uint8)
    height = (rng.integers(-400, 400, (7, 7)) / 256).astype(np.float32)
    height[probability == UNKNOWN] = np.nan
    obstacles = tuple(
        Obstacle(gaussian(rng, 4), 0.1, 0.4, k, 0.7, stamp_s - 0.3, 0.1) for k in range(2)
    )
    predictions = tuple(
        tuple(Prediction(t, 0.5, *vars(gaussian(rng, 2)).values()) for t in (1.0, 2.0))
        for _ in obstacles
    )
    quat = rng.standard_normal(4)
    camera = Pose3(tuple(rng.standard_normal(3).tolist()), tuple(quat / np.linalg.norm(quat)))
    return Moment(
        stamp_s,
        gaussian(rng, 3),
        {"tof": camera, "colour": Pose3()},
        {"tof": LENS, "colour": LENS},
        (0.3, -0.1),
        rng.standard_normal((2, 4)),
        rng.standard_normal((6, 3)),
        rng.standard_normal((4, 2)),
        rng.standard_normal(2),
        (0.2, 0.4),
        DirectionMap(
            rng.integers(0, 256, (5, 3)) / 255.0,
            np.linspace(-1.5, 1.5, 5),
            np.linspace(0.0, 1.0, 3),
        ),
        "walk",
        ("tof frozen",),
        0.07,
        {"tof": FloorSeen(np.array([0.0, -0.9, -0.4]), 0.39, np.eye(3) * 1e-6, 0.7)},
        Layers(np.array([-1.2, 3.4]), 0.05, probability, probability[::-1].copy(), height),
        obstacles,
        predictions,
        None,
        {"floor": 6.5, "map": 1.0},
        b"RIFF a picture",
        "colour",
        rng.integers(0, 256, (48, 64)).astype(np.uint8),
        1 / 64,
        "tof",
        rng.standard_normal(3),
        0.002,
        tuple(SurfaceSeen(rng.standard_normal((n, 3)), rng.integers(0, 3, n)) for n in (3, 7)),
    )


def assert_same(one, other, name=""):
    if dataclasses.is_dataclass(one):
        for part in dataclasses.fields(one):
            assert_same(getattr(one, part.name), getattr(other, part.name), part.name)
    elif isinstance(one, dict):
        assert list(one) == list(other), name
        for key in one:
            assert_same(one[key], other[key], f"{name} {key}")
    elif isinstance(one, (tuple, list)):
        assert len(one) == len(other), name
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, name)
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, name
        np.testing.assert_array_equal(one, other, err_msg=name)
    else:
        assert one == other, name


@pytest.fixture
def run(tmp_path):
    return RunFolder.create(tmp_path / "run")


def write(run, moments, footprints=()):
    writer = MomentWriter(run)
    for moment in moments:
        writer.write(moment)
    writer.close(footprints)


def test_every_field_of_a_moment_comes_back_to_the_bit(run):
    rng = np.random.default_rng(1)
    moments = [full_moment(rng, 0.45), Moment(0.65), full_moment(rng, 1.3)]
    outline = rng.standard_normal((4, 2))
    sides = np.array([True, True, False, False]), np.array([0.01, 0.02, np.nan, np.nan])
    footprint = Footprint(outline, *sides, 0.4, 0.01, 0.9, False, 40, None)
    write(run, moments, (footprint,))
    read = list(read_moments(run))
    assert_same(list(read_moments(str(run.root))), read)
    moments[-1] = dataclasses.replace(moments[-1], footprints=(footprint,))
    assert_same(read, moments)


def test_what_is_not_finite_comes_back_as_nan(run):
    state = Gaussian(np.zeros(3), np.diag([np.inf, np.nan, 1.0]))
    lost = Obstacle(Gaussian(np.zeros(4), np.eye(4)), np.nan, 0.4, 3, 0.5, -np.inf, 0.0)
    write(run, [Moment(1.0, state, tracks=(lost,))])
    (read,) = read_moments(run)
    np.testing.assert_array_equal([read.tracks[0].radius_m, read.tracks[0].seen_s], [np.nan] * 2)
    np.testing.assert_array_equal(np.diag(read.pose.covariance), [np.nan, np.nan, 1.0])


def test_foxgloves_transforms_lead_to_the_same_cameras(run):
    moment = full_moment(np.random.default_rng(2), 2.0)
    write(run, [moment])
    with run.path(ESTIMATES).open("rb") as file:
        decoded = list(
            make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
                "/estimate/tf"
            )
        )
    (_, _, message, tree) = decoded[0]
    assert message.log_time == 2_000_000_000
    poses = {
        t.child_frame_id: (
            t.parent_frame_id,
            Pose3(
                (t.translation.x, t.translation.y, t.translation.z),
                (t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w),
            ),
        )
        for t in tree.transforms
    }
    assert {child: parent for child, (parent, _) in poses.items()} == {
        "body": "map",
        "tof_camera": "body",
        "colour_camera": "body",
    }
    body = poses["body"][1]
    np.testing.assert_allclose(body.matrix, Pose2(*moment.pose.mean).lifted().matrix, atol=1e-12)
    for sensor, pose in moment.cameras.items():
        there = body @ poses[f"{sensor}_camera"][1]
        np.testing.assert_allclose(there.matrix, pose.matrix, atol=1e-9)


def test_what_a_moment_does_not_bring_is_held(run):
    rng = np.random.default_rng(3)
    first = full_moment(rng, 1.0)
    decided = Moment(3.0, why="blocked")
    again, blocked = list(held([first, Moment(2.0), decided]))[1:]
    assert again.stamp_s == 2.0
    for name in ("steps", "route", "goal", "why", "risk", "grid", "colour", "depth"):
        assert getattr(again, name) is getattr(first, name)
    assert again.tracks == ()
    assert blocked.why == "blocked"
    assert blocked.goal is None
    assert blocked.grid is first.grid


def test_a_file_cut_anywhere_gives_the_moments_before_the_cut(run):
    rng = np.random.default_rng(4)
    moments = [full_moment(rng, 0.5 * k) for k in range(12)]
    write(run, moments)
    whole = run.path(ESTIMATES).read_bytes()
    lengths = []
    for cut in rng.integers(20, len(whole), 12):
        run.path(ESTIMATES).write_bytes(whole[:cut])
        read = [dataclasses.replace(one, footprints=None) for one in read_moments(run)]
        assert_same(read, moments[: len(read)])
        lengths.append((cut, len(read)))
    ordered = [n for _, n in sorted(lengths)]
    assert ordered == sorted(ordered)
    assert ordered[-1] > 6


def test_a_run_without_estimates_says_what_to_do(run):
    with pytest.raises(RecordingError, match="make the run again"):
        list(read_moments(run))
    run.path(ESTIMATES).write_bytes(b"no MCAP at all")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        list(read_moments(run))


def test_the_modes_of_a_track_stand_in_the_moment_by_name(run):
    tracker = ObstacleTracker()
    for k in range(20):
        seen = Detection(np.array([1.0, 0.03 * k]), np.eye(2) * 1e-4, 0.1)
        tracker.update(0.3 * k, [seen], Gaussian(np.zeros(3), np.eye(3) * 1e-8))
    write(run, [Moment(1.0, tracks=tuple(tracker.obstacles), predictions=((),))])
    found = [json.loads(m.data) for topic, m in messages(run.path(ESTIMATES)) if topic == MOMENT]
    modes = found[0]["tracks"][0]["modes"]
    assert list(modes) == ["still", "pausing", "straight", "curving", "turned"]
    assert sum(modes.values()) == pytest.approx(1.0)
    assert modes["straight"] + modes["curving"] > 0.8


def test_a_damaged_moment_is_one_error_that_names_it(run):
    write(run, [Moment(1.0), Moment(2.0)])
    good = run.path(ESTIMATES)
    for wrong in ({"stamp_s": 2.0}, {"stamp_s": [], "pose": 3}, {}):
        topics = TopicWriter(good, JSON_TOPICS, "estimates")
        topics.add(MOMENT, wrong, 1, 1)
        topics.close()
        with pytest.raises(RecordingError, match="moment 1 is damaged"):
            list(read_moments(run))
