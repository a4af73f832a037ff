"""Staircases in ray-cast depth: their size and direction, and what is none."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from perception.depth.distortion import Distortion, DistortionConfig
from perception.floor.choose import FloorConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.terrain import segmentation, staircase

sys.path.insert(0, str(Path(__file__).parent))

import stair_scenes as scenes

NOISE_M = 0.004
EXACT = FloorConfig(distortion=DistortionConfig(depth=Distortion(), tof=Distortion()))


def seen(surfaces, T, seed=0, tilt=(0.0, 0.0)):
    """The staircase, with up by the joints off by tilts (rad)."""
    true = scenes.prior(T)
    normal = true.normal + np.array(tilt) @ true.tangents
    prior = Plane(normal / np.linalg.norm(normal), true.offset_m, true.covariance)
    regions = segmentation.find(
        scenes.look(surfaces, T, NOISE_M, seed), config=EXACT, sensor="depth"
    )
    return staircase.find(regions, prior)


@pytest.mark.parametrize(
    ("riser", "tread", "steps"), [(0.10, 0.35, 3), (0.17, 0.28, 4), (0.20, 0.24, 4)]
)
def test_stairs_that_lead_up_are_measured(riser, tread, steps):
    T = scenes.pose(1.0, 0.5, 0.25)
    one = seen(scenes.stairs(riser, tread, steps, 0.7), T, tilt=(0.02, -0.01))
    assert one is not None
    assert one.riser_m == pytest.approx(riser, abs=0.002)
    assert one.tread_m == pytest.approx(tread, abs=0.003)
    assert one.steps == steps
    assert one.ascends
    np.testing.assert_allclose(T.rotation @ one.direction, [1.0, 0.0, 0.0], atol=0.01)
    edge = T.apply(one.first_edge)
    assert edge[0] == pytest.approx(0.7, abs=0.005)
    assert edge[2] == pytest.approx(riser, abs=0.005)


@pytest.mark.parametrize(("riser", "tread"), [(0.10, 0.30), (0.17, 0.30)])
def test_stairs_that_lead_down_are_measured(riser, tread):
    T = scenes.pose(1.2, 0.75, -0.2)
    one = seen(scenes.stairs(riser, tread, 4, 0.6, down=True), T)
    assert one is not None
    assert one.riser_m == pytest.approx(riser, abs=0.002)
    assert one.tread_m == pytest.approx(tread, abs=0.006)
    assert not one.ascends
    np.testing.assert_allclose(T.rotation @ one.direction, [-1.0, 0.0, 0.0], atol=0.02)
    edge = T.apply(one.first_edge)
    assert edge[0] == pytest.approx(0.6, abs=0.01)
    assert edge[2] == pytest.approx(0.0, abs=0.005)


def test_the_errors_keep_to_the_covariance():
    T = scenes.pose(1.0, 0.5, 0.2)
    rng = np.random.default_rng(5)
    nees = []
    for seed in range(15):
        one = seen(
            scenes.stairs(0.17, 0.28, 4, 0.7), T, seed, scenes.TILT_SIGMA * rng.normal(size=2)
        )
        turned = T.rotation @ one.direction
        error = np.array(
            [0.17 - one.riser_m, 0.28 - one.tread_m, -math.atan2(turned[1], turned[0])]
        )
        nees.append(float(error @ np.linalg.solve(one.covariance[:3, :3], error)) / 3.0)
    assert 0.4 < np.mean(nees) < 2.0


@pytest.mark.parametrize(
    ("surfaces", "T"),
    [
        (scenes.stairs(0.15, 0.28, 5, 0.7), scenes.pose(1.0, 0.4, 0.2)),
        (scenes.stairs(0.17, 0.30, 5, 0.6, down=True), scenes.pose(1.5, 0.7, -0.2)),
    ],
)
def test_the_first_edge_keeps_to_the_covariance_where_only_treads_tell_what_is_up(surfaces, T):
    """An error of up by d is one of its height by d times its distance, and of the riser by d times the tread."""
    camera = Camera.from_view(176, 144, math.radians(69.0), math.radians(56.0))
    on = scenes.surface_of(surfaces, T, camera)
    hidden = (on == 0) | (on == len(surfaces) - 1)  # ground and landing
    ends = [start for start, end, _ in surfaces[2::2]]  # the nosings
    rise, going = ends[1][1] - ends[0][1], ends[1][0] - ends[0][0]
    rng = np.random.default_rng(5)
    nees = []
    for seed in range(10):
        depth = scenes.look(surfaces, T, NOISE_M, seed, camera)
        z = np.where(hidden, np.nan, depth.z).astype(np.float32)
        true = scenes.prior(T)
        normal = true.normal + scenes.TILT_SIGMA * rng.normal(size=2) @ true.tangents
        prior = Plane(normal / np.linalg.norm(normal), true.offset_m, true.covariance)
        regions = segmentation.find(Depth(z, depth.sigma, camera), config=EXACT, sensor="tof")
        one = staircase.find(regions, prior)
        edge = T.apply(one.first_edge)
        x, height = min(ends, key=lambda end: abs(end[0] - edge[0]))
        if rise < 0.0:
            height -= rise  # a flight down ends at the nosing above
        apart = T.rotation.T @ (np.array([x, edge[1], height]) - edge)
        turned = math.copysign(1.0, rise) * (T.rotation @ one.direction)
        error = np.array(
            [abs(rise) - one.riser_m, going - one.tread_m, -math.atan2(turned[1], turned[0]),
             apart @ one.direction, apart @ one.up]
        )  # fmt: skip
        nees.append(float(error @ np.linalg.solve(one.covariance, error)) / 5.0)
    assert 0.4 < np.mean(nees) < 2.0


@pytest.mark.parametrize("slope_deg", [4.0, 8.0, 15.0, 25.0, 33.0])
def test_a_ramp_is_no_staircase(slope_deg):
    assert seen(scenes.ramp(math.radians(slope_deg), 0.7), scenes.pose(1.0, 0.5)) is None


def test_a_kerb_and_a_single_step_down_are_no_staircase():
    assert seen(scenes.stairs(0.15, 0.3, 1, 0.8), scenes.pose(1.0, 0.5)) is None
    assert seen(scenes.stairs(0.15, 0.3, 1, 0.8, down=True), scenes.pose(1.0, 0.6)) is None


def test_flat_ground_and_nothing_are_no_staircase():
    T = scenes.pose(1.0, 0.5)
    assert seen([((-2.0, 0.0), (6.0, 0.0), 3.0)], T) is None
    assert seen([], T) is None


def test_every_second_step_of_an_uneven_flight_is_no_staircase():
    """Risers of 8 and 16 cm in turn: every second tread is evenly spaced, and the others lie between."""
    surfaces, x, z = [((-2.0, 0.0), (0.6, 0.0), 3.0)], 0.6, 0.0
    for riser in 3 * (0.08, 0.16):
        surfaces += [((x, z), (x, z + riser), 0.7), ((x, z + riser), (x + 0.22, z + riser), 0.7)]
        x, z = x + 0.22, z + riser
    assert seen(surfaces, scenes.pose(1.2, 0.55)) is None
    assert seen(scenes.stairs(0.12, 0.22, 6, 0.6), scenes.pose(1.2, 0.55)) is not None
