"""Jacobians of the rigid alignment of a trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from perception.odometry.pose_uncertainty import rigid_alignment

PLACES = np.random.default_rng(0).normal(size=(6, 3)) * (1.0, 0.6, 0.1)


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (40.0, -7.0, 3.0)])
def test_a_rigid_motion_is_found_whole_wherever_the_trajectory_is(off):
    moves, best = rigid_alignment(PLACES + off)
    np.testing.assert_allclose(np.einsum("nij,njk->ik", best, moves), np.eye(6), atol=1e-9)
    turn = np.array([0.0, 0.0, 0.0, 0.02, -0.01, 0.03])
    moved = (moves @ turn)[:, :3]
    arms = PLACES - PLACES.mean(axis=0)
    np.testing.assert_allclose(moved, np.cross(turn[3:], arms), atol=1e-12)
