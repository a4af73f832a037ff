"""Views of simulated rooms by a turning head, with their true poses."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import head_directions, view_of_depth
from perception.depth import time_of_flight
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose3, head_rotation

LEVER = np.array([0.0, -0.035, 0.035])  # of the camera about the neck, camera axes, m


def head_pose(pan_rad, tilt_rad):
    """Camera pose for pan and tilt of the head, half a metre above the floor."""
    rotation = head_rotation(pan_rad, tilt_rad)
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, 0.55]) + rotation @ LEVER)


@pytest.fixture(scope="session")
def look_round():
    """Function of scene, seed and encoder error in deg to nine views and their true poses; needs `sim`."""
    rays = pytest.importorskip("sim.rendering.rays", reason="renders the views")
    from sim.scenes import catalogue
    from sim.sensors.tof_camera import TofCamera, TofConfig

    @functools.cache
    def look(scene_name, seed, error_deg, walk_m=0.0):
        scene = catalogue.load(scene_name, seed)
        caster = rays.RayCaster(scene)
        caster.place([mover.start for mover in scene.moving_objects])
        rng = np.random.default_rng([seed, 99])
        camera = TofCamera(TofConfig(), rng)
        views, true = [], []
        for number, (pan, tilt) in enumerate(head_directions()):
            error = math.radians(error_deg) * rng.standard_normal(2)
            walked = Pose3((walk_m * number, 0.0, 0.0))
            pose = walked @ head_pose(pan + error[0], tilt + error[1])
            prior = walked @ head_pose(pan, tilt)
            range_m, amplitude = camera.measure(caster, scene.start.lifted() @ pose)
            depth = time_of_flight.depth(RangeView(range_m, amplitude, camera.camera, prior))
            views.append(view_of_depth(depth, 5.0, prior=prior, stamp_s=float(number)))
            true.append(pose)
        return views, true

    return look


@pytest.fixture(scope="session")
def placed_round(look_round):
    """Function of scene and seed to nine views, their true poses, and how `place` placed them by default."""

    @functools.cache
    def placed(scene_name, seed):
        views, true = look_round(scene_name, seed, 0.5)
        return views, true, place(views, np.random.default_rng(0), StitchConfig())

    return placed
