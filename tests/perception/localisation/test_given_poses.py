"""The floor that a pose source expects: fused over a whole recording, and with a given vertical that is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from perception.floor.refine import fuse
from perception.localisation.given_poses import GivenPoses
from perception.localisation.pose_source import PriorConfig
from perception.primitives.frame import Frame
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

LEVEL = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
SIGMA = np.diag([np.radians(1.0) ** 2, np.radians(1.0) ** 2, 0.02**2])


def walk(up_world, bias=(0.0, 0.0, 0.0), steps=40):
    """Expected, true and fused floor of each frame of a walk of 8 m; every floor has the same error `bias`."""
    source = GivenPoses(up_world, PriorConfig())
    for k in range(steps):
        turn = head_rotation(0.1 * np.sin(0.3 * k), np.radians(35.0))
        pose = Pose3.from_rotation(turn, np.array([0.2 * k, 0.0, 1.2]))
        source.update(Frame(float(k), T_world_camera=pose), ())
        expected = source.expected_floor(None)
        true = LEVEL.moved(pose.inverse())
        normal = true.normal + np.array(bias[:2]) @ true.tangents
        seen = Plane(normal / np.linalg.norm(normal), true.offset_m + bias[2], SIGMA)
        fused, _ = fuse(seen, expected)
        assert source.place(None, fused) is not None
        yield expected, true, fused


@pytest.mark.parametrize("wrong_deg", [2.0, 5.0, 8.0])
def test_the_expected_height_follows_the_floor_and_not_a_wrong_vertical(wrong_deg):
    angle = np.radians(wrong_deg)
    floors = list(walk((float(np.sin(angle)), 0.0, float(np.cos(angle)))))
    for expected, true, _ in floors[1:]:
        off = abs(expected.offset_m - true.offset_m)
        assert off < 0.05  # the vertical alone is 1.1 m off after 8 m at 8 deg
        assert off < 3.0 * np.sqrt(expected.covariance[2, 2])


def test_an_error_common_to_all_frames_does_not_shrink_over_a_recording():
    bias = (np.radians(1.2), np.radians(-1.0), 0.02)
    squares = []
    for _, true, fused in walk((0.0, 0.0, 1.0), bias):
        assert np.all(np.sqrt(np.diag(fused.covariance) / np.diag(SIGMA)) > 0.9)
        error = fused.error_to(true)
        squares.append(float(error @ np.linalg.solve(fused.covariance, error)) / 3.0)
    assert max(squares) < 2.0
    assert squares[-1] == pytest.approx(squares[1], rel=0.3)


@pytest.mark.parametrize("given_at_s", [(0.0, 0.1), (-0.1, 0.0, None, 0.1)])
def test_poses_by_another_clock_are_as_unsure_as_the_motion_makes_them(given_at_s):
    """A hand that turns a camera by 60 deg/s and moves it by .5 m/s; the stamps are off by 20 ms."""
    rng = np.random.default_rng(4)

    def held(at_s):
        turn = head_rotation(np.radians(60.0) * at_s, np.radians(30.0))
        return Pose3.from_rotation(turn, np.array([0.5 * at_s, 0.0, 1.3]))

    squares = []
    for _ in range(300):
        source = GivenPoses((0.0, 0.0, 1.0), PriorConfig())
        late = rng.normal(0.0, 0.02)
        for stamp in given_at_s:  # None: a frame without a pose
            pose = None if stamp is None else held(stamp + late)
            source.update(Frame(0.05 if stamp is None else stamp, T_world_camera=pose), ())
        true = held(0.1)
        ahead = true.rotation[:, 2]
        error = source.pose.mean - [
            true.position[0],
            true.position[1],
            np.arctan2(ahead[1], ahead[0]),
        ]
        error += rng.normal(0.0, [0.01, 0.01, np.radians(0.5)])
        squares.append(error @ np.linalg.solve(source.pose.covariance, error) / 3.0)
    assert 0.8 < np.mean(squares) < 1.25
