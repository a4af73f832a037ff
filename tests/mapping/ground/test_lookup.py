"""Places looked up in the labels of an image."""

from __future__ import annotations

import numpy as np

from mapping.ground.lookup import looked_up
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3, head_rotation


def test_places_beside_the_view_of_a_lens_that_folds_have_no_label():
    kitti = (-0.3728755, 0.2037299, 2.219027e-3, 1.383707e-3, -0.07233722)  # folds at 50 deg
    lens = Camera(1392, 512, 984.2, 980.8, 690.0, 233.2, kitti)
    labels = np.ones((lens.height, lens.width), np.int8)
    bearings = np.radians(np.arange(0, 80))
    places = 1.5 * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    level = Pose3.from_rotation(head_rotation(0.0, 0.0), np.zeros(3))
    found, _ = looked_up(labels, places, np.zeros(80), level, lens)
    assert (found[:40] == 1).all()
    assert (found[45:] == -1).all()  # the row of the centre ends at 42 deg
