"""The search by random triples where hardly anything is a floor."""

from __future__ import annotations

import numpy as np
import pytest

from perception.floor import _search_kernels as kernels
from perception.floor.choose import GATE_SIGMAS
from perception.floor.prior import gate, handheld_prior
from perception.floor.sample import SHARP, Sample

ON, BASE_M = 6, 0.01


@pytest.mark.parametrize("score", [1e-9, 1e-5, 1e-2, 0.5, 6.0])
def test_a_plane_that_points_below_outweigh_almost_is_searched_on(score):
    """Six points of a floor 1 m below the camera and one far below it, which costs six less the score."""
    across, ahead = np.meshgrid([-0.5, 0.0, 0.5], [2.0, 2.5])
    x, z = np.append(across.ravel(), 0.1), np.append(ahead.ravel(), 2.2)
    sample = Sample(x, np.append(np.ones(ON), 9.0), z, np.zeros(ON + 1))
    searched = gate(handheld_prior(None), GATE_SIGMAS, np.radians(60.0), 0.03)
    a, b, c, rho, found = kernels.msac(
        sample, searched, BASE_M, ON - score, 0.0, SHARP, np.uint64(1)
    )
    assert found == pytest.approx(score, rel=1e-6)
    assert (a, b, c, rho) == pytest.approx((0.0, -1.0, 0.0, 1.0), abs=1e-9)
