"""The anatomy table and the URDF generated from it."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from sim.body.dynamic.anatomy import DARWIN, TALL, gait_for, head_for, links
from sim.body.dynamic.config import DynamicConfig
from sim.body.dynamic.urdf import box_inertia, floor_bumps, robot_urdf, static_urdf
from sim.body.gait import GaitConfig
from sim.body.head import HeadConfig
from sim.shapes import Cylinder


def top(body):
    """Height of the head above the floor with straight legs, m."""
    return body.thigh_m + body.shank_m + body.ankle_m + body.neck_m + body.tilt_m + body.head_m[2]


def test_the_default_anatomy_is_a_darwin():
    assert sum(link.mass for link in links(DARWIN)) == pytest.approx(2.92, abs=0.005)
    assert top(DARWIN) == pytest.approx(0.455, abs=0.002)
    assert len(links(DARWIN)) - 1 == 20


def test_the_tall_anatomy_is_that_of_seed_004():
    assert top(TALL) == pytest.approx(0.600, abs=0.003)
    assert len(links(TALL)) - 1 == 23
    assert 2 * (TALL.shoulder_m[1] + TALL.arm_width_m / 2) == pytest.approx(0.300)
    assert TALL.foot_m[0] == pytest.approx(0.200)


@pytest.mark.parametrize("body", [DARWIN, TALL, DARWIN.scaled(1.5)])
def test_the_urdf_agrees_with_the_link_table(body):
    root = ET.fromstring(robot_urdf(body))
    masses = [float(mass.get("value")) for mass in root.iter("mass")]
    assert sum(masses) == pytest.approx(sum(link.mass for link in links(body)), rel=1e-6)
    assert [j.get("name") for j in root.iter("joint")] == [k.name for k in links(body)[1:]]


def test_scaling_changes_lengths_masses_and_torques():
    grown = DARWIN.scaled(2.0)
    assert grown.thigh_m == 2.0 * DARWIN.thigh_m
    assert grown.leg_kg[0] == 8.0 * DARWIN.leg_kg[0]
    assert grown.servo_nm == 16.0 * DARWIN.servo_nm
    gait = gait_for(grown, GaitConfig())
    assert gait.stance_width_m == 2.0 * GaitConfig().stance_width_m
    assert gait.single_support_s == GaitConfig().single_support_s
    assert head_for(grown, HeadConfig()).neck_m == 2.0 * HeadConfig().neck_m
    assert gait_for(DARWIN, GaitConfig()) == GaitConfig()


def test_box_inertia_agrees_with_a_sum_over_points():
    rng = np.random.default_rng(0)
    size, mass = (0.1, 0.2, 0.3), 2.0
    grains = rng.uniform(-0.5, 0.5, (200_000, 3)) * size
    x, y, z = (grains**2).mean(axis=0)
    np.testing.assert_allclose(
        box_inertia(mass, size), mass * np.array([y + z, x + z, x + y]), rtol=0.01
    )


def test_bumps_keep_their_height_limit_and_lie_inside():
    found = floor_bumps((-1.0, 0.0, 1.0, 1.5), 0.002, np.random.default_rng(1))
    tops = [box.top_m for box in found]
    assert 0.0 <= min(tops) < 0.0003 < 0.0017 < max(tops) <= 0.002
    assert all(-1.0 < box.centre[0] < 1.05 and 0.0 < box.centre[1] < 1.6 for box in found)
    root = ET.fromstring(static_urdf([*found, Cylinder((0.0, 0.0, 0.1), 0.1, 0.2)]))
    assert len(list(root.iter("collision"))) == len(found) + 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"anatomy": "giant"}, "anatomy='giant' is unknown; choose darwin, tall"),
        ({"backlash_deg": -1.0}, "backlash_deg=-1.0 must not be negative"),
        ({"slope_rad": (0.5, 0.0)}, "slope_rad"),
    ],
)
def test_invalid_bodies_are_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        DynamicConfig(**changes)
    with pytest.raises(ConfigError, match="scale=9"):
        DARWIN.scaled(9.0)
