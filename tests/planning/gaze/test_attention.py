"""The gaze map: each reason raises it at its target, and a look removes the reason."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.obstacles.clustering import Cluster, Footprint
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.obstacle import Obstacle
from planning.commands import GazeCommand
from planning.gaze.attention import (
    TAG_BEARING_RAD,
    TAG_RANGE_PER_M,
    AttentionModel,
    GazeContext,
    sample_region,
)
from planning.gaze.landmark_gain import gains
from planning.gaze.policy import GazeConfig
from planning.gaze.selection import highest_plateau, worth
from planning.gaze.untracked_targets import FORGET_S

CONFIG = GazeConfig().map
AHEAD = GazeCommand(0.0, math.radians(28.0))
VIA = np.array([2.0, 0.0])
SURE = Gaussian(np.zeros(3), np.eye(3) * 1e-8)


def at(pan_deg, tilt_deg=30.0):
    return GazeCommand(math.radians(pan_deg), math.radians(tilt_deg))


def mover(x, y, seen_s, vx=0.0, vy=0.0, moving=1.0, since_s=0.0):
    state = Gaussian(np.array([x, y, vx, vy]), np.eye(4) * 1e-6)
    return Obstacle(state, 0.1, 0.4, 7, moving, seen_s, since_s)


def values(model, stamp_s, obstacles=(), known=None, via=VIA):
    attention = model.weigh(stamp_s, via, obstacles, known or GazeContext(SURE), AHEAD)
    return attention, lambda pan, tilt=30.0: worth(attention.total, at(pan, tilt), CONFIG)


def fresh_grid():
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    confidence = ConfidenceLayer(grid)
    confidence.see(np.ones((grid.config.cells,) * 2, np.bool_))
    return grid, confidence


def test_the_path_becomes_urgent_until_it_is_looked_at():
    model = AttentionModel(CONFIG)
    model.decided(0.0, AHEAD, VIA, [], SURE)
    found = [values(model, stamp)[1](0.0) for stamp in (0.65, 1.3, 2.6)]
    assert found[0] < found[1] < found[2]
    model.decided(2.6, AHEAD, VIA, [], SURE)
    assert values(model, 3.25)[1](0.0) == pytest.approx(found[0])
    model.decided(3.25, at(90.0), VIA, [], SURE)  # looking aside changes nocluster
    assert values(model, 3.9)[1](0.0) == pytest.approx(found[1])


def test_priority_grows_with_the_time_out_of_sight_and_with_nearness():
    def worth_of(obstacle):
        model = AttentionModel(CONFIG)
        model.decided(5.0, AHEAD, VIA, [], SURE)
        attention, value = values(model, 5.0, [obstacle])
        assert attention.psi_obstacles[7] >= 0.0
        return value(60.0, 20.0)

    def place(away):
        return away * math.cos(math.radians(60)), away * math.sin(math.radians(60))

    times = [worth_of(mover(*place(1.0), 5.0 - unseen)) for unseen in (0.3, 0.6, 1.2)]
    assert times[0] < times[1] < times[2]
    near = [worth_of(mover(*place(away), 3.0)) for away in (1.0, 1.8, 2.5)]
    assert near[0] > near[1] > near[2]
    comes, goes = (mover(*place(1.0), 3.0, *(0.05 * s * v for v in place(1.0))) for s in (-1, 1))
    assert worth_of(comes) > worth_of(goes)


def test_a_look_without_a_sighting_lowers_the_priority():
    model, lost = AttentionModel(CONFIG), mover(0.5, 0.9, 0.0, since_s=-9.0)
    before = values(model, 5.0, [lost])[0].psi_obstacles[7]
    model.decided(5.0, at(60.0), VIA, [lost], SURE)
    assert values(model, 5.2, [lost])[0].psi_obstacles[7] < 0.2 * before


def test_an_obstacle_long_out_of_sight_is_also_looked_for_where_a_reversal_leads():
    lost = mover(0.5, 0.9, 0.0, 0.0, 0.10)  # by now, or back at (0.5, -0.1)
    _, value = values(AttentionModel(CONFIG), 5.0, [lost])
    nocluster = values(AttentionModel(CONFIG), 5.0, [])[1]
    assert value(60.0) > nocluster(60.0)
    assert value(-30.0, 40.0) > nocluster(-30.0, 40.0)


def test_a_static_track_has_no_priority_and_a_young_one_has():
    stands = mover(0.5, 0.9, 0.0, moving=0.01, since_s=-20.0)
    new = mover(0.5, 0.9, 0.0, moving=0.01, since_s=-0.5)
    _, value = values(AttentionModel(CONFIG), 5.0, [stands])
    _, empty = values(AttentionModel(CONFIG), 5.0, [])
    assert value(60.0) == empty(60.0)
    assert values(AttentionModel(CONFIG), 5.0, [new])[1](60.0) > empty(60.0)


def test_the_priority_of_an_untracked_cluster_falls_with_each_look_and_recovers():
    cluster = Cluster(
        np.array([0.5, 0.9]), np.eye(2) * 1e-4, 0.1, 0.4, 50, Footprint(0.2, 0.2, 0.0)
    )
    model, known = AttentionModel(CONFIG), GazeContext(SURE, clusters=(cluster,))
    found = []
    for k, gaze in enumerate((at(-60.0), at(60.0), at(60.0), at(60.0))):
        empty = values(AttentionModel(CONFIG), 1.0 + k)[1](60.0)
        found.append(values(model, 1.0 + k, (), known)[1](60.0) - empty)
        model.decided(1.0 + k, gaze, VIA, [], SURE)
    assert found[1] == pytest.approx(found[0])  # a look elsewhere does not count
    assert found[1] > found[2] > found[3] > 0.0
    later = 4.0 + FORGET_S
    again = values(model, later, (), known)[1](60.0)
    assert again - values(AttentionModel(CONFIG), later)[1](60.0) == pytest.approx(found[0])
    tracked = [mover(0.5, 0.9, 1.0, moving=0.01, since_s=-20.0)]
    empty = values(AttentionModel(CONFIG), 1.0)[1](60.0)
    assert values(AttentionModel(CONFIG), 1.0, tracked, known)[1](60.0) == empty


def test_a_cut_off_cluster_is_looked_at_with_its_hidden_part():
    seen = Cluster(
        np.array([0.8, 0.0]), np.eye(2) * 1e-4, 0.05, 0.4, 50, Footprint(0.1, 0.1, 0.0), whole=False
    )
    known = GazeContext(SURE, clusters=(seen,))
    gain = []
    for pan in (0.0, 15.0):  # the narrow view is 31 deg across: the middle is in both
        with_it = values(AttentionModel(CONFIG), 1.0, (), known)[1](pan)
        gain.append(with_it - values(AttentionModel(CONFIG), 1.0)[1](pan))
    assert gain[0] > 1.4 * gain[1] > 0.0
    far = dataclasses.replace(seen, centre=np.array([2.0, 0.0]))
    assert values(AttentionModel(CONFIG), 1.0, (), GazeContext(SURE, clusters=(far,)))[1](
        0.0
    ) == values(AttentionModel(CONFIG), 1.0)[1](0.0)


def test_a_cluster_beyond_the_neck_does_not_hold_the_gaze():
    behind = Cluster(
        np.array([-0.28, -0.63]),
        np.eye(2) * 1e-4,
        0.12,
        0.4,
        50,
        Footprint(0.2, 0.2, 0.0),
        whole=False,
    )
    model, known, farthest = (
        AttentionModel(CONFIG),
        GazeContext(SURE, clusters=(behind,)),
        at(-90.0),
    )
    gain = []
    for k in range(4):
        empty = values(AttentionModel(CONFIG), 1.0 + k)[1](-90.0)
        gain.append(values(model, 1.0 + k, (), known)[1](-90.0) - empty)
        model.decided(1.0 + k, farthest, VIA, [], SURE)
    assert gain[0] > 0.0  # an end of it is in view, its middle is not
    assert gain[3] < 0.2 * gain[0]


def test_stale_ground_raises_the_map_on_its_side():
    grid, confidence = fresh_grid()
    confidence.decay(4.0)
    confidence.see(grid.centres()[..., 1] < 0.3)  # all but the left
    model = AttentionModel(CONFIG)
    model.decided(0.0, AHEAD, VIA, [], SURE)
    attention, value = values(model, 0.1, (), GazeContext(SURE, grid, confidence))
    assert attention.psi_map > 0.0
    assert value(50.0) > 5.0 * value(-50.0)


def test_an_uncertain_robot_looks_at_a_useful_landmark_and_distrusts_an_occluded_one():
    marks = (Landmark(3, (0.6, 1.4, 0.4), 0.22), Landmark(4, (-1.5, 0.0, 0.4), 0.22))
    uncertain = Gaussian(np.zeros(3), np.diag([0.03, 0.03, 0.02]) ** 2)
    model = AttentionModel(CONFIG)
    model.decided(0.0, AHEAD, VIA, [], uncertain)
    _, value = values(model, 0.1, (), GazeContext(uncertain, landmarks=marks))
    assert value(66.0, 10.0) > 0.2
    # the head looks there, and nocluster is sighted; then it is
    hidden = GazeContext(uncertain, landmarks=marks)
    sighting = Sighting(3, np.array([1.5, 1.1]), np.eye(2) * 1e-4)
    for _ in range(3):
        model.weigh(0.2, VIA, [], hidden, at(66.0, 10.0))
    tags, left = model._tags(hidden)
    assert len(tags) == 2
    trusted = AttentionModel(CONFIG)._tags(hidden)[1]
    assert left[0] < 0.1 * trusted[0]
    model.weigh(
        0.3, VIA, [], GazeContext(uncertain, None, None, marks, (sighting,)), at(66.0, 10.0)
    )
    assert model._tags(hidden)[1][0] == pytest.approx(trusted[0])


def test_the_gain_of_a_landmark_is_the_reduction_by_the_linear_update():
    P = np.diag([0.05, 0.02, 0.03]) ** 2
    offset = np.array([1.5, 0.4])
    bearing = TAG_BEARING_RAD
    share = float(gains(offset[None], P, TAG_RANGE_PER_M, bearing)[0])
    rng = np.random.default_rng(6)
    errors = rng.multivariate_normal(np.zeros(3), P, 60000)  # true minus believed pose
    apart = offset - errors[:, :2]
    away = np.hypot(*offset)
    noise = [TAG_RANGE_PER_M * away**2, TAG_BEARING_RAD]
    seen = np.column_stack(
        [np.hypot(*apart.T), np.arctan2(apart[:, 1], apart[:, 0]) - errors[:, 2]]
    ) + noise * rng.standard_normal((60000, 2))
    basis = np.column_stack([np.ones(60000), seen])
    left = errors[:, :2] - basis @ np.linalg.lstsq(basis, errors[:, :2], rcond=None)[0]
    sigma = math.sqrt(np.linalg.eigvalsh(np.cov(left.T))[-1])
    assert share == pytest.approx(1.0 - sigma / 0.05, abs=0.02)


def test_the_sample_region_is_an_annulus_within_the_range_of_the_neck():
    grid, confidence = fresh_grid()
    pose = Gaussian(np.array([0.1, -0.2, 0.8]), np.eye(3) * 1e-6)
    points, values_there = sample_region(grid, confidence, pose, CONFIG)
    assert np.all(values_there == 1.0)
    away = np.hypot(*(points - pose.mean[:2]).T)
    assert 0.30 <= away.min() < 0.36
    assert 1.24 < away.max() <= 1.30
    area = len(points) * grid.cell_m**2
    assert area == pytest.approx(math.pi / 2 * (1.3**2 - 0.3**2), rel=0.03)


def test_the_best_gaze_is_within_the_range_of_the_neck():
    grid, confidence = fresh_grid()
    confidence.decay(9.0)
    others = [mover(0.3, -0.9, -4.0), mover(-0.5, 0.6, -4.0, 0.05)]
    attention, _ = values(AttentionModel(CONFIG), 3.0, others, GazeContext(SURE, grid, confidence))
    gaze = highest_plateau(attention.total, AHEAD, CONFIG)
    assert abs(gaze.pan_rad) <= math.radians(90.0) + 1e-9
    assert np.isfinite(attention.total).all()
