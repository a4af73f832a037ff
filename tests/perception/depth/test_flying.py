"""Flying pixels: bands between two surfaces are found; edges, poles, grazing floors and gaps are kept."""

from __future__ import annotations

import numpy as np
import pytest

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
