"""Scans of steep plane regions: risers and walls of known place, and a walk that they correct."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from perception.depth.distortion import Distortion, DistortionConfig
from perception.floor.choose import FloorConfig
from perception.localisation.filter import PoseFilter
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.localiser_noise import LocaliserConfig
from perception.localisation.plane_scan import plane_scan
from perception.localisation.pose_source import PriorConfig
from perception.localisation.registration import RegistrationConfig
from perception.localisation.scan import SHARED_SIGMA_M
from perception.primitives.frame import Frame, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from perception.terrain import segmentation

sys.path.insert(0, str(Path(__file__).parents[1] / "terrain"))

import stair_scenes as scenes

RISER_M, TREAD_M, STEPS, AWAY_M = 0.16, 0.29, 4, 0.8
NOISE_M = 0.003
SCENE = [*scenes.stairs(RISER_M, TREAD_M, STEPS, AWAY_M), ((2.6, 0.0), (2.6, 3.0), 3.0)]
EXACT = FloorConfig(distortion=DistortionConfig(depth=Distortion()))
FACES_M = np.array([*(AWAY_M + TREAD_M * np.arange(STEPS)), 2.6])  # x of risers and of a wall


def image(body: Pose2, seed: int, yaw: float = 0.0, tilt: float = 0.5):
    """Regions of an image, and the pose of the camera in the frame of the body."""
    mounted = scenes.pose(1.0, tilt, yaw)
    depth = scenes.look(SCENE, body.lifted() @ mounted, NOISE_M, seed)
    return segmentation.find(depth, config=EXACT), mounted


def test_points_lie_on_risers_and_wall_with_the_error_that_is_claimed():
    squares = []
    for seed in range(20):
        body = Pose2(0.02 * seed - 0.2, 0.0, 0.01 * seed - 0.1)
        regions, mounted = image(body, seed)
        scan = plane_scan(regions, mounted)
        places, normals = body.apply(scan.points), scan.normals @ body.rotation.T
        across = normals[:, 0] < -math.cos(math.radians(10.0))
        assert across.sum() > 20
        assert (normals[:, 0] < 0.0).all()  # towards the robot
        error = places[across, 0][:, None] - FACES_M
        nearest = np.abs(error).argmin(axis=1)
        for face in np.unique(nearest):
            on = nearest == face
            mean = error[on, face].mean()
            variance = (scan.sigmas[across][on] ** 2).mean() / on.sum()
            squares.append(mean**2 / variance)
            assert SHARED_SIGMA_M < math.sqrt(variance) < 0.01
    assert np.mean(squares) < 1.0


def test_what_is_level_is_no_part_of_a_scan():
    depth = scenes.look([((-2.0, 0.0), (4.0, 0.0), 3.0)], scenes.pose(1.0, 0.5), NOISE_M)
    regions = segmentation.find(depth, sensor="depth")
    assert len(regions) >= 1
    assert len(plane_scan(regions, scenes.pose(1.0, 0.5))) == 0


@pytest.mark.parametrize("enabled", [True, False])
def test_steps_that_slip_are_corrected_by_the_risers_ahead(enabled):
    errors, nees = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        start = Gaussian(np.zeros(3), np.diag([1e-3, 1e-3, 1e-3]) ** 2)
        config = LocaliserConfig(
            step_x_sigma_m=0.02, step_yaw_sigma_rad=math.radians(3.0), slip_m=0.0
        )
        localiser = LeggedLocaliser(
            PoseFilter(start, (), config), PriorConfig(), RegistrationConfig(enabled=enabled)
        )
        true = Pose2()
        for number in range(8):
            if number:
                told = Pose2(0.05, 0.0, 0.0)
                slip = Pose2(rng.normal(0.0, 0.02), 0.0, rng.normal(0.0, math.radians(3.0)))
                true = true @ told @ slip
                localiser.update(Frame(0.7 * number, odometry=StepOdometry(told, 1.0)), ())
            else:
                localiser.update(Frame(0.0, odometry=StepOdometry(Pose2(), 0.0)), ())
            regions, mounted = image(true, 100 * seed + number)
            localiser.register_scan(plane_scan(regions, mounted), mounted)
        error = localiser.pose.mean - true.vector
        errors.append(np.abs(error[[0, 2]]))
        nees.append(error @ np.linalg.solve(localiser.pose.covariance, error))
    forward_m, turn_rad = np.mean(errors, axis=0)
    if enabled:
        assert forward_m < 0.015
        assert turn_rad < math.radians(0.7)
        assert np.mean(nees) < 6.0
    else:
        assert forward_m > 0.025
        assert turn_rad > math.radians(2.0)
