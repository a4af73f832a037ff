"""Phase wrapping in a room: a far wall measured in mid-air, and dark objects that must be kept."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.time_of_flight import TofConfig, depth
from perception.primitives.camera import Camera
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose3, head_rotation

SR4000 = Camera(176, 144, 217.8, 228.4, 87.5, 71.5)  # seed 004: 44 x 35 deg
LENGTH = np.linalg.norm(SR4000.rays, axis=-1)
WRAP_M = TofConfig().wrap_m


def room(wall_m, tilt_rad=0.3, chair_albedo=None):
    """True range and the measured view: a floor, a bright wall ahead, optionally a dark box at 1.4 m."""
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
    measured = (true % WRAP_M).astype(np.float32)
    amplitude = (light * (2.0 / true) ** 2).astype(np.float32)
    return true, RangeView(measured, amplitude, SR4000), chair


@pytest.mark.parametrize("wall_m", [5.2, 5.6, 6.0, 6.5, 7.0, 7.5])
@pytest.mark.parametrize("tilt_rad", [0.15, 0.3])
def test_a_wall_beyond_the_ambiguity_interval_gives_no_false_surface(wall_m, tilt_rad):
    true, view, _ = room(wall_m, tilt_rad)
    measured = depth(view).z * LENGTH
    false = np.abs(measured - true) > 1.0
    assert np.count_nonzero(np.abs(view.range_m - true) > 1.0) > 500  # without unwrapping
    assert not false.any()
    near = (true < 2.0) & np.isfinite(true)
    assert np.isfinite(measured[near]).mean() > 0.99  # the floor is kept


@pytest.mark.parametrize("albedo", [0.04, 0.08])
def test_a_dark_object_on_the_floor_keeps_its_depth(albedo):
    _, view, chair = room(6.5, chair_albedo=albedo)
    assert chair.sum() > 500
    assert np.isfinite(depth(view).z[chair]).mean() > 0.95


def test_without_amplitude_no_range_is_rejected():
    _, view, _ = room(6.0)
    blind = RangeView(view.range_m, None, SR4000)
    known = view.range_m > 0.0
    assert np.isfinite(depth(blind).z[known]).mean() > 0.98
