"""Stairs against truth: which errors count, and what is a mistake."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.terrain.staircase import Staircase
from surefoot.experiments.joint.stairs_perception import Answer, compared, summary
from surefoot.experiments.support import stair_views
from surefoot.experiments.support.stair_views import Stairs

UP, AHEAD = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
TRUE = Stairs(0.18, 0.28, 5, AHEAD, np.array([0.1, 0.9, 1.0]))


def seen(riser=0.18, tread=0.28, turn=0.0, edge=TRUE.first_edge):
    direction = math.cos(turn) * AHEAD + math.sin(turn) * np.cross(UP, AHEAD)
    P = np.diag([0.002, 0.003, 0.01, 0.01, 0.01]) ** 2
    return Staircase(riser, tread, 4, direction, UP, edge, True, P, (0, 1, 2))


def answer(sensor, kind, found=False, ramps=0):
    values = (0.001, 0.002, 0.01, 0.0, 0.0) if found else (math.nan,) * 5
    return Answer(sensor, kind, 1.0, found, ramps, values, (1.0,) * 4)


def test_errors_are_true_minus_measured_and_nees_is_in_units_of_the_claims():
    errors, nees = compared(seen(0.178, 0.283, 0.01), TRUE)
    np.testing.assert_allclose(errors[:3], [0.002, -0.003, -0.01], atol=1e-9)
    np.testing.assert_allclose(nees[:3], [1.0, 1.0, 1.0], rtol=1e-6)


def test_the_first_edge_seen_may_be_a_later_nosing():
    later = TRUE.first_edge + 2 * (TRUE.tread_m * AHEAD + TRUE.riser_m * UP)
    errors, _ = compared(seen(edge=later), TRUE)
    np.testing.assert_allclose(errors[3:], 0.0, atol=1e-9)
    errors, _ = compared(seen(edge=TRUE.first_edge + TRUE.riser_m * UP), TRUE)
    assert errors[4] == pytest.approx(-TRUE.riser_m)  # right place, wrong height


def test_mistakes_are_counted_both_ways():
    answers = [
        answer("tof", "up", found=True, ramps=1),
        answer("tof", "ramp up", found=True),
        answer("tof", "kerb", found=True),
        answer("stereo", "down", found=True),
    ]
    figures, table = summary(answers)
    assert figures["stairs_called_ramp"] == 1.0
    assert figures["ramps_called_stairs"] == 1.0
    assert figures["flat_called_stairs"] == 1.0
    assert figures["ramp_mistaken"] == 2.0
    assert figures["tof_up_found_share"] == 1.0
    assert any(line.startswith("found, by distance") for line in table)


@pytest.mark.parametrize("kind", stair_views.KINDS)
def test_a_scene_and_its_truth_belong_together(kind):
    view = stair_views.draw(7, kind)
    ground = view.ground.moved(view.T_world_camera)  # back into the world
    np.testing.assert_allclose(ground.normal, [0.0, 0.0, 1.0], atol=1e-9)
    tops = {round(part.top_m, 6) for item in view.scene.obstacles for part in item.parts}
    if view.stairs is None:
        assert (view.slope_rad > 0.0) == kind.startswith("ramp")
        return
    edge = view.T_world_camera.apply(view.stairs.first_edge)
    assert edge[0] == pytest.approx(view.away_m)
    assert round(float(edge[2]), 6) in tops
    rises = view.T_world_camera.rotation @ view.stairs.direction
    assert rises[0] == pytest.approx(1.0 if kind == "up" else -1.0)
