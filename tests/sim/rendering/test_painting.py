"""Textured scenes: textures respect their limits for any room size and show objects at their places."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from sim.rendering import painting
from sim.rendering.painting import paint_scene
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.shapes import Box

RED = FloorArea("plain/red", (1.0, 0.5, 2.0, 1.5))


def room(extent, static_objects=(), areas=()):
    building = walls(extent, ("plain/white",) * 4)
    floor = (FloorArea("plain/lime", extent), *areas)
    return Scene(
        "room", 0, extent, floor, (*building, *static_objects), (), (), Pose2(0.5, 0.5), ()
    )


def is_red(image, extent, x, y):
    rows, columns = image.shape[:2]
    row = round((extent[3] - y) / (extent[3] - extent[1]) * rows - 0.5)
    column = round((x - extent[0]) / (extent[2] - extent[0]) * columns - 0.5)
    red, green, _ = (int(v) for v in image[row, column])
    return red > 2 * green


@pytest.mark.parametrize("budget", [1e4, 1e5, 1e9])
def test_floor_texture_respects_its_limit_and_places_its_areas(monkeypatch, budget):
    monkeypatch.setattr(painting, "MOST_PX", budget)
    extent = (0.0, 0.0, 4.0, 2.0)
    image = paint_scene(room(extent, areas=[RED]))[0][0].texture
    finest = 4.0 / painting.FLOOR_RESOLUTION_M * 2.0 / painting.FLOOR_RESOLUTION_M
    assert image.shape[0] * image.shape[1] == pytest.approx(min(budget, finest), rel=0.05)
    for x, y, red in (
        (1.5, 1.0, True), (1.1, 0.6, True), (1.9, 1.4, True), (0.9, 1.0, False), (2.1, 1.0, False),
        (1.5, 0.4, False), (1.5, 1.6, False),
    ):  # fmt: skip
        assert is_red(image, extent, x, y) == red


def test_the_texture_of_a_long_corridor_stays_within_the_side_limit():
    still, _ = paint_scene(room((0.0, 0.0, 40.0, 1.0)))
    longest = max(max(painted.texture.shape[:2]) for painted in still)
    assert 4096 < longest <= 8192


def test_an_area_of_less_than_a_pixel_is_left_out(monkeypatch):
    monkeypatch.setattr(painting, "MOST_PX", 1e3)
    tiny = FloorArea("plain/red", (1.001, 1.001, 1.003, 1.003))
    image = paint_scene(room((0.0, 0.0, 4.0, 2.0), areas=[tiny]))[0][0].texture
    assert not (image[..., 0].astype(int) > 2 * image[..., 1].astype(int)).any()


def test_objects_outside_the_walls_are_not_painted():
    extent = (0.0, 0.0, 2.0, 2.0)
    outside = StaticObject("crate", (Box((9.0, 1.0, 0.2), (0.4, 0.4, 0.4)),))
    inside = StaticObject("crate", (Box((1.0, 1.0, 0.2), (0.4, 0.4, 0.4)),))
    plain = len(paint_scene(room(extent))[0])
    assert len(paint_scene(room(extent, [outside]))[0]) == plain
    still, _ = paint_scene(room(extent, [outside, inside]))
    assert len(still) == plain + 1
    np.testing.assert_allclose(still[-1].vertices[:, :2].mean(axis=0), [1.0, 1.0])
