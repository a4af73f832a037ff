"""A coloured cylinder through lenses with and without distortion, against its known place."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.obstacles.colour_detection import ColouredConfig, detect
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView
from perception.primitives.pose import Pose3, head_rotation

ORANGE = (232, 128, 40)
RADIUS_M, HEIGHT_M = 0.05, 0.2
EYE = Pose3.from_rotation(head_rotation(0.0, math.radians(25)), np.array([0.02, 0.0, 0.40]))


def picture(camera: Camera, x: float, y: float) -> np.ndarray:
    """An orange cylinder on grey ground: the pixels whose ray meets its side or its top."""
    rays = camera.rays.reshape(-1, 3) @ EYE.rotation.T
    eye = EYE.position - (x, y, 0.0)
    a, b = (rays[:, :2] ** 2).sum(axis=1), rays[:, :2] @ eye[:2]
    root = b * b - a * (eye[:2] @ eye[:2] - RADIUS_M**2)
    side = eye[2] + (-b - np.sqrt(np.maximum(root, 0.0))) / a * rays[:, 2]
    over = eye[:2] + ((HEIGHT_M - eye[2]) / rays[:, 2])[:, None] * rays[:, :2]
    top = (rays[:, 2] < 0.0) & (np.hypot(*over.T) < RADIUS_M)
    met = ((root > 0.0) & (side >= 0.0) & (side <= HEIGHT_M)) | top
    rgb = np.where(met[:, None], np.array(ORANGE), 120).astype(np.uint8)
    return rgb.reshape(camera.height, camera.width, 3)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.28, 0.07, 0.0, 0.0, 0.0)])
def test_an_obstacle_is_where_it_stands_through_any_lens(distortion):
    camera = Camera(640, 480, 420.0, 420.0, 319.5, 239.5, distortion)
    for place in ((0.6, 0.0), (0.8, 0.35), (1.0, 0.5), (1.5, -0.8)):
        rgb = picture(camera, *place)
        (found,) = detect(ColourView(rgb, camera, EYE), ColouredConfig(colours=("#e88028",)))
        error = found.position - place
        assert np.hypot(*error) < 0.01
        assert error @ np.linalg.solve(found.covariance, error) < 1.0  # camera pose is exact
        assert found.radius_m == pytest.approx(RADIUS_M, abs=0.004)
        assert found.height_m == pytest.approx(HEIGHT_M, abs=0.04)  # of its rear edge
