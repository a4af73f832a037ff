"""The published gaze against eq. (1) to (6), (7) and (11) of seed 001, summed direction by direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, head_rotation
from perception.primitives.robot_model import DARWIN_OP
from planning.commands import GazeCommand
from planning.gaze.attention import GazeContext
from planning.gaze.policy import GazeConfig, GazeControl
from planning.gaze.selection import GazeMapConfig
from planning.univector.published_gaze import PublishedGaze, concerned

GAZE = GazeMapConfig()
ROBOT = DARWIN_OP
VIA = np.array([1.5, 0.4])
SIGMA_M = 0.04
SPREAD_M = 0.05


def obstacle(x, y, vx=0.0, vy=0.0):
    state = Gaussian(np.array([x, y, vx, vy]), np.diag([SPREAD_M**2] * 2 + [1e-4] * 2))
    return Obstacle(state, 0.1, 0.4, 1, 1.0 if vx or vy else 0.0, 0.0, -9.0)


def context(landmarks=(), grid=None, confidence=None):
    pose = Gaussian(np.zeros(3), np.diag([SIGMA_M**2, 1e-6, 1e-6]))
    return GazeContext(pose, grid, confidence, landmarks)


def sees(pan, tilt, place):
    right, below, ahead = head_rotation(pan, tilt).T @ np.array(place)
    across, down = (math.tan(math.radians(v) / 2) for v in (GAZE.across_deg, GAZE.down_deg))
    return ahead > 0.0 and abs(right) <= across * ahead and abs(below) <= down * ahead


def on_floor(x, y):
    return np.array([x, y, -ROBOT.eye_m])


def test_the_map_is_the_weighted_sum_of_the_evaluations():
    comes = obstacle(0.9, -0.5, -0.08, 0.05)
    leaves = obstacle(-0.8, 0.3, -0.09, 0.0)  # behind, and goes away: not counted
    stands = obstacle(0.6, 0.7)
    found = PublishedGaze(GazeConfig()).total(VIA, [comes, leaves, stands], context())
    psi_self = SIGMA_M / 0.10
    alpha = SPREAD_M * math.hypot(0.08, 0.05) / math.hypot(0.9, 0.5)
    psi = {id(comes): min(alpha / 0.02, 1.0), id(stands): 0.0}
    gaps = []
    for one in (comes, stands):
        speed = float(np.hypot(*one.velocity))
        importance = psi_self + psi[id(one)]
        S = ROBOT.radius_m + 0.1 + 0.5 * speed + 0.05 * importance
        gaps.append(float(np.hypot(*one.position)) - S)
        if speed:  # eq. (11) with xi = 0.7
            along = one.velocity / speed
            ahead = -float(one.position @ along)
            relative = np.hypot(*(one.velocity - [ROBOT.gait.cruise_mps, 0.0]))
            h = ahead / (12.0 * relative + 0.3 * importance)
            if ahead > 0.0 and h < 1.0:
                foot = one.position + ahead * along
                R = S * (1.0 - h) / (1.0 - h + (0.3 / 0.7) ** 2 * h)
                gaps.append(float(np.hypot(*foot)) - min(R, float(np.hypot(*foot))))
    psi_way = min(max(min(gaps), 0.0), 1.0)
    for i, pan in enumerate(GAZE.pans):
        for j, tilt in enumerate(GAZE.tilts):
            wanted = 0.25 * psi_way * sees(pan, tilt, on_floor(*VIA))
            for one in (comes, stands):
                if sees(pan, tilt, on_floor(*one.position)):
                    wanted += (0.25 * psi_self + 0.25 * psi[id(one)]) / 2.0
            assert found[i, j] == pytest.approx(wanted, abs=1e-9)


def test_obstacles_ahead_count_and_of_those_behind_only_the_approaching_ones():
    places = np.array([[1.0, 0.2], [1.0, 0.2], [-0.5, 0.1], [-0.5, 0.1], [-0.5, 0.1]])
    velocities = np.array([[0.0, 0.0], [0.5, 0.0], [0.02, 0.0], [0.2, 0.0], [-0.2, 0.0]])
    found = concerned(places, velocities, 0.06)
    assert found.tolist() == [True, True, False, True, False]


def test_a_landmark_serves_localisation_in_place_of_the_obstacles():
    mark = Landmark(3, (0.2, 1.5, 0.4), 0.16)
    gaze = PublishedGaze(GazeConfig())
    change = gaze.total(VIA, [], context((mark,))) - gaze.total(VIA, [], context())
    pan = math.atan2(1.5, 0.2)
    i = int(np.argmin(np.abs(GAZE.pans - pan)))
    j = int(np.argmin(np.abs(GAZE.tilts)))
    assert change[i, j] == pytest.approx(0.25 * SIGMA_M / 0.10)
    assert change[0, -1] == 0.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_head_turns_to_the_stale_side(side):
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    confidence = ConfidenceLayer(grid)
    confidence.see(side * grid.centres()[..., 1] < 0.1)  # fresh on the other side
    control = GazeControl(GazeConfig(mode="seed"), ROBOT)
    far = np.array([0.0, 0.0])  # the way point under the robot is in no view
    gaze = control.next(0.0, Pose2(), far, [], context((), grid, confidence))
    assert isinstance(gaze, GazeCommand)
    assert side * gaze.pan_rad > math.radians(20.0)
