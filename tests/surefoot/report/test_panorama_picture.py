"""The picture of a panorama: every obstacle and gap with its number, at its azimuth, readable."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.panorama.obstacles import PanoramaObstacle, Surroundings, gaps_between
from mapping.panorama.rendering import Drawing
from mapping.panorama.sphere import Sphere
from surefoot.report.plots import panorama, style

ENDS_DEG = (100.0, -100.0)
EDGES_DEG = [(80.0, 67.0), (60.0, -18.0), (-37.0, -44.0), (-46.0, -66.0), (-70.0, -78.0), (-79.0, -80.0)]  # fmt: skip


@pytest.fixture
def picture():
    def at(azimuth_deg: float) -> tuple[float, float]:
        return math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))

    obstacles = tuple(
        PanoramaObstacle(
            math.radians(left), math.radians(right), 0.5, abs(at(left)[1] - at(right)[1]), 0.2,
            left_edge_m=at(left), right_edge_m=at(right),
        )
        for left, right in EDGES_DEG
    )  # fmt: skip
    ends = (math.radians(ENDS_DEG[0]), math.radians(ENDS_DEG[1]))
    sphere = Sphere.window(-ends[0], -ends[1], -0.8, 0.3, 4.0 / math.radians(1.0))
    shape = (sphere.height, sphere.width)
    range_m = np.full(shape, 2.0, np.float32)
    drawing = Drawing(
        sphere, np.zeros(3), range_m, range_m, np.zeros(shape), np.zeros(shape, np.int64)
    )
    found = Surroundings(obstacles, gaps_between(obstacles, ends, 4.0))
    with style.styled():
        figure = panorama.obstacles(drawing, found)
        figure.canvas.draw()
        yield figure, found


def test_every_obstacle_and_gap_has_its_number_at_its_azimuth(picture):
    figure, found = picture
    axes = figure.axes[0]
    places = {text.get_text(): text.get_position()[0] for text in axes.texts}
    names = [f"{k + 1}" for k in range(len(EDGES_DEG))]
    assert set(places) == {*names, *(f"gap {k + 1}" for k in range(len(found.gaps)))}
    assert {gap.left for gap in found.gaps} > {None}
    labels = [float(tick.get_text()) for tick in axes.get_xticklabels()]
    degrees_per_px = np.diff(labels)[0] / np.diff(axes.get_xticks())[0]
    for name, (left, right) in zip(names, EDGES_DEG, strict=True):
        azimuth = labels[0] + degrees_per_px * (places[name] - axes.get_xticks()[0])
        assert azimuth == pytest.approx((left + right) / 2, abs=0.3)


def test_no_number_covers_another(picture):
    boxes = [text.get_window_extent() for text in picture[0].axes[0].texts]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
