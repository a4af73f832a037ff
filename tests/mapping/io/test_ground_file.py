"""Surfaces of the ground in a file: what is written is read again, and any GeoJSON reader finds the polygon."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapping.ground.surface import Border, Surface
from mapping.io import ground_file
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose2

OUTLINE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]])
TREAD = Surface(
    np.array([0.5, 0.2]),
    np.array([0.16, 0.02, 0.0]),
    np.diag([0.003, 0.004, 0.005]) ** 2,
    OUTLINE,
    np.array([Border.DROP, Border.UNSEEN, Border.RISE]),
    np.array([0.004, 0.02, 0.006]),
    0.001,
    7,
)


def test_what_is_written_is_read_again(tmp_path):
    path = tmp_path / ground_file.NAME
    path.write_text(json.dumps(ground_file.entries([TREAD], Pose2(1.0, 2.0, 0.3))))
    (one,), body = ground_file.load(path)
    assert body == Pose2(1.0, 2.0, 0.3)
    for name in ("origin", "height", "covariance", "outline", "borders", "sigma_m"):
        np.testing.assert_array_equal(getattr(one, name), getattr(TREAD, name))
    assert (one.shared_m, one.views) == (0.001, 7)


def test_it_is_geojson_with_closed_counterclockwise_rings_of_three_coordinates():
    content = ground_file.entries([TREAD], Pose2())
    assert content["type"] == "FeatureCollection"
    ring = np.array(content["features"][0]["geometry"]["coordinates"][0])
    assert ring.shape == (4, 3)
    assert (ring[0] == ring[-1]).all()
    assert ring[1, 2] == pytest.approx(0.16 + 0.02 * 0.5)
    assert content["features"][0]["properties"]["borders"] == ["drop", "unseen", "rise"]


@pytest.mark.parametrize("text", ["", "[]", '{"features": [{}]}'])
def test_another_file_is_refused(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"other\.json"):
        ground_file.load(path)
