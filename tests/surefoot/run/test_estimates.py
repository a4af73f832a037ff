"""estimates.mcap of a live walk: Foxglove's reader decodes it, frames connect, stamps agree with the tables."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections import defaultdict

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from perception.primitives.pose import Pose2, Pose3, wrap_angle
from surefoot.config.schema import Config
from surefoot.mcap_file import nanoseconds
from surefoot.report import viewers
from surefoot.results.moment_drawings import SURFACES
from surefoot.results.moments import ESTIMATES, held, read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate

SECONDS = 7.0


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """The run folder of a walk whose camera pictures are small."""
    config = Config()
    small = dataclasses.replace(config.robot.colour_camera, width=160, height=160)
    robot = dataclasses.replace(config.robot, stereo=False, colour_camera=small)
    mission = dataclasses.replace(config.mission, time_limit_s=SECONDS)
    config = dataclasses.replace(config, robot=robot, mission=mission)
    out = tmp_path_factory.mktemp("estimates") / "walk"
    simulate.simulate(config, out, False, lambda text: None)
    return RunFolder.open(out)


@pytest.fixture(scope="module")
def decoded(walk):
    """(log time, message) by topic."""
    found = defaultdict(list)
    with walk.path(ESTIMATES).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                assert schema.encoding == "jsonschema"
                continue
            (factory,) = reader._decoder_factories
            decode = factory.decoder_for(channel.message_encoding, schema)
            found[channel.topic].append((message.log_time, decode(message.data)))
    return found


@pytest.fixture(scope="module")
def poses(walk):
    """Rows stamp, x, y, yaw of trajectory_covariance.csv by their stamp in nanoseconds."""
    table = walk.read_csv("trajectory_covariance.csv")
    rows = table.matrix("stamp_s", "x_m", "y_m", "yaw_rad")
    return {nanoseconds(row[0]): row for row in rows}


def test_foxgloves_reader_decodes_every_message(decoded):
    assert set(decoded) == {
        "/estimate/tf", "/estimate/odometry", "/estimate/grid", "/estimate/colour", "/estimate/depth",
        "/estimate/depth/calibration", "/estimate/robot", "/estimate/floor", "/estimate/tracks", "/estimate/footprints_drawn",
        "/head/joints", "/plan/route", "/plan/steps", "/plan/why", "/plan/gaze",
    }  # fmt: skip
    stamped = [one for topic in decoded for one in decoded[topic]]
    for log_time, message in stamped:
        if hasattr(message, "timestamp"):
            at = message.timestamp
            assert 10**9 * at.seconds + at.nanos == log_time


def test_every_topic_of_the_layout_is_in_the_file(decoded, tmp_path):
    text = viewers.write_layout(tmp_path / "layout.json").read_text()
    named = set(re.findall(r"/(?:estimate|plan|head)/[a-z_/]+", text))
    assert named
    assert SURFACES in named  # of a walk over several levels: test_level_walk
    assert named - {SURFACES} <= {*decoded, "/estimate/moment"}


def test_every_number_that_the_layout_plots_is_in_every_moment_that_has_a_decision(walk, tmp_path):
    text = viewers.write_layout(tmp_path / "layout.json").read_text()
    plotted = re.findall(r"/estimate/moment\.([a-z_]+)", text)
    assert set(plotted) == {"pose", "risk"}
    for one in read_moments(walk):
        if one.why:
            assert all(getattr(one, name) is not None for name in plotted)


def test_the_floor_is_drawn_where_the_floor_is(decoded):
    tree = {
        (at, one.child_frame_id): one
        for at, message in decoded["/estimate/tf"]
        for one in message.transforms
    }
    seen = 0
    for at, message in decoded["/estimate/floor"]:
        for entity in message.entities:
            chain, frame = Pose3(), entity.frame_id
            while frame != "map":
                one = tree[at, frame]
                move, turn = one.translation, one.rotation
                chain = Pose3((move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w)) @ chain
                frame = one.parent_frame_id
            (square,) = entity.cubes
            place, turn = square.pose.position, square.pose.orientation
            drawn = chain @ Pose3((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))
            assert abs(drawn.translation[2]) < 0.02
            assert drawn.matrix[2, 2] > np.cos(np.radians(2.0))
            assert 0.0 < square.size.z < 0.05
            seen += 1
    assert seen > 10


def test_every_frame_of_the_walk_has_its_transforms_and_they_agree_with_the_table(decoded, poses):
    assert [at for at, _ in decoded["/estimate/tf"]] == list(poses)
    seen = set()
    for at, message in decoded["/estimate/tf"]:
        tree = {one.child_frame_id: one for one in message.transforms}
        for child in tree:
            seen.add(child)
            chain, frame = Pose3(), child
            while frame != "map":
                one = tree[frame]
                move, turn = one.translation, one.rotation
                chain = Pose3((move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w)) @ chain
                frame = one.parent_frame_id
            if child == "body":
                _, x, y, yaw = poses[at]
                np.testing.assert_allclose(
                    chain.matrix, Pose2(x, y, yaw).lifted().matrix, atol=1e-9
                )
            else:
                assert 0.3 < chain.translation[2] < 0.5
    assert seen == {"body", "tof_camera", "colour_camera"}


def test_odometry_has_the_covariance_of_the_table(decoded, walk):
    table = walk.read_csv("trajectory_covariance.csv").matrix("P_xx", "P_xyaw", "P_yawyaw")
    found = [message.pose_covariance for _, message in decoded["/estimate/odometry"]]
    np.testing.assert_array_equal([[P[0], P[5], P[35]] for P in found], table)


def test_a_foot_on_the_floor_stays_and_the_feet_are_beside_the_body(walk):
    feet = [(one.feet, one.pose.mean) for one in read_moments(walk)]
    lifted = 0
    for (before, _), (now, _) in itertools.pairwise(feet):
        for side in range(2):
            lifted += now[side, 3]
            if before[side, 3] == now[side, 3] == 0.0 and before[1 - side, 3] == 1.0:
                assert np.hypot(*(now[side] - before[side])[:2]) < 0.01  # slip, and pose errors
    assert lifted >= 3
    for now, body in feet:
        gap = np.hypot(*(now[0] - now[1])[:2])
        assert 0.07 < gap < 0.15
        np.testing.assert_allclose(now[:, :2].mean(axis=0), body[:2], atol=0.01)


def test_the_plan_ahead_begins_with_the_commanded_step_and_leads_on(walk):
    commands = walk.read_csv("commands.csv").matrix("stamp_s", "forward_m", "turn_rad")
    decided = [one for one in read_moments(walk) if one.why]
    assert [one.stamp_s for one in decided] == commands[:, 0].tolist()
    walked = 0
    for one, (_, forward_m, turn_rad) in zip(decided, commands, strict=True):
        np.testing.assert_array_equal(one.goal, decided[0].goal)
        steps = one.steps
        turned = wrap_angle(steps[1, 2] - steps[0, 2])
        assert abs(turned) <= np.radians(14.0) + 1e-9
        if forward_m > 0.0:
            walked += 1
            half = 0.6 * forward_m + 0.05  # the body follows its feet by half a step
            assert np.hypot(*(steps[0, :2] - one.pose.mean[:2])) < forward_m + half
            assert abs(wrap_angle(steps[0, 2] - one.pose.mean[2] - turn_rad)) < np.radians(14.0)
        assert one.risk >= 0.0
    assert walked >= 2


def test_pictures_come_once_a_footstep_and_hold_between(walk):
    moments = list(read_moments(walk))
    pictured = [one.stamp_s for one in moments if one.colour]
    assert np.diff(pictured).max() < 1.4
    assert np.diff(pictured).min() > 0.59
    last = list(held(moments))[-1]
    assert last.colour is not None
    assert last.depth.shape == (144, 176)
    assert last.depth_step_m * last.depth.max() < 5.0
    assert last.footprints is not None
