"""The map of the ground during a run, led by poses and step odometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapping.ground.config import GroundConfig
from mapping.ground.measured import Side
from mapping.ground.surface import Border
from perception.depth.points import from_depth
from perception.floor.classify import FLOOR
from perception.floor.segmented_view import SegmentedView
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, Frame, StepOdometry
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation
from surefoot.config.schema import Config
from surefoot.run.ground_watch import GroundWatch

CAMERA = Camera.from_view(160, 120, 1.2, 0.9)
MOUNTED = Pose3.from_rotation(head_rotation(0.0, 0.6), np.array([0.0, 0.0, 1.0]))
STEP = StepOdometry(Pose2(0.1, 0.0, 0.0), 1.0)


def view(mounted):
    """Level ground, 1 m below the camera."""
    down = -(CAMERA.rays @ MOUNTED.rotation.T)[..., 2]
    z = np.where(down > 0.3, 1.0 / down, np.nan).astype(np.float32)
    sigma = np.where(np.isfinite(z), np.float32(0.003), np.float32(np.nan))
    depth = Depth(z, sigma, CAMERA, mounted)
    points = from_depth(depth, 0.1, 5.0)
    ground = np.full(len(points), FLOOR)
    floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(MOUNTED.inverse())
    upright = points.xyz @ MOUNTED.rotation.T + MOUNTED.translation
    return SegmentedView("depth", depth, points, ground, floor, 1.0, MOUNTED, upright)


def followed(mounted, enabled=True):
    config = replace(Config(), ground=GroundConfig(enabled=enabled))
    watch = GroundWatch(config, config.floor)
    for k in range(3):
        frame = Frame(0.5 * k, odometry=STEP if k else None)
        watch.update(frame, [view(mounted)], Pose2(0.1 * k, 0.0, 0.0))
    return watch


def test_the_ground_ahead_is_one_surface_at_the_height_of_the_feet():
    watch = followed(MOUNTED)
    assert watch.images == 3
    assert watch.map is not None
    ahead = np.array([1.2, 0.0])
    (one,) = [s for s in watch.map.surfaces if s.contains(ahead)]
    z, sigma = one.height_at(ahead)
    assert abs(z) < 3.0 * sigma
    assert one.views == 3
    below = [s for s in watch.map.surfaces if s.contains(np.array([0.05, 0.0]))]
    assert len(below) == 1  # the disc below the feet, which the camera does not see


def test_without_a_place_of_the_camera_nothing_is_taken():
    assert followed(None).images == 0


def test_it_is_off_unless_it_is_wanted():
    assert not Config().ground.enabled
    assert followed(MOUNTED, enabled=False).map is None


@pytest.mark.parametrize("hz", [5, 30])
def test_standing_without_step_odometry_costs_the_steps_of_that_time_at_any_frame_rate(hz):
    config = replace(Config(), ground=GroundConfig(enabled=True))
    watch = GroundWatch(config, config.floor)
    watch.update(Frame(3.0), [view(MOUNTED)], Pose2())
    edge = np.array([1.0, 0.0])
    side = Side(Border.DROP, edge, edge, (-0.3, 0.3), np.diag([1e-6, 1e-6]), 0.0, 0.0)
    watch.map._patches[0].sides.append(side)
    for k in range(1, 10 * hz + 1):
        watch.update(Frame(3.0 + k / hz), [], Pose2())
    turned = watch.map._patches[0].sides[-1].covariance[0, 0]
    steps = 10.0 / config.gait.step_s
    expected = math.sqrt(1e-6 + steps * config.localiser.step_yaw_sigma_rad**2)
    assert math.sqrt(turned) == pytest.approx(expected, rel=1e-3)


def test_it_goes_through_a_checkpoint():
    from surefoot.results import object_file

    watch = followed(MOUNTED)
    again = object_file.loads(object_file.dumps(watch))
    for one, two in zip(watch.map.surfaces, again.map.surfaces, strict=True):
        np.testing.assert_array_equal(one.outline, two.outline)
        np.testing.assert_array_equal(one.covariance, two.covariance)
    assert again.body == watch.body
