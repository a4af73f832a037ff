"""Plane regions of ray-cast stairs, ramps, kerbs and holes against their true planes."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from perception.depth import stereo
from perception.depth.distortion import Distortion, DistortionConfig
from perception.floor.choose import FloorConfig
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth
from perception.terrain import inclination, segmentation
from perception.terrain.region import EdgeKind

sys.path.insert(0, str(Path(__file__).parent))

import stair_scenes as scenes

NOISE_M = 0.004
EXACT = FloorConfig(distortion=DistortionConfig(depth=Distortion(), tof=Distortion()))
T = scenes.pose(0.9, 0.55, 0.2)


def found(surfaces, seed=0, pose=T, sensor="depth"):
    return segmentation.find(
        scenes.look(surfaces, pose, NOISE_M, seed), config=EXACT, sensor=sensor
    )


def heights(regions, pose=T):
    """Heights of the level regions above the ground, in ascending order."""
    up = scenes.prior(pose).normal
    level = [one for one in regions if one.slope_rad(up) < math.radians(5.0)]
    return sorted(float(up @ one.middle) + pose.position[2] for one in level)


def test_every_tread_is_a_region_of_its_own():
    np.testing.assert_allclose(
        heights(found(scenes.stairs(0.15, 0.28, 3, 0.7))), [0.0, 0.15, 0.30, 0.45], atol=0.003
    )


def test_treads_that_lead_down_are_regions_too():
    regions = found(scenes.stairs(0.15, 0.30, 3, 0.6, down=True), pose=scenes.pose(1.1, 0.75))
    np.testing.assert_allclose(
        heights(regions, scenes.pose(1.1, 0.75)), [-0.45, -0.30, -0.15, 0.0], atol=0.004
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_tread_of_two_or_three_rows_is_one_region(seed):
    camera = Camera.from_view(176, 144, math.radians(69.0), math.radians(56.0))
    surfaces, pose = scenes.stairs(0.13, 0.30, 5, 0.8), scenes.pose(0.75, 0.25, 0.05)
    depth = scenes.look(surfaces, pose, NOISE_M, seed, camera)
    tread = scenes.surface_of(surfaces, pose, camera) == 2 * 4  # the fourth one
    assert 2.0 < tread.sum() / np.count_nonzero(tread.any(axis=0)) < 3.0
    masks = [one.mask(camera) for one in segmentation.find(depth, config=EXACT, sensor="tof")]
    assert max((mask & tread).sum() / (mask | tread).sum() for mask in masks) > 0.85


@pytest.mark.parametrize("slope_deg", [7.0, 10.0, 20.0])
def test_a_ramp_is_one_region_with_its_slope(slope_deg):
    regions = found(scenes.ramp(math.radians(slope_deg), 0.7))
    ramps = inclination.ramps(regions, scenes.prior(T))
    assert len(ramps) == 1
    angle, sigma = inclination.inclination(regions[ramps[0]], scenes.prior(T))
    assert math.degrees(angle) == pytest.approx(slope_deg, abs=0.2)
    assert sigma == pytest.approx(scenes.TILT_SIGMA, rel=0.1)  # up is no better known


def test_a_slope_within_the_doubt_of_up_is_not_called_a_ramp():
    regions = found(scenes.ramp(math.radians(4.0), 0.7))
    assert inclination.ramps(regions, scenes.prior(T)) == []


def test_flat_ground_is_one_region_and_no_ramp():
    regions = found([((-2.0, 0.0), (6.0, 0.0), 3.0)])
    assert len(regions) == 1
    assert inclination.ramps(regions, scenes.prior(T)) == []


def test_the_planes_keep_to_their_covariance():
    nees = []
    for seed in range(12):
        for one in found(scenes.stairs(0.17, 0.28, 3, 0.7), seed):
            up, height = scenes.prior(T).normal, float(scenes.prior(T).normal @ one.middle) + 0.9
            if one.slope_rad(up) < 0.1:
                step = round(height / 0.17) * 0.17
                true = type(one.plane)(up, 0.9 - step)
                error = one.plane.error_to(true)
                nees.append(float(error @ np.linalg.solve(one.plane.covariance, error)) / 3.0)
    assert 0.5 < np.mean(nees) < 2.0


@pytest.mark.parametrize("sensor", ["depth", "tof"])
def test_the_end_of_a_landing_is_an_edge_with_its_sigma(sensor):
    off = []
    pose = scenes.pose(1.1, 0.75)
    for seed in range(8):
        surfaces = scenes.stairs(0.17, 0.30, 3, 0.6, down=True)
        top = max(found(surfaces, seed, pose, sensor), key=lambda one: float(-one.plane.offset_m))
        ends = [edge for edge in top.edges if edge.kind == EdgeKind.OCCLUDING]
        assert ends, "the landing ends at a step down"
        edge = max(ends, key=lambda one: one.length_m)
        off.append(
            (pose.apply(edge.middle)[0] - nearest(pose.apply(edge.middle)[0])) / edge.sigma_m
        )
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def nearest(x):
    """The true nosing nearest to a place ahead."""
    return 0.6 + 0.30 * round((x - 0.6) / 0.30)


def test_a_passage_between_two_walls_has_no_edge_across():
    pose = scenes.pose(1.2, 0.5)
    floor = [((-2.0, 0.0), (6.0, 0.0), 3.0)]
    walled = scenes.look([*floor, ((2.0, 0.0), (2.0, 2.0), 1.5)], pose, NOISE_M)
    rays = scenes.CAMERA.rays @ pose.rotation.T
    passage = np.abs(rays[..., 1] / rays[..., 0] * 2.0) < 0.45
    z = np.where(passage, scenes.look(floor, pose, NOISE_M).z, walled.z)
    regions = segmentation.find(Depth(z, walled.sigma, walled.camera), config=EXACT, sensor="depth")
    feet = [
        np.sort(pose.apply(edge.ends)[:, 1])
        for edge in regions[0].edges
        if edge.kind == EdgeKind.CONCAVE
    ]
    assert all(low > 0.4 or high < -0.4 for low, high in feet)
    assert {bool(low > 0.0) for low, _ in feet} == {False, True}


FLIGHTS = [
    (scenes.stairs(riser, tread, 4, away, down), scenes.pose(1.15, tilt))
    for riser, tread, away, down, tilt in (
        (0.06, 0.31, 0.6, False, 0.75),
        (0.07, 0.33, 0.8, False, 0.7),
        (0.085, 0.35, 0.5, False, 0.8),
        (0.06, 0.33, 0.9, True, 0.7),
        (0.075, 0.31, 0.7, True, 0.8),
    )
]
VIEWS = 6


def test_few_low_flights_of_a_noisy_camera_are_taken_for_ramps():
    """One plane over several treads leans by 10 deg and more; a riser by half a right angle at least."""
    leaning = 0
    for surfaces, pose in FLIGHTS:
        up = scenes.prior(pose).normal
        for seed in range(VIEWS):
            for one in segmentation.find(scenes.matched(surfaces, pose, seed), sensor="depth"):
                sigma = math.sqrt(float(np.linalg.eigvalsh(one.own[:2, :2])[-1]))
                least = math.radians(4.0) + 3.0 * sigma
                leaning += least < one.slope_rad(up) < math.radians(45.0)
    assert leaning <= 0.25 * VIEWS * len(FLIGHTS)


def test_edges_of_treads_keep_to_their_sigma_by_a_noisy_camera():
    errors = {kind: [] for kind in EdgeKind}
    for surfaces, pose in FLIGHTS:
        for seed in range(VIEWS):
            for one in segmentation.find(scenes.matched(surfaces, pose, seed), sensor="depth"):
                if one.slope_rad(scenes.prior(pose).normal) > math.radians(5.0):
                    continue
                height = pose.apply(one.middle)[2]
                for edge in one.edges:
                    place, along = pose.apply(edge.middle), pose.rotation @ edge.along
                    if abs(along[1]) > 0.95 and edge.length_m > 0.3:
                        true = min(ends_at(surfaces, height), key=lambda x: abs(x - place[0]))
                        sigma = math.hypot(edge.sigma_m, 0.002)
                        errors[edge.kind].append(((place[0] - true) / sigma, edge.length_m))
    for kind, values in errors.items():
        assert len(values) > 20, kind
        off, length = np.array(values).T
        assert np.median(off**2) < 1.0, kind
        assert length[np.abs(off) > 3.0].sum() < 0.1 * length.sum(), kind


def test_thin_treads_keep_to_their_tilt_by_block_matching():
    """Most blocks of a thin tread see beyond it."""
    pose, nees = scenes.pose(1.1, 0.6), []
    up = scenes.prior(pose).normal
    for seed in range(10):
        surfaces = scenes.stairs(0.12, 0.26, 5, 0.7 + 0.05 * seed)
        for one in segmentation.find(
            stereo.depth(scenes.stereo_pair(surfaces, pose, seed)), sensor="stereo"
        ):
            thin = np.ptp(one.pixels // scenes.CAMERA.width) < 40
            if thin and one.slope_rad(up) < math.radians(30.0):
                error = one.plane.tangents @ (up - one.plane.normal)
                nees.append(
                    float(error @ np.linalg.solve(one.plane.covariance[:2, :2], error)) / 2.0
                )
    assert len(nees) > 20
    assert 0.4 < np.mean(nees) < 1.5


def test_a_tread_does_not_reach_down_a_riser_that_is_too_small_to_be_a_region():
    surfaces, pose = scenes.stairs(0.06, 0.31, 4, 1.3), scenes.pose(1.15, 0.55)
    off = []
    for seed in range(8):
        for one in segmentation.find(scenes.matched(surfaces, pose, seed), sensor="depth"):
            middle = pose.apply(one.middle)
            for edge in one.edges:
                place, along = pose.apply(edge.middle), pose.rotation @ edge.along
                near = place[0] < middle[0] and abs(along[1]) > 0.95 and edge.length_m > 0.3
                if near and edge.kind == EdgeKind.OCCLUDING:
                    true = min(ends_at(surfaces, middle[2]), key=lambda x: abs(x - place[0]))
                    off.append((place[0] - true) / edge.sigma_m)
    assert len(off) > 20
    assert np.mean(np.square(off)) < 1.5


def ends_at(surfaces, height):
    """Where level surfaces of a height begin and end."""
    return [
        end[0]
        for surface in surfaces
        for end in surface[:2]
        if surface[0][1] == surface[1][1] and abs(end[1] - height) < 0.03
    ]


def test_a_hole_is_an_edge_of_the_floor_and_a_lower_region():
    surfaces = [((-2.0, 0.0), (1.0, 0.0), 3.0), ((1.0, -0.3), (3.0, -0.3), 3.0)]
    regions = found(surfaces, pose=scenes.pose(1.2, 0.8))
    np.testing.assert_allclose(heights(regions, scenes.pose(1.2, 0.8)), [-0.3, 0.0], atol=0.004)


def test_most_pixels_of_a_region_are_those_of_its_surface():
    depth = scenes.look(scenes.stairs(0.15, 0.28, 3, 0.7), T, NOISE_M)
    rays = scenes.CAMERA.rays @ T.rotation.T
    height = 0.9 + rays[..., 2] * depth.z
    up = scenes.prior(T).normal
    found = segmentation.find(depth, config=EXACT, sensor="depth")
    level = [one for one in found if one.slope_rad(up) < 0.1]
    assert len(level) == 4  # the floor and three treads
    for one in level:
        step = round((float(up @ one.middle) + 0.9) / 0.15) * 0.15
        on = np.abs(height[one.mask(scenes.CAMERA)] - step) < 0.02
        assert on.mean() > 0.97


def test_noise_and_nothing_give_no_region():
    camera = scenes.CAMERA
    rng = np.random.default_rng(0)
    shape = (camera.height, camera.width)
    noise = rng.uniform(0.5, 3.0, shape).astype(np.float32)
    sigma = np.full(shape, 0.002, np.float32)
    assert segmentation.find(Depth(noise, sigma, camera)) == []
    nothing = np.full(shape, np.nan, np.float32)
    assert segmentation.find(Depth(nothing, nothing, camera)) == []


def test_an_image_that_does_not_fit_its_camera_is_refused():
    wrong = np.ones((10, 10), np.float32)
    with pytest.raises(InputError, match="intrinsics"):
        segmentation.find(Depth(wrong, wrong, scenes.CAMERA))
