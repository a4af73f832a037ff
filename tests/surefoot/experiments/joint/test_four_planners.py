"""The comparison of planners: kinds of scene alternate, and the shares are counted by planner and kind."""

from __future__ import annotations

import pytest

from surefoot.experiments.joint import four_planners
from surefoot.experiments.joint.four_planners import INTENDED_SCENES, ORDER, SCENES


def test_kinds_of_scene_alternate_and_are_the_same_for_all_planners():
    for planner in ORDER:
        configs = [four_planners.config_of(planner, number) for number in range(8)]
        assert [c.scene for c in configs] == list(SCENES) * 2
        assert [c.seed for c in configs] == [0] * 4 + [1] * 4
        assert {c.mission.planner for c in configs} == {planner}


def test_shares_are_counted_by_planner_and_by_kind():
    configs = [four_planners.config_of(p, number) for number in range(8) for p in ORDER]
    good = {
        "goals_missed": 0, "contacts": 0, "path_m": 3.0, "min_clearance_m": 0.1,
        "duration_s": 50.0, "computing_s": 20.0,
    }  # fmt: skip
    bad = {**good, "contacts": 2}
    found = [
        bad if (c.mission.planner, c.scene, c.seed) == ("field", "boxes", 1) else good
        for c in configs
    ]
    figures, table = four_planners.compare(configs, found)
    assert figures["field_success_share"] == pytest.approx(7 / 8)
    assert figures["field_boxes_success_share"] == pytest.approx(1 / 2)
    assert figures["field_boxes_arrived_share"] == 1.0
    assert figures["field_own_success_share"] == 1.0, "boxes are not among the scenes of the field"
    assert figures["search_walks"] == 8
    assert figures["swarm_own_walks"] == 2 * len(INTENDED_SCENES["swarm"])
    assert len(table) == 1 + len(ORDER) * (2 + len(SCENES))
