"""The surface map in a second thread gives the surface of the map it wraps, and its errors."""

import numpy as np
import pytest

from mapping.surface.background import Background
from mapping.surface.tsdf import Tsdf
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


def wall(distance_m):
    z = np.full((48, 64), distance_m, np.float32)
    return Depth(z, np.full_like(z, 0.002), CAMERA)


def test_images_are_fused_in_the_order_of_the_calls_to_the_same_bits():
    plain, threaded = Tsdf(), Background(Tsdf())
    for number in range(6):
        for surface in (plain, threaded):
            surface.integrate(wall(1.0 + 0.004 * number), Pose3((0.0, 0.0, 0.002 * number)))
    ours, theirs = threaded.mesh(), plain.mesh()
    assert len(ours.vertices) > 100
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)
    np.testing.assert_array_equal(ours.triangles, theirs.triangles)


def test_an_image_that_does_not_fit_is_refused_at_the_latest_with_the_mesh():
    surface = Background(Tsdf())
    surface.integrate(wall(1.0), Pose3(), np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(InputError, match="register it first"):
        surface.mesh()
