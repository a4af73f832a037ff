"""What is worth a look: each reason raises the map where it should, and a look takes it away again."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.obstacles.clustering import Cluster, Footprint
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.obstacle import Obstacle
from planning.commands import GazeCommand
from planning.gaze.attention import AttentionConfig, AttentionModel, GazeContext, sample_region
from planning.gaze.selection import highest_plateau, worth
from planning.gaze.tag_gain import gains

CONFIG = AttentionConfig()
AHEAD = GazeCommand(0.0, math.radians(28.0))
VIA = np.array([2.0, 0.0])
SURE = Gaussian(np.zeros(3), np.eye(3) * 1e-8)


def at(pan_deg, tilt_deg=30.0):
    return GazeCommand(math.radians(pan_deg), math.radians(tilt_deg))


def mover(x, y, seen_s, vx=0.0, vy=0.0, moving=1.0, since_s=0.0):
    state = Gaussian(np.array([x, y, vx, vy]), np.eye(4) * 1e-6)
    return Obstacle(state, 0.1, 0.4, 7, moving, seen_s, since_s)


def values(attentive, stamp_s, obstacles=(), known=None, via=VIA):
    attention = attentive.weigh(stamp_s, via, obstacles, known or GazeContext(SURE), AHEAD)
    return attention, lambda pan, tilt=30.0: worth(attention.total, at(pan, tilt), CONFIG.map)


def fresh_grid():
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    confidence = ConfidenceLayer(grid)
    confidence.see(np.ones((grid.config.cells,) * 2, np.bool_))
    return grid, confidence


def test_the_way_grows_urgent_until_it_is_looked_at():
    attentive = AttentionModel(CONFIG)
    attentive.decided(0.0, AHEAD, VIA, [], SURE)
    found = [values(attentive, stamp)[1](0.0) for stamp in (0.65, 1.3, 2.6)]
    assert found[0] < found[1] < found[2]
    attentive.decided(2.6, AHEAD, VIA, [], SURE)
    assert values(attentive, 3.25)[1](0.0) == pytest.approx(found[0])
    attentive.decided(3.25, at(90.0), VIA, [], SURE)  # looking aside changes nothing
    assert values(attentive, 3.9)[1](0.0) == pytest.approx(found[1])


def test_the_longer_and_the_nearer_a_mover_is_unseen_the_more_it_is_worth():
    def worth_of(obstacle):
        attentive = AttentionModel(CONFIG)
        attentive.decided(5.0, AHEAD, VIA, [], SURE)
        attention, value = values(attentive, 5.0, [obstacle])
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


def test_a_mover_looked_for_in_vain_is_not_stared_at():
    attentive, lost = AttentionModel(CONFIG), mover(0.5, 0.9, 0.0, since_s=-9.0)
    before = values(attentive, 5.0, [lost])[0].psi_obstacles[7]
    attentive.decided(5.0, at(60.0), VIA, [lost], SURE)
    assert values(attentive, 5.2, [lost])[0].psi_obstacles[7] < 0.2 * before


def test_long_unseen_it_is_looked_for_also_where_it_would_be_if_it_had_turned_back():
    lost = mover(0.5, 0.9, 0.0, 0.0, 0.10)  # by now, or back at (0.5, -0.1)
    _, value = values(AttentionModel(CONFIG), 5.0, [lost])
    nothing = values(AttentionModel(CONFIG), 5.0, [])[1]
    assert value(60.0) > nothing(60.0)
    assert value(-30.0, 40.0) > nothing(-30.0, 40.0)


def test_what_stands_for_sure_is_worth_nothing_and_what_is_new_is():
    stands = mover(0.5, 0.9, 0.0, moving=0.01, since_s=-20.0)
    new = mover(0.5, 0.9, 0.0, moving=0.01, since_s=-0.5)
    _, value = values(AttentionModel(CONFIG), 5.0, [stands])
    _, empty = values(AttentionModel(CONFIG), 5.0, [])
    assert value(60.0) == empty(60.0)
    assert values(AttentionModel(CONFIG), 5.0, [new])[1](60.0) > empty(60.0)


def test_a_thing_without_a_track_is_looked_at_again_and_less_after_looks_in_vain():
    thing = Cluster(np.array([0.5, 0.9]), np.eye(2) * 1e-4, 0.1, 0.4, 50, Footprint(0.2, 0.2, 0.0))
    attentive, known = AttentionModel(CONFIG), GazeContext(SURE, clusters=(thing,))
    found = []
    for k, gaze in enumerate((at(-60.0), at(60.0), at(60.0), at(60.0))):
        empty = values(AttentionModel(CONFIG), 1.0 + k)[1](60.0)
        found.append(values(attentive, 1.0 + k, (), known)[1](60.0) - empty)
        attentive.decided(1.0 + k, gaze, VIA, [], SURE)
    assert found[1] == pytest.approx(found[0])  # a look elsewhere does not count
    assert found[1] > found[2] > found[3] > 0.0
    later = 4.0 + CONFIG.met_s
    again = values(attentive, later, (), known)[1](60.0)
    assert again - values(AttentionModel(CONFIG), later)[1](60.0) == pytest.approx(found[0])
    tracked = [mover(0.5, 0.9, 1.0, moving=0.01, since_s=-20.0)]
    empty = values(AttentionModel(CONFIG), 1.0)[1](60.0)
    assert values(AttentionModel(CONFIG), 1.0, tracked, known)[1](60.0) == empty


def test_what_the_edge_of_the_view_cuts_off_is_looked_at_with_what_may_be_hidden():
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


def test_what_the_neck_cannot_turn_to_is_not_stared_at():
    behind = Cluster(
        np.array([-0.28, -0.63]),
        np.eye(2) * 1e-4,
        0.12,
        0.4,
        50,
        Footprint(0.2, 0.2, 0.0),
        whole=False,
    )
    attentive, known, farthest = (
        AttentionModel(CONFIG),
        GazeContext(SURE, clusters=(behind,)),
        at(-90.0),
    )
    gain = []
    for k in range(4):
        empty = values(AttentionModel(CONFIG), 1.0 + k)[1](-90.0)
        gain.append(values(attentive, 1.0 + k, (), known)[1](-90.0) - empty)
        attentive.decided(1.0 + k, farthest, VIA, [], SURE)
    assert gain[0] > 0.0  # an end of it is in view, its middle is not
    assert gain[3] < 0.2 * gain[0]


def test_stale_ground_draws_the_head_to_its_side():
    grid, confidence = fresh_grid()
    confidence.decay(4.0)
    confidence.see(grid.centres()[..., 1] < 0.3)  # all but the left
    attentive = AttentionModel(CONFIG)
    attentive.decided(0.0, AHEAD, VIA, [], SURE)
    attention, value = values(attentive, 0.1, (), GazeContext(SURE, grid, confidence))
    assert attention.psi_map > 0.0
    assert value(50.0) > 5.0 * value(-50.0)


def test_a_vague_robot_looks_at_the_landmark_that_helps_and_forgets_one_that_is_hidden():
    marks = (Landmark(3, (0.6, 1.4, 0.4), 0.22), Landmark(4, (-1.5, 0.0, 0.4), 0.22))
    vague = Gaussian(np.zeros(3), np.diag([0.03, 0.03, 0.02]) ** 2)
    attentive = AttentionModel(CONFIG)
    attentive.decided(0.0, AHEAD, VIA, [], vague)
    _, value = values(attentive, 0.1, (), GazeContext(vague, landmarks=marks))
    assert value(66.0, 10.0) > 0.2
    # the head looks there, and nothing is sighted; then it is
    hidden = GazeContext(vague, landmarks=marks)
    sighting = Sighting(3, np.array([1.5, 1.1]), np.eye(2) * 1e-4)
    for _ in range(3):
        attentive.weigh(0.2, VIA, [], hidden, at(66.0, 10.0))
    tags, left = attentive._tags(hidden)
    assert len(tags) == 2
    trusted = AttentionModel(CONFIG)._tags(hidden)[1]
    assert left[0] < 0.1 * trusted[0]
    attentive.weigh(
        0.3, VIA, [], GazeContext(vague, None, None, marks, (sighting,)), at(66.0, 10.0)
    )
    assert attentive._tags(hidden)[1][0] == pytest.approx(trusted[0])


def test_the_gain_of_a_landmark_is_what_the_update_takes_away():
    P = np.diag([0.05, 0.02, 0.03]) ** 2
    offset = np.array([1.5, 0.4])
    bearing = math.radians(CONFIG.tag_bearing_deg)
    share = float(gains(offset[None], P, CONFIG.tag_range_per_m, bearing)[0])
    rng = np.random.default_rng(6)
    errors = rng.multivariate_normal(np.zeros(3), P, 60000)  # true minus believed pose
    apart = offset - errors[:, :2]
    away = np.hypot(*offset)
    noise = [CONFIG.tag_range_per_m * away**2, math.radians(CONFIG.tag_bearing_deg)]
    seen = np.column_stack(
        [np.hypot(*apart.T), np.arctan2(apart[:, 1], apart[:, 0]) - errors[:, 2]]
    ) + noise * rng.standard_normal((60000, 2))
    basis = np.column_stack([np.ones(60000), seen])
    left = errors[:, :2] - basis @ np.linalg.lstsq(basis, errors[:, :2], rcond=None)[0]
    sigma = math.sqrt(np.linalg.eigvalsh(np.cov(left.T))[-1])
    assert share == pytest.approx(1.0 - sigma / 0.05, abs=0.02)


def test_the_sample_region_is_the_annulus_that_the_neck_can_turn_to():
    grid, confidence = fresh_grid()
    pose = Gaussian(np.array([0.1, -0.2, 0.8]), np.eye(3) * 1e-6)
    points, values_there = sample_region(grid, confidence, pose, CONFIG.map)
    assert np.all(values_there == 1.0)
    away = np.hypot(*(points - pose.mean[:2]).T)
    assert 0.30 <= away.min() < 0.36
    assert 1.24 < away.max() <= 1.30
    area = len(points) * grid.cell_m**2
    assert area == pytest.approx(math.pi / 2 * (1.3**2 - 0.3**2), rel=0.03)


def test_the_best_look_of_all_is_within_the_reach_of_the_neck():
    grid, confidence = fresh_grid()
    confidence.decay(9.0)
    others = [mover(0.3, -0.9, -4.0), mover(-0.5, 0.6, -4.0, 0.05)]
    attention, _ = values(AttentionModel(CONFIG), 3.0, others, GazeContext(SURE, grid, confidence))
    gaze = highest_plateau(attention.total, AHEAD, CONFIG.map)
    assert abs(gaze.pan_rad) <= math.radians(90.0) + 1e-9
    assert np.isfinite(attention.total).all()


def test_impossible_distances_are_refused():
    with pytest.raises(ConfigError, match="near_m"):
        AttentionConfig(near_m=3.0)
    with pytest.raises(ConfigError, match="seek_s"):
        AttentionConfig(seek_s=0.0)
