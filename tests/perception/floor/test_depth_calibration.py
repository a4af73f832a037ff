"""A known noise and a known bend, given to synthetic views, are found again within the stated uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.distortion import DistortionConfig
from perception.depth.points import Points
from perception.floor.depth_calibration import Calibrator
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError

PUBLISHED = DistortionConfig().depth
STEP = 0.006  # of 1 / z, per m: an eighth of a pixel with 21 px m
NOISE = 1.6  # of the model, whose constants are 1.2 mm and 1.9 mm


def calibrated(look, coefficients, posed, views=8, step=0.0, **room_of):
    """The calibration of views of a bare floor, bent by a quadric in published sizes; inverse depth in steps, 1/m."""
    calibrator = Calibrator(PUBLISHED, np.random.default_rng(0))
    for view in range(views):
        where = {"height_m": 0.5 + 0.1 * view, "pitch_deg": 25.0 + 3.0 * view} | room_of
        room = look(view, roll_deg=5.0 * (view % 3 - 1), noise=NOISE, size=(240, 180),
                    reach_m=4.0, **where)  # fmt: skip
        z = room.points.xyz[:, 2]
        u, v = (room.points.xyz[:, axis] / z for axis in (0, 1))
        u, v = u / np.abs(u).max(), v / np.abs(u).max()
        shapes = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
        size = np.hypot(PUBLISHED.share, PUBLISHED.share_per_m * z)
        xyz = room.points.xyz * (1.0 + size * (shapes @ coefficients))[:, None]
        if step:
            xyz /= (xyz[:, 2] * step * np.round(1.0 / (xyz[:, 2] * step)))[:, None]
        bent = Points(xyz, room.points.sigma, room.points.pixels)
        calibrator.add(bent, room.T_body_camera if posed else None)
    return calibrator.solve()


@pytest.mark.parametrize("seed", range(3))
def test_a_known_bend_is_found_within_its_uncertainty(look, seed):
    true = np.random.default_rng(seed).normal(size=6)
    found = calibrated(look, true, posed=False)
    assert list(found.known) == [False, False, False, True, True, True]
    assert np.all(np.abs(found.bend - true)[3:] < 3.0 * found.sigma[3:])
    assert np.all(found.sigma[3:] < 0.2)


def test_the_noise_and_its_growth_are_found_within_their_uncertainty(look):
    found = calibrated(look, np.zeros(6), posed=False)
    for one in found.noise:
        true = NOISE * (0.0012 + 0.0019 * (one.z - 0.4) ** 2)
        assert abs(one.sigma - true) < 4.0 * one.error + 0.03 * true  # bins are 0.2 m wide
    z = np.array([one.z for one in found.noise])
    constant, growth, _ = found.growth((z - 0.4) ** 2)
    assert constant == pytest.approx(NOISE * 0.0012, rel=0.10)
    assert growth == pytest.approx(NOISE * 0.0019, rel=0.05)


def test_steps_of_disparity_wider_than_the_noise_are_part_of_it(look):
    """A wall square to the axis: half of the pixels of a cell and more have one value."""
    found = calibrated(
        look, np.zeros(6), False, step=STEP, wall_m=1.9, with_floor=False, pitch_deg=0.0
    )
    assert found.noise
    for one in found.noise:
        true = np.hypot(NOISE * (0.0012 + 0.0019 * (one.z - 0.4) ** 2), one.z**2 * STEP / 12**0.5)
        assert one.sigma == pytest.approx(true, rel=0.1)


def test_a_sensor_without_bend_gets_a_smaller_distortion_and_a_bent_one_a_larger(look):
    straight = calibrated(look, np.zeros(6), posed=False)
    bent = calibrated(look, np.array([0.0, 0.0, 0.0, 2.5, 0.0, 2.0]), posed=False)
    assert straight.size < 0.6
    assert bent.size > 1.4


def test_poses_show_the_linear_terms_and_a_single_view_does_not(look):
    true = np.array([0.0, 1.2, -0.8, 0.5, 0.0, -0.5])
    posed, alone = calibrated(look, true, posed=True), calibrated(look, true, posed=False)
    assert posed.known[1:3].all()
    assert not alone.known[1:3].any()
    assert np.all(np.abs(posed.bend - true)[1:] < 3.0 * posed.sigma[1:] + 0.1)


def test_views_from_one_place_count_once(look):
    same = calibrated(look, np.zeros(6), posed=False, height_m=1.0, pitch_deg=40.0)
    assert same.views <= 3  # of eight; they are rolled by -5, 0 and 5 deg


def test_a_sensor_at_one_distance_does_not_tell_the_growth_of_its_noise(look):
    found = calibrated(look, np.zeros(6), posed=False, height_m=1.0, pitch_deg=88.0)
    z = np.array([one.z for one in found.noise])
    assert np.isnan(found.growth((z - 0.4) ** 2)[1])


def test_without_a_flat_surface_the_recording_is_refused():
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (20_000, 2)), np.ones(20_000)])
    clutter = Points(
        rays * rng.uniform(0.5, 3.0, (20_000, 1)), np.full(20_000, 0.003), np.arange(20_000)
    )
    calibrator = Calibrator(PUBLISHED, rng)
    assert calibrator.add(clutter, None) == 0
    with pytest.raises(InputError, match="record a bare floor or a wall"):
        calibrator.solve()


@pytest.mark.parametrize("half", [0, 1])
def test_one_half_of_a_real_recording_confirms_the_calibration_by_the_other(
    recordings, read_points, half
):
    camera = Camera(640, 480, 535.4, 539.2, 320.1, 247.6)
    paths = sorted((recordings / "tum_fr3_cabinet" / "depth").glob("*.png"))
    found = []
    for part in (paths[:19], paths[19:]):
        calibrator = Calibrator(PUBLISHED, np.random.default_rng(half))
        for path in part[half::2]:
            calibrator.add(read_points(path, camera, 5000.0), None)
        found.append(calibrator.solve())
    one, other = found
    both = one.known & other.known
    assert both[3]
    apart = np.abs(one.bend - other.bend) / np.hypot(one.sigma, other.sigma)
    assert np.all(apart[both] < 3.0)
    pairs = [
        (a.sigma, b.sigma)
        for a in one.noise
        for b in other.noise
        if abs(a.z - b.z) < 0.05 and min(a.cells, b.cells) > 40
    ]
    assert len(pairs) >= 4
    ratio = np.array([a / b for a, b in pairs])
    assert np.all((ratio > 0.75) & (ratio < 1.33))
