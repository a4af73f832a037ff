"""The active stereo camera: noise, nearest depth, shadow beside near objects, lasting errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.depth import structured_light
from perception.primitives.errors import ConfigError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose2, Pose3
from sim.robots import catalogue
from sim.scene import FloorArea, Scene, StaticObject
from sim.sensors.depth_camera import UNIT_M, DepthCamera, DepthCameraConfig
from sim.shapes import Box
from sim.world import World
from surefoot.config.presets import fitted
from surefoot.config.schema import Config

EXACT = DepthCameraConfig(noise_px=0.0, bend_px=0.0, scale_share=0.0)
AHEAD = Pose3.from_matrix(  # along x, 1 m high
    np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.0], [0, 0, 0, 1]], float)
)


def scene_with(*boxes):
    """A floor 20 m wide with boxes on it."""
    extent = (-10.0, -10.0, 10.0, 10.0)
    items = tuple(StaticObject(f"box {k}", (box,)) for k, box in enumerate(boxes))
    area = (FloorArea("plain/slate", extent),)
    return Scene("test", 0, extent, area, items, (), (), Pose2(), ())


def wall(away_m, y=0.0, width_m=20.0):
    return Box((away_m + 0.5, y, 2.0), (1.0, width_m, 4.0), 0.0, "plain/slate")


def measured(config, *boxes, seed=0):
    with World(scene_with(*boxes)) as world:
        camera = DepthCamera(config, np.random.default_rng(seed))
        return camera, [camera.measure(world.ranges("rays"), AHEAD) for _ in range(2)]


@pytest.mark.parametrize("away_m", [0.6, 1.2, 2.4])
def test_noise_grows_with_the_square_of_depth_as_the_maker_states(away_m):
    config = replace(EXACT, noise_px=0.08)
    camera, (first, second) = measured(config, wall(away_m))
    middle = np.s_[80:160, 150:280]
    found = (first - second)[middle].std() / np.sqrt(2.0)
    expected = 0.08 * away_m**2 / (2.0 * camera.camera.fx * 0.05)
    assert found == pytest.approx(expected, rel=0.12, abs=0.4 * UNIT_M)
    assert np.nanmedian(first[middle]) == pytest.approx(away_m, abs=2e-3 + 0.3 * expected)


def test_noise_is_alike_within_a_block_and_not_beyond():
    _, (first, second) = measured(replace(EXACT, noise_px=0.08), wall(1.5))
    error = (first - second)[80:160, 150:280]
    error -= error.mean()
    for apart, low, high in ((1, 0.6, 1.0), (10, -0.1, 0.1)):
        alike = np.mean(error[:, apart:] * error[:, :-apart]) / np.mean(error**2)
        assert low < alike < high


def test_what_is_too_near_has_no_depth():
    _, (near, _) = measured(EXACT, wall(0.2))
    _, (far, _) = measured(EXACT, wall(0.4))
    assert np.isnan(near[120, 200:220]).all()
    assert far[120, 212] == pytest.approx(0.4, abs=2e-3)


def test_beside_a_near_object_a_strip_of_the_background_is_hidden_from_the_right_imager():
    """Its width is the difference of the two disparities, on the left side only."""
    camera, (z, _) = measured(
        EXACT, wall(2.0), Box((1.0, 0.0, 1.0), (0.02, 0.4, 4.0), 0.0, "plain/slate")
    )
    row = z[120]
    front = np.flatnonzero(row < 1.5)
    gap = np.flatnonzero(np.isnan(row) & (np.arange(len(row)) > 30))
    width = camera.camera.fx * 0.05 * (1.0 / 0.99 - 1.0 / 2.0)
    assert len(gap) == pytest.approx(width, abs=2.0)
    assert gap.max() < front.min() + 2
    assert np.isfinite(row[front.max() + 2 : front.max() + 30]).all()


def test_a_slanted_surface_keeps_its_depth():
    """The floor from 1 m above; the nearest pixel of each block would be a whole row nearer."""
    camera, (z, _) = measured(EXACT)
    rows = np.arange(180, 235)
    true = camera.camera.fy / (rows - camera.camera.cy)
    error = np.nanmean(z[180:235, 100:320], axis=1) / true - 1.0
    assert abs(error.mean()) < 1e-3
    assert np.abs(error).max() < 0.2 / (rows - camera.camera.cy).min()


def test_a_near_object_is_widened_by_a_pixel_over_what_is_behind_it():
    """Upwards; to the left the right imager sees nothing of what is behind."""
    for top_m in (0.6, 0.7, 0.8, 0.9):
        box = Box((1.0, 0.0, top_m / 2), (0.02, 0.4, top_m), 0.0, "plain/slate")
        camera, (z, _) = measured(EXACT, wall(2.0), box)
        true = camera.camera.cy + camera.camera.fy * (1.0 - top_m) / 1.01  # its far edge
        first = np.flatnonzero(z[:, 212] < 1.5).min()
        assert first == np.ceil(true) - 1


def test_the_claims_of_the_g1_cover_the_noise_of_its_camera():
    """Its description knows what the maker states, and nothing of the simulated camera."""
    config = fitted(replace(Config(), robot=replace(Config().robot, model="g1")))
    sensor = catalogue.load("g1").sensor("depth")
    camera, images = measured(replace(EXACT, noise_px=0.08), wall(1.8))
    assert (camera.camera.width, camera.camera.height) == (sensor.width, sensor.height)
    errors = []
    for image in images:
        view = DepthView(image, camera.camera, Pose3())
        depth = structured_light.depth(view, config.structured_light)
        errors.append((depth.z - 1.8)[80:160, 150:280] / depth.sigma[80:160, 150:280])
    assert 0.4 < np.mean(np.square(errors)) < 1.2


def test_lasting_errors_are_the_same_in_every_image_and_others_for_another_camera():
    config = replace(EXACT, bend_px=0.02, scale_share=0.001)
    _, (first, second) = measured(config, wall(2.0))
    _, (other, _) = measured(config, wall(2.0), seed=1)
    seen = np.isfinite(first) & np.isfinite(other)
    assert np.array_equal(first, second, equal_nan=True)
    assert 0.0 < np.abs(first[seen] - 2.0).mean() < 0.03
    assert not np.array_equal(first[seen], other[seen])


def test_impossible_values_are_refused():
    with pytest.raises(ConfigError, match="across_deg"):
        DepthCameraConfig(across_deg=180.0)
    with pytest.raises(ConfigError, match="baseline_m"):
        DepthCameraConfig(baseline_m=0.0)
