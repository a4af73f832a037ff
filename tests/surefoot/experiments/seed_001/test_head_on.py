"""Meetings along the path, the printed field to the letter, and the published walker on a course."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planning.univector.fields import PUBLISHED
from surefoot.experiments.seed_001 import field_portrait, head_on
from surefoot.experiments.support.course_runner import course_config, published, walk


def test_the_virtual_obstacle_pays_in_drawn_meetings_along_the_path():
    found, table = head_on.figures(range(300, 304))
    assert found["meeting_contacts_virtual"] == 0.0 < found["meeting_contacts_without"]
    assert found["meeting_turning_saved_deg"] > 20.0
    assert found["meeting_gap_gained_m"] > 0.05
    assert found["meeting_earlier_m"] > 0.2
    assert len(table) == 1 + len(head_on.WALKERS)


def test_the_specified_meeting_is_head_on_and_would_collide():
    one = head_on.SPECIFIED
    assert (one.speed_mps, one.angle_rad) == (0.06, 0.0)
    aside = replace(one, offset_m=3.0)
    field, _ = head_on.WALKERS["virtual"]
    alone = head_on.passing(aside, field, guarded=False)
    assert math.isnan(alone.onset_m)  # nothing to turn for
    assert alone.turning_rad == pytest.approx(0.0)


def test_eq_8_to_the_letter_leads_no_streamline_to_the_goal(monkeypatch):
    monkeypatch.setattr(field_portrait, "LONGEST_M", 12.0)
    world = field_portrait.draw(0)
    lines = field_portrait.streamlines(world, PUBLISHED, True, literal=True)
    assert field_portrait.statistics(world, lines).arrived == 0.0
    ours = field_portrait.streamlines(world, PUBLISHED, True)
    assert field_portrait.statistics(world, ours).arrived > 0.9


def test_seed_001_walks_a_course_without_guard_to_its_first_via_point():
    config = published(course_config("course", 300))
    result = walk(replace(config, mission=replace(config.mission, time_limit_s=60.0)))
    (_, x0, y0, _), *_, (_, x1, y1, _) = result.trace
    assert result.guarded == 0
    assert np.hypot(x1 - x0, y1 - y0) > 0.5
