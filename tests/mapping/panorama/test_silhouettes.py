"""Edges of obstacles against closed forms: their azimuth, their height, and the deviations they claim."""

from __future__ import annotations

import math

import numpy as np

from mapping.panorama.silhouettes import LabelledView, edge_crossings, fuse_edge
from mapping.panorama.views import View
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
HEIGHT_M = 0.45


def labelled(z, mask, camera, number=0):
    z = z.astype(np.float32)
    pose = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, HEIGHT_M]))
    view = View(Depth(z, np.full_like(z, 0.004), camera), ())
    return LabelledView(view, pose, number, mask.astype(np.int32))


def test_an_edge_along_the_columns_claims_what_a_pixel_leaves_open():
    # Upright edges seen by a level camera cross all rows at one offset within a pixel.
    rng = np.random.default_rng(4)
    camera = Camera(60, 16, 200.0, 200.0, 29.5, 7.5)
    u = np.broadcast_to(np.arange(60), (16, 60))
    for views in (1, 3):
        nees = []
        for _ in range(40):
            found = []
            for number in range(views):
                edge = rng.uniform(15.0, 25.0)
                mask = u >= edge
                scene = labelled(np.where(mask, 1.0, 3.0), mask, camera, number)
                crossings = edge_crossings(scene, 1, "left", FLOOR)
                # turned so that the edge is straight ahead
                crossings.values[:] -= math.atan((camera.cx - edge) / camera.fx)
                found.append(crossings)
            one = fuse_edge(found)
            nees.append((one.value / one.sigma) ** 2)
        assert 0.5 < np.mean(nees) < 2.0


def test_the_height_of_a_top_that_fills_few_rows_is_that_of_its_far_end():
    # Three rows of a top of 0.35 m, from 1.2 to 1.4 m ahead, below a camera at 0.45 m; its front below them.
    camera = Camera(40, 144, 220.0, 228.4, 19.5, 71.5)
    down = np.broadcast_to(((np.arange(144) - camera.cy) / camera.fy)[:, None], (144, 40))
    with np.errstate(divide="ignore"):
        top = (HEIGHT_M - 0.35) / down
        floor = np.where(down > 0.0, HEIGHT_M / down, np.inf)
    on_top = (top >= 1.2) & (top <= 1.4)
    mask = on_top | ((top < 1.2) & (down > 0.0) & (1.2 * down < HEIGHT_M))
    assert on_top[:, 0].sum() == 3
    z = np.where(on_top, top, np.where(mask, 1.2, np.minimum(floor, 4.0)))
    one = fuse_edge([edge_crossings(labelled(z, mask, camera), 1, "top", FLOOR)])
    assert abs(one.value - 0.35) < 0.003
