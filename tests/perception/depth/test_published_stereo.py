"""Sub-pixel disparity and reliability of seed 003, against their closed forms and a known scene."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from perception.depth import published_stereo
from perception.depth.stereo import StereoConfig, depth, disparity
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import StereoView

CAMERA = Camera(320, 240, 277.0, 277.0, 159.5, 119.5)
PUBLISHED = StereoConfig(subpixel="parabola", reliability="seed")


def costs(lower, here, higher, rival):
    return np.array([[[lower], [here], [higher], [rival], [here]]], np.int16)


def slanted(plain=None):
    """A grey pair whose disparity grows from 5 to 40 px from top to bottom; no texture from column `plain` on."""
    rng = np.random.default_rng(0)
    truth = np.linspace(5.0, 40.0, 240)[:, None].repeat(320, axis=1)
    scene = cv2.GaussianBlur(rng.normal(0.0, 60.0, (240, 520)).astype(np.float32), (0, 0), 1.0)
    v, u = np.mgrid[0:240, 0:320].astype(np.float32)
    left = cv2.remap(scene, u, v, cv2.INTER_CUBIC)
    right = cv2.remap(scene, u + truth.astype(np.float32), v, cv2.INTER_CUBIC)
    if plain is not None:
        left[u >= plain], right[u >= plain - truth] = 0.0, 0.0
    grey = [
        np.clip(128.0 + image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    return StereoView(grey[0], grey[1], 0.08, CAMERA), truth


@pytest.mark.parametrize("vertex", [-0.4, -0.1, 0.0, 0.25, 0.5])
def test_the_vertex_of_a_parabola_is_found(vertex):
    lower, here, higher = (round(400.0 * (k - vertex) ** 2 + 50.0) for k in (-1, 0, 1))
    found = published_stereo.parabola(np.array([[12]], np.int16), costs(lower, here, higher, 9000))
    assert found[0, 0] == pytest.approx(12.0 + vertex, abs=2e-3)  # costs are whole numbers


def test_at_the_end_of_the_search_the_disparity_is_whole():
    found = published_stereo.parabola(np.array([[0]], np.int16), costs(32767, 50, 300, 9000))
    assert found[0, 0] == 0.0


@pytest.mark.parametrize(
    ("lower", "here", "higher", "rival", "expected"),
    [
        (900, 100, 900, 400, 1.0),  # sharp and unique
        (262, 100, 262, 400, 1.0),  # s = 162 over 81 pixels is s_0
        (181, 100, 181, 400, 0.5),  # half of it
        (900, 100, 900, 100, 0.0),  # a second minimum as low
        (900, 200, 900, 215, 0.5),  # c_2 / c_0 - 1 is half of u_0
        (0, 0, 0, 0, 0.0),  # images without any texture
    ],
)
def test_reliability_is_sharpness_times_uniqueness(lower, here, higher, rival, expected):
    found = published_stereo.reliability(costs(lower, here, higher, rival), 0.15)
    assert found[0, 0] == pytest.approx(expected, abs=1e-6)


def test_the_published_stereo_measures_a_slanted_plane():
    view, truth = slanted()
    found = disparity(view, PUBLISHED)
    visible = np.arange(320)[None, :] > truth + 8
    accepted = found.reliability >= PUBLISHED.least_reliability
    error = (found.disparity_px - truth)[accepted & visible]
    assert np.mean(accepted[visible]) > 0.8
    assert np.mean(np.abs(error) > 1.0) < 0.02
    assert np.sqrt(np.mean(error[np.abs(error) < 1.0] ** 2)) < 0.25  # seed 003: sigma_d


def test_the_v_is_closer_to_a_slanted_plane_than_the_parabola():
    view, truth = slanted()
    errors = []
    for subpixel in ("v", "parabola"):
        found = disparity(view, StereoConfig(subpixel=subpixel))
        error = (found.disparity_px - truth)[found.reliability >= 0.3]
        errors.append(np.sqrt(np.mean(error[np.abs(error) < 1.0] ** 2)))
    assert errors[0] < errors[1]


def test_the_published_reliability_rejects_most_of_a_plain_wall():
    view, _ = slanted(plain=180)
    z = depth(view, PUBLISHED).z
    assert np.mean(np.isfinite(z[:, 60:170])) > 0.7
    assert np.mean(np.isfinite(z[:, 190:])) < 0.5 * np.mean(np.isfinite(z[:, 60:170]))


def test_an_unknown_formula_is_refused_by_name():
    with pytest.raises(ConfigError, match="subpixel='cubic' is unknown; choose v, parabola"):
        StereoConfig(subpixel="cubic")
    with pytest.raises(ConfigError, match="reliability='best' is unknown; choose ours, seed"):
        StereoConfig(reliability="best")
