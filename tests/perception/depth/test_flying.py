"""Flying pixels: bands and ramps between two surfaces are found; edges, poles, grazing floors and gaps are kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from perception.depth.flying import flying
from perception.primitives.camera import Camera

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
SIGMA_M = 0.003


def box_before_a_wall(rng, band_px):
    """Depth of a box before a wall with a band of mixed pixels round it, and which pixels are mixed."""
    z = np.full((240, 320), 2.2)
    z[80:180, 100:200] = 1.0
    mixed = np.zeros(z.shape, bool)
    mixed[80 - band_px : 180 + band_px, 100 - band_px : 200 + band_px] = True
    mixed[80:180, 100:200] = False
    z[mixed] = rng.uniform(1.05, 2.15, mixed.sum())
    return z + rng.normal(0.0, SIGMA_M, z.shape), mixed


def found_in(z):
    z = z.astype(np.float32)
    return flying(z, np.full(z.shape, SIGMA_M, np.float32), CAMERA)


@pytest.mark.parametrize(("band_px", "share"), [(1, 0.97), (2, 0.9)])
def test_a_band_of_mixed_pixels_is_found_and_no_other(band_px, share):
    z, mixed = box_before_a_wall(np.random.default_rng(band_px), band_px)
    found = found_in(z)
    assert np.mean(found[mixed]) > share
    assert np.mean(found[~mixed]) < 1e-3  # noise beyond 3 sigma beside the band


def test_edges_thin_poles_and_pixels_without_depth_are_kept():
    z = np.full((240, 320), 2.2)
    z[:, 100:160] = 1.0  # a sharp edge
    z[:, 220] = 1.0
    z[:, 260:262] = 1.5  # poles of one and two pixels
    z[50:60, 98:102] = np.nan
    assert not found_in(z).any()


def test_a_grazing_floor_is_kept():
    down = (np.arange(240) - CAMERA.cy) / CAMERA.fy
    below = np.sin(np.radians(20.0)) + down * np.cos(np.radians(20.0))
    z = np.where(below > 0.0, 0.4 / np.maximum(below, 1e-9), np.nan)
    z = np.where(z < 3.0, z, np.nan)
    assert not found_in(np.tile(z[:, None], (1, 320))).any()


@pytest.mark.parametrize("width", [64, 160, 512])
def test_the_last_row_of_a_top_is_kept(width):
    """A top 0.4 m below the camera, seen at 12 to 21 deg, before a wall: its rows are far apart in depth."""
    camera = Camera.from_view(width, width * 3 // 4, np.radians(60.0), np.radians(46.8))
    down = (np.arange(camera.height) - camera.cy) / camera.fy
    z = 0.4 / np.maximum(down, 1e-9)
    z = np.where(z > 1.9, 3.0, np.maximum(z, 1.0))
    z = np.tile(z[:, None], (1, width)).astype(np.float32)
    assert not flying(z, np.full(z.shape, 0.001, np.float32), camera).any()


@pytest.mark.parametrize(
    ("blur_px", "wall_m"), [(1.5, 1.5), (3.0, 1.5), (1.5, 2.2), (3.0, 2.2), (4.5, 2.2), (4.5, 4.0)]
)
def test_a_ramp_of_a_filter_across_edges_is_found(blur_px, wall_m):
    """Dense stereo: disparity smoothed across the edges of a box at 1 m before a wall."""
    true = np.full((240, 320), wall_m)
    true[80:180, 100:200] = 1.0
    rng = np.random.default_rng(0)
    z = 1.0 / ndimage.gaussian_filter(1.0 / true, blur_px) + rng.normal(0.0, SIGMA_M, true.shape)
    found = found_in(z)
    false = np.minimum(np.abs(z - 1.0), np.abs(z - wall_m)) > 0.1
    sides = np.zeros(z.shape, bool)
    sides[95:165], sides[:, 115:185] = True, True  # at a corner no row or column has the ramp alone
    assert np.mean(found[false & sides]) > 0.95
    far_from_edges = ndimage.uniform_filter(true, 41) == pytest.approx(true, abs=1e-6)
    assert not found[far_from_edges].any()


def surfaces():
    """Depth of sharp sensors on true surfaces, m."""
    u, _ = np.meshgrid((np.arange(320) - CAMERA.cx) / CAMERA.fx, np.zeros(240))
    wall = np.full((240, 320), 2.2)
    for angle_deg in (
        12.0,
        20.0,
        45.0,
    ):  # between a wall at 1.2 m and one at 2.2 m, to the line of sight
        slope = np.tan(np.radians(angle_deg))
        side = 1.2 * slope / np.maximum(slope + np.minimum(u, 0.0), 1e-3)
        yield f"side wall at {angle_deg} deg", np.minimum(side, wall)
    root = (2.0 * 1.5) ** 2 - 4.0 * (1.0 + u**2) * (1.5**2 - 0.2**2)
    column = (3.0 - np.sqrt(np.maximum(root, 0.0))) / (2.0 * (1.0 + u**2))
    yield "round column", np.where(root > 0.0, column, wall)
    for width in (3, 4, 6, 8):  # a pole between a box and a wall, at neither's depth
        z = wall.copy()
        z[:, :100], z[:, 100 : 100 + width] = 1.0, 1.5
        yield f"pole of {width} px", z
    stairs = wall.copy()
    for k in range(8):
        stairs[:, 20 * k : 20 * k + 20] = 1.0 + 0.15 * k
    yield "treads, edge after edge", stairs


@pytest.mark.parametrize(("name", "z"), list(surfaces()))
@pytest.mark.parametrize("noise", [0.0, SIGMA_M])
def test_true_surfaces_of_sharp_sensors_are_no_ramps(name, z, noise):
    z = z + noise * np.random.default_rng(0).normal(size=z.shape)
    assert np.mean(found_in(z)) < 1e-4
