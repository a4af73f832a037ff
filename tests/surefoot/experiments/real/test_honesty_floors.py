"""The study of floors against their claims: its measure, and recordings of which a few frames are enough."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.plane import Plane
from surefoot.experiments.real import honesty_floors
from surefoot.experiments.real.honesty_floors import PARTS, Pair, nees

UP = np.array([0.0, -1.0, 0.0])


def test_the_measure_is_the_squared_error_over_both_covariances_per_degree_of_freedom():
    found = Plane(UP, 1.03, np.diag([0.01**2, 0.01**2, 0.03**2]))
    known = Plane(UP, 1.0, np.diag([0.01**2, 0.01**2, 0.04**2]))
    assert nees(Pair(found, known)) == pytest.approx(0.03**2 / 0.05**2 / 3.0)
    assert nees(Pair(found, known, height_only=True)) == pytest.approx(0.03**2 / 0.05**2)
    assert nees(Pair(found, known), truth=0.0) == pytest.approx(1.0 / 3.0)


@pytest.mark.parametrize(
    "name", ["pcl_kinect", "redwood_livingroom", "rtabmap_3it", "sunrgbd_kinect2"]
)
def test_floors_of_real_recordings_are_no_surer_than_they_are_right(recordings, name):
    pairs = PARTS[name](lambda line: None)
    assert pairs
    assert np.median([nees(one) for one in pairs]) <= 2.0


def test_a_recording_without_floors_counts_as_a_miss(monkeypatch):
    monkeypatch.setattr(honesty_floors, "PARTS", {"empty": lambda say: []})
    figures, rows = honesty_floors.part(lambda line: None)
    assert figures["floor_anees_max"] == np.inf
    assert "no floor found" in rows[1]
