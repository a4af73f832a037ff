"""The sensors experiment: surfaces are separated from edges, and wrapped and flying pixels are counted."""

import numpy as np
import pytest

from surefoot.experiments.joint import sensors
from surefoot.experiments.support.simulated_depth import on_one_surface


def test_edges_are_excluded_and_slanted_walls_are_smooth():
    rows, columns = np.mgrid[0:40, 0:60].astype(float)
    slanted = 1.0 + 0.05 * columns + 0.02 * rows
    slanted[:, 30:] += 0.5  # another wall, half a metre behind
    slanted[10, 10] = np.nan
    smooth = on_one_surface(slanted)
    assert not smooth[:, 29:31].any()
    assert not smooth[9:12, 9:12].any()
    assert smooth[2:8, 2:27].all()
    assert smooth[2:-2, 33:-2].all()


def test_far_ranges_wrap_and_edges_have_flying_pixels():
    found = sensors.wrapped_and_flying()
    assert found.figures["wrapped_share"] == pytest.approx(1.0, abs=0.01)
    # the right edge of the box alone, 1.5 m in front of a wall, is about 60 pixels high
    assert found.figures["flying_pixels"] > 50
    # the rotation moves edges by 5 px between the first and last exposure
    assert 300 < found.figures["motion_pixels"] < 3000
    assert len(found.drawings[0].draw().axes) >= 4
