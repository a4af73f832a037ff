"""The bend of a depth camera by its own motion, against the bend that rendered rooms were given."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth import structured_light
from perception.depth.distortion import Bend, Distortion, DistortionConfig
from perception.odometry.depth_bend import BendEstimator
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Depth, DepthView

from .bent_room import BENT, CAMERA, IMAGES, pose, seen


def estimated(bend: Bend, still: bool = False, distortion: Distortion | None = None):
    rng = np.random.default_rng(0)
    estimator = BendEstimator(distortion or DistortionConfig().depth)
    for number in range(IMAGES):
        z, rgb = seen(pose(0 if still else number), bend, rng)
        depth = structured_light.depth(DepthView(z, CAMERA))
        estimator.add(depth, rgb)
    return estimator.solve()


@pytest.mark.parametrize("bend", [BENT, Bend()], ids=["bent", "straight"])
def test_a_moving_camera_tells_its_bend(bend):
    found = estimated(bend)
    off = found.bend.coefficients - bend.coefficients
    assert found.known.all()
    assert np.all(np.abs(off) < 3.0 * np.sqrt(np.diag(found.covariance)))
    assert np.abs(off).max() < 0.004
    assert off @ np.linalg.solve(found.covariance, off) < 15.1  # chi squared of 5 at 99 %


def test_a_camera_that_stands_still_tells_nothing():
    found = estimated(BENT, still=True)
    assert not found.known.any()
    assert not found.bend.coefficients.any()


def test_depth_that_is_known_to_be_straight_is_left_alone():
    found = estimated(BENT, distortion=Distortion())
    assert not found.known.any()
    assert not found.bend.coefficients.any()


def test_a_bend_is_taken_out_of_depth():
    rng = np.random.default_rng(1)
    bent, _ = seen(pose(5), BENT, np.random.default_rng(0))
    straight, _ = seen(pose(5), Bend(), np.random.default_rng(0))
    config = structured_light.StructuredLightConfig(bend=BENT)
    found = structured_light.depth(DepthView(bent, CAMERA), config)
    assert isinstance(found, Depth)
    assert found.z.dtype == np.float32
    np.testing.assert_allclose(
        found.z, straight, atol=2e-3
    )  # what is left is noise of up to 30 mm, as a share of the bend
    assert np.abs(bent - straight).max() > 0.03
    holes = np.where(rng.random(bent.shape) < 0.1, np.nan, bent).astype(np.float32)
    assert np.array_equal(
        np.isnan(structured_light.depth(DepthView(holes, CAMERA), config).z), np.isnan(holes)
    )


@pytest.mark.parametrize("value", [0.11, -0.11, float("nan"), float("inf")])
def test_an_impossible_bend_is_refused(value):
    with pytest.raises(ConfigError, match="right_down="):
        Bend(right_down=value)
