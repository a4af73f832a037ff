"""The pose graph places views that have a prior or a certain link."""

import numpy as np
import pytest

from mapping.panorama.adjustment import Prior, adjust
from mapping.panorama.pairs import Link
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3, head_rotation

FIRST = Prior(Pose3.from_rotation(CAMERA_IN_BODY_AXES, np.zeros(3)), 1e-6 * np.eye(6))
TURN = Pose3.from_rotation(head_rotation(0.0, 0.2), np.array([0.1, 0.0, 0.0]))


@pytest.mark.parametrize("rotations_only", [True, False])
def test_a_view_without_prior_is_placed_by_a_certain_pair(rotations_only):
    sure = Link(0, 1, TURN, 1e-6 * np.eye(6), 50, 60)
    placed = adjust([FIRST, None], [sure], rotations_only)
    assert placed[1] is not None
    expected = FIRST.pose.rotation @ TURN.rotation
    np.testing.assert_allclose(placed[1].T_base_camera.rotation, expected, atol=1e-6)
    vague = Link(0, 1, TURN, 4.0 * np.eye(6), 50, 60)
    assert adjust([FIRST, None], [vague], rotations_only)[1] is None
    assert adjust([FIRST, None], [], rotations_only)[1] is None
