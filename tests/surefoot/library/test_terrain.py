"""Regions and stairs by the public functions."""

from __future__ import annotations

import numpy as np
import pytest

import surefoot

CAMERA = surefoot.Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
TILT_RAD, HEIGHT_M = 0.6, 1.0
UP = (0.0, -np.cos(TILT_RAD), -np.sin(TILT_RAD))
RISER_M, TREAD_M, AWAY_M, STEPS = 0.16, 0.29, 0.7, 4


def stairs(seed=0):
    """Depth of four steps ahead, m: along each ray the nearest of all treads and risers."""
    v = np.arange(CAMERA.height)[:, None] * np.ones(CAMERA.width)
    down = (v - CAMERA.cy) / CAMERA.fy
    ahead = np.cos(TILT_RAD) - down * np.sin(TILT_RAD)
    below = np.sin(TILT_RAD) + down * np.cos(TILT_RAD)
    best = np.full(v.shape, np.inf)
    for k in range(STEPS + 1):
        start = AWAY_M + (k - 1) * TREAD_M if k else -9.0
        end = start + TREAD_M if 0 < k < STEPS else (AWAY_M if k == 0 else 9.0)
        with np.errstate(divide="ignore"):
            tread = np.where(below > 0, (HEIGHT_M - k * RISER_M) / below, np.inf)
            riser = np.where(ahead > 0, (AWAY_M + k * TREAD_M) / ahead, np.inf)
        on = (tread * ahead >= start) & (tread * ahead < end)
        best = np.where(on, np.minimum(best, tread), best)
        top = HEIGHT_M - riser * below
        on = (top >= k * RISER_M) & (top < (k + 1) * RISER_M) & (k < STEPS)
        best = np.where(on, np.minimum(best, riser), best)
    return best + np.random.default_rng(seed).normal(0.0, 0.003, best.shape)


def test_a_staircase_has_its_size_and_direction():
    found = surefoot.find_stairs(stairs(), CAMERA, UP, sigma_m=0.003)
    assert found.riser_m == pytest.approx(RISER_M, abs=0.004)
    assert found.tread_m == pytest.approx(TREAD_M, abs=0.006)
    assert found.ascends
    assert found.covariance.shape == (5, 5)


def test_calibrated_depth_gives_smaller_standard_deviations():
    sigma_m = {}
    for calibrated in (False, True):
        found = surefoot.find_stairs(stairs(), CAMERA, UP, sigma_m=0.003, calibrated=calibrated)
        error = found.riser_m - RISER_M
        sigma_m[calibrated] = np.sqrt(found.covariance[0, 0])
        assert abs(error) < 4.0 * sigma_m[calibrated]
    assert sigma_m[True] < sigma_m[False] / 4.0
    regions = [surefoot.find_regions(stairs(), CAMERA, calibrated=one)[0] for one in (False, True)]
    before, after = (np.trace(one.plane.covariance) for one in regions)
    assert after < before / 16.0


def test_millimetres_give_the_same_regions():
    millimetres = np.round(1000.0 * stairs()).astype(np.uint16)
    regions = surefoot.find_regions(millimetres, CAMERA, scale_per_metre=1000.0)
    level = [one for one in regions if one.slope_rad(np.array(UP)) < 0.1]
    assert len(level) == STEPS + 1


def test_up_must_be_known():
    with pytest.raises(surefoot.InputError, match="give up or T_body_camera"):
        surefoot.find_stairs(stairs(), CAMERA)
