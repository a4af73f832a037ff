"""The avoidance planner in a passage that turns out to be blocked."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.estimate import Estimate
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from planning.avoidance.primitives import Leg
from planning.planners.avoidance_planner import AvoidancePlanner
from planning.planners.settings import PlanningConfig
from planning.world_model import WorldModel


@pytest.mark.parametrize(
    ("leg", "face"),
    [(Leg("F", Pose2(1.5, 0.0, 0.0), 0.6), (1.0, 0.0)), (Leg("S", Pose2(0.0, 0.8, 0.0)), (0.0, 1.0))],
)  # fmt: skip
@pytest.mark.parametrize("gone_m", [0.0, 0.1, 0.7])
def test_the_robot_goes_back_no_farther_than_it_came(leg, face, gone_m):
    """Behind the place where a leg began may be what the robot never saw."""
    empty = EgocentricGrid(GridConfig(), np.zeros(2))
    ahead = empty.centres() @ face - gone_m
    across = np.abs(empty.centres() @ face[::-1])
    content = empty.snapshot()
    blocked = (ahead > 0.1) & (ahead < 0.3) & (across < 0.3)
    content["log_odds"] = np.where(blocked, 3.0, -3.0).astype(np.float32)
    grid = EgocentricGrid.restored(GridConfig(), content)
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    planner._phase, planner._legs, planner._begun = "pass", [leg], Pose2()
    planner.choices = [SimpleNamespace(motion="FF")]
    pose, where = Pose2(gone_m * face[0], gone_m * face[1], 0.0), []
    for k in range(40):
        at = Gaussian(pose.vector, 1e-6 * np.eye(3))
        walk = planner.decide(WorldModel(Estimate(k * 0.65, at), grid)).walk
        pose = pose @ Pose2(walk.forward_m, walk.lateral_m, walk.turn_rad)
        where.append(pose.vector[:2] @ face)
    assert min(where) > max(0.0, gone_m - 0.45) - 0.04
    assert max(where) < gone_m + 0.04
    assert min(where) < gone_m - 0.3 or gone_m < 0.4
