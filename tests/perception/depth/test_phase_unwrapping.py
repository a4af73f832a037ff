"""What a wrap does to a room: the far wall in mid-air before the robot, and dark things that must stay."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.phase_unwrapping import WrapConfig
from perception.depth.time_of_flight import TofConfig, depth
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose3, head_rotation

SR4000 = Camera(176, 144, 217.8, 228.4, 87.5, 71.5)  # seed 004: 44 x 35 deg
LENGTH = np.linalg.norm(SR4000.rays, axis=-1)
WRAP_M = TofConfig().wrap_m


def room(wall_m, tilt_rad=0.3, chair_albedo=None):
    """True range and what the camera says: a floor, a bright wall ahead, perhaps a dark box at 1.4 m."""
    T = Pose3.from_rotation(head_rotation(0.0, tilt_rad), np.array([0.0, 0.0, 0.4]))
    rays = SR4000.rays / LENGTH[..., None] @ T.rotation.T
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < 0, -0.4 / rays[..., 2], np.inf)
        wall = wall_m / rays[..., 0]
        face = 1.4 / rays[..., 0]
    true = np.minimum(floor, wall)
    light = np.where(floor < wall, 0.35 * -rays[..., 2], 0.75 * rays[..., 0])
    chair = np.zeros(true.shape, dtype=bool)
    if chair_albedo is not None:
        chair = (np.abs(face * rays[..., 1]) < 0.2) & (face * rays[..., 2] < 0.05) & (face < true)
        true, light = np.where(chair, face, true), np.where(chair, chair_albedo, light)
    told = (true % WRAP_M).astype(np.float32)
    amplitude = (light * (2.0 / true) ** 2).astype(np.float32)
    return true, RangeView(told, amplitude, SR4000), chair


@pytest.mark.parametrize("wall_m", [5.2, 5.6, 6.0, 6.5, 7.0, 7.5])
@pytest.mark.parametrize("tilt_rad", [0.15, 0.3])
def test_a_wall_beyond_the_wrap_is_no_thing_in_mid_air(wall_m, tilt_rad):
    true, told, _ = room(wall_m, tilt_rad)
    measured = depth(told).z * LENGTH
    false = np.abs(measured - true) > 1.0
    assert np.count_nonzero(np.abs(told.range_m - true) > 1.0) > 500  # so it would have been
    assert not false.any()
    near = (true < 2.0) & np.isfinite(true)
    assert np.isfinite(measured[near]).mean() > 0.99  # the floor stays


@pytest.mark.parametrize("albedo", [0.04, 0.08])
def test_a_dark_thing_on_the_floor_stays_where_it_stands(albedo):
    _, told, chair = room(6.5, chair_albedo=albedo)
    assert chair.sum() > 500
    assert np.isfinite(depth(told).z[chair]).mean() > 0.95


def test_without_amplitude_nothing_can_be_told_and_nothing_is_thrown_away():
    _, told, _ = room(6.0)
    blind = RangeView(told.range_m, None, SR4000)
    known = told.range_m > 0.0
    assert np.isfinite(depth(blind).z[known]).mean() > 0.98


def test_darker_than_dark_is_refused_in_words():
    with pytest.raises(ConfigError, match=r"darkest=0\.5"):
        WrapConfig(darkest=0.5)
