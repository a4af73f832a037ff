"""The published flow chart finds the floor from its joints, with an honest covariance, and None by its own rules."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import Points
from perception.floor import flow_chart
from perception.floor.choose import FloorConfig, find
from perception.floor.hough import HoughConfig
from perception.floor.prior import handheld_prior, kinematic_prior
from perception.primitives.plane import Plane

CRATES = ((0.9, 1.2, -0.5, -0.1, 0.0, 0.25), (1.4, 1.7, 0.2, 0.6, 0.0, 0.45))
PRINTED = FloorConfig(method="printed")


def test_votes_in_two_tilts_find_the_floor_that_theta_and_phi_miss(look):
    found, missed = 0, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        room = look(seed, height_m=rng.uniform(0.3, 0.6), pitch_deg=rng.uniform(15.0, 40.0),
                    boxes=CRATES, noise=3.0)  # fmt: skip
        prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
        fit = flow_chart.find(room.points, prior, np.random.default_rng(seed))
        found += (
            fit is not None
            and np.degrees(fit.plane.angle_to(room.floor)) < 0.5
            and abs(fit.plane.offset_m - room.floor.offset_m) < 0.01
        )
        missed += (
            flow_chart.find(room.points, prior, np.random.default_rng(seed), literal=True) is None
        )
    assert found == 20
    assert missed >= 3  # at phi = 0 the votes of one floor have any theta


def test_the_angles_of_the_formula_find_the_floor_away_from_their_pole(look):
    room = look(0, pitch_deg=40.0)
    tilted = room.floor.normal + 0.15 * room.floor.tangents[0]
    prior = Plane(tilted / np.linalg.norm(tilted), room.floor.offset_m)
    for literal in (True, False):
        found = flow_chart.find(room.points, prior, np.random.default_rng(0), literal=literal)
        assert np.degrees(found.plane.angle_to(room.floor)) < 1.0
        assert abs(found.plane.offset_m - room.floor.offset_m) < 0.01


def test_the_method_printed_is_the_flow_chart(look):
    room = look(0, boxes=CRATES)
    prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
    chosen = find(room.points, prior, np.random.default_rng(3), PRINTED)
    itself = flow_chart.find(room.points, prior, np.random.default_rng(3))
    np.testing.assert_array_equal(chosen.plane.normal, itself.plane.normal)
    assert chosen.plane.offset_m == itself.plane.offset_m


def test_of_an_empty_floor_it_is_the_least_squares_plane_in_inverse_depth(look):
    """With r = p / Z, a plane n.p + h = 0 is linear in inverse depth: (n / h).r = -1 / Z. Peer: NumPy's linear solver."""
    for seed in range(5):
        room = look(seed, pitch_deg=35.0, noise=2.0)
        prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
        found = flow_chart.find(room.points, prior, np.random.default_rng(seed)).plane
        xyz = room.points.xyz
        xyz = xyz[(xyz[:, 2] < 3.0) & (np.abs(room.floor.distance(xyz)) < 0.06)]
        z = xyz[:, 2]
        slant = np.linalg.lstsq(xyz / z[:, None], -1.0 / z, rcond=None)[0]
        best = Plane(slant / np.linalg.norm(slant), 1.0 / np.linalg.norm(slant))
        assert np.degrees(found.angle_to(best)) < 0.01
        assert abs(found.offset_m - best.offset_m) < 1e-4


@pytest.mark.parametrize("boxes", [(), CRATES])
def test_its_covariance_covers_noise_and_the_feet_of_crates(look, boxes):
    squares = []
    for seed in range(50):
        rng = np.random.default_rng([seed, 7])
        room = look(seed, height_m=rng.uniform(0.35, 1.0), pitch_deg=rng.uniform(20.0, 45.0),
                    boxes=boxes, reach_m=4.0)  # fmt: skip
        prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
        found = flow_chart.find(room.points, prior, rng)
        e = found.plane.error_to(room.floor)
        assert np.all(np.linalg.eigvalsh(found.plane.covariance) > 0.0)
        squares.append(float(e @ np.linalg.solve(found.plane.covariance, e)) / 3.0)
    assert 0.3 < np.mean(squares) < 1.7


def test_a_camera_in_the_hand_finds_its_floor(look):
    room = look(1, height_m=1.2, pitch_deg=35.0, boxes=CRATES)
    found = find(room.points, handheld_prior(None), np.random.default_rng(0), PRINTED)
    assert np.degrees(found.plane.angle_to(room.floor)) < 0.5
    assert abs(found.plane.offset_m - room.floor.offset_m) < 0.01


def test_a_camera_far_from_its_kinematic_height_keeps_the_kinematic_plane(look):
    room = look(0, pitch_deg=40.0)
    prior = Plane(room.floor.normal, room.floor.offset_m + 0.08)  # step 6 allows 0.05 m
    assert flow_chart.find(room.points, prior, np.random.default_rng(0)) is None


def test_a_floor_steeper_than_the_joints_allow_keeps_the_kinematic_plane(look):
    room = look(0, pitch_deg=40.0)
    tilted = room.floor.normal + np.tan(np.radians(12.0)) * room.floor.tangents[0]
    prior = Plane(tilted / np.linalg.norm(tilted), room.floor.offset_m)  # step 6 allows 10 deg
    assert flow_chart.find(room.points, prior, np.random.default_rng(0)) is None


def test_without_points_in_range_there_is_no_floor(look):
    room = look(0)
    far = Points(room.points.xyz + np.array([0.0, 0.0, 9.0]), room.points.sigma, room.points.pixels)
    assert flow_chart.find(far, room.floor, np.random.default_rng(0)) is None


def test_the_hough_settings_are_those_of_the_chart():
    config = HoughConfig()
    assert (config.triples, config.enough, config.least) == (3000, 60, 15)
    assert (config.tilt_cell_deg, config.rho_cell_m) == (2.0, 0.02)
