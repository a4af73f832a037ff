"""Which frames become views of a panorama."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.panorama.view_selection import ViewSelectionConfig
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3


def camera(x: float, yaw_deg: float) -> Pose3:
    return Pose2(x, 0.0, math.radians(yaw_deg)).lifted()


def test_a_view_is_new_when_the_camera_has_turned_or_moved_since_every_other_view():
    selection = ViewSelectionConfig(turn_deg=10.0, step_m=0.2)
    views = [camera(0.0, 0.0), camera(0.0, 15.0)]
    assert selection.is_new(camera(0.0, 0.0), [])
    assert not selection.is_new(camera(0.1, 9.0), views)
    assert not selection.is_new(camera(0.0, 20.0), views)  # near the second
    assert selection.is_new(camera(0.0, 26.0), views)
    assert selection.is_new(camera(0.21, 0.0), views)


def test_a_view_far_from_the_first_is_left_out_unless_pictures_place_the_views():
    far = Pose3.from_rotation(np.eye(3), np.array([0.6, 0.0, 0.6]))
    assert not ViewSelectionConfig(radius_m=0.8).is_near(far, [camera(0.0, 0.0)])
    assert ViewSelectionConfig(radius_m=0.9).is_near(far, [camera(0.0, 0.0)])
    assert ViewSelectionConfig(radius_m=0.8, by_pictures=True).is_near(far, [camera(0.0, 0.0)])


@pytest.mark.parametrize("name", ["turn_deg", "step_m", "radius_m", "most_views"])
def test_an_impossible_setting_is_refused_by_its_name(name):
    with pytest.raises(ConfigError, match=f"{name}=0"):
        ViewSelectionConfig(**{name: 0 if name == "most_views" else 0.0})
