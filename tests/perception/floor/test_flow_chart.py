"""The flow chart as printed: correct for large, near floors, and None by its own rules."""

from __future__ import annotations

import numpy as np

from perception.depth.points import Points
from perception.floor.flow_chart import find_as_printed
from perception.floor.hough import HoughConfig
from perception.primitives.plane import Plane


def test_a_bare_floor_is_found_away_from_the_pole_of_the_angles(look):
    room = look(0, pitch_deg=40.0)
    tilted = room.floor.normal + 0.15 * room.floor.tangents[0]  # far from the pole phi = 0
    prior = Plane(tilted / np.linalg.norm(tilted), room.floor.offset_m)
    found = find_as_printed(room.points, prior, np.random.default_rng(0))
    assert np.degrees(found.angle_to(room.floor)) < 1.0
    assert abs(found.offset_m - room.floor.offset_m) < 0.01


def test_a_camera_far_from_its_kinematic_height_keeps_the_kinematic_plane(look):
    room = look(0, pitch_deg=40.0)
    prior = Plane(room.floor.normal, room.floor.offset_m + 0.08)  # step 6 allows 0.05 m
    assert find_as_printed(room.points, prior, np.random.default_rng(0)) is None


def test_without_points_in_range_there_is_no_floor(look):
    room = look(0)
    far = Points(room.points.xyz + np.array([0.0, 0.0, 9.0]), room.points.sigma, room.points.pixels)
    assert find_as_printed(far, room.floor, np.random.default_rng(0)) is None


def test_the_hough_settings_are_those_of_the_chart():
    config = HoughConfig()
    assert (config.triples, config.enough, config.least) == (3000, 60, 15)
    assert (config.tilt_cell_deg, config.rho_cell_m) == (2.0, 0.02)
