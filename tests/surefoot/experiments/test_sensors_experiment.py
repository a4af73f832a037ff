"""The trial of the cameras: surfaces told from outlines, wrap and flying pixels found where they must be."""

import numpy as np
import pytest

from surefoot.experiments.joint import sensors


def test_an_outline_is_no_surface_and_a_slanting_wall_is_one():
    rows, columns = np.mgrid[0:40, 0:60].astype(float)
    slanting = 1.0 + 0.05 * columns + 0.02 * rows
    slanting[:, 30:] += 0.5  # another wall, half a metre behind
    slanting[10, 10] = np.nan
    calm = sensors.on_one_surface(slanting)
    assert not calm[:, 29:31].any()
    assert not calm[9:12, 9:12].any()
    assert calm[2:8, 2:27].all()
    assert calm[2:-2, 33:-2].all()


def test_far_ranges_wrap_and_edges_fly(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = sensors.wrapped_and_flying()
    assert found.figures["wrapped_share"] == pytest.approx(1.0, abs=0.01)
    # the right edge of the box alone, before a wall 1.5 m behind it, is some 60 pixels high
    assert found.figures["flying_pixels"] > 50
    # turning sweeps 5 px between first and last picture, along that edge and as much along others
    assert 300 < found.figures["motion_pixels"] < 3000
    assert (tmp_path / sensors.PICTURES / "time-of-flight.png").stat().st_size > 5000
