"""Which of two motions explains a pair of images better, against rendered images of a wall and a floor."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth import structured_light
from perception.odometry.alignment import AlignConfig, evaluate, explains_better
from perception.odometry.pyramid import Pyramid, build
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
TRUE = Pose3((0.5, 0.0, 0.0))  # a camera that moved along the wall: a fifth of the view is new
SLID = Pose3()  # the same view of wall and floor


def wall(x_m: float, contrast: float, rng: np.random.Generator) -> Pyramid:
    """A wall 2 m ahead and a floor 0.9 m below, with grey waves along x, and noise."""
    z = np.minimum(2.0, 0.9 / np.maximum(CAMERA.rays[..., 1], 1e-6))
    along = x_m + CAMERA.rays[..., 0] * z
    grey = 128.0 + contrast * np.sin(2 * np.pi * along / 0.7)
    grey += rng.normal(0.0, 2.0, z.shape)
    z = z + rng.standard_normal(z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    rgb = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
    return build(structured_light.depth(DepthView(z.astype(np.float32), CAMERA)), rgb)


def pair(contrast: float, seed: int = 0) -> tuple[Pyramid, Pyramid]:
    rng = np.random.default_rng(seed)
    return wall(0.0, contrast, rng), wall(TRUE.position[0], contrast, rng)


def test_a_view_that_slid_along_a_textured_wall_is_told_from_the_true_one() -> None:
    first, second = pair(40.0)
    overlaps = [evaluate(first, second, one.matrix) for one in (TRUE, SLID)]
    assert overlaps[0] is not None
    assert overlaps[1] is not None
    assert overlaps[1].overlap > overlaps[0].overlap
    assert explains_better(first, second, TRUE, SLID, AlignConfig())
    assert not explains_better(first, second, SLID, TRUE, AlignConfig())


@pytest.mark.parametrize(("contrast", "method"), [(0.0, "hybrid"), (40.0, "depth")])
@pytest.mark.parametrize("seed", range(5))
def test_what_the_images_do_not_tell_is_not_decided(
    contrast: float, method: str, seed: int
) -> None:
    first, second = pair(contrast, seed)
    assert not explains_better(first, second, TRUE, SLID, AlignConfig(method=method))
    assert not explains_better(first, second, SLID, TRUE, AlignConfig(method=method))


def test_a_motion_with_little_in_view_is_not_compared() -> None:
    first, second = pair(40.0)
    away = Pose3((TRUE.position[0] + 1.6, 0.0, 0.0))
    assert not explains_better(first, second, TRUE, away, AlignConfig())
    assert not explains_better(first, second, away, TRUE, AlignConfig())
