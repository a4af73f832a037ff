"""Covariances of tracked corners against closed forms and sampled tracks, and chance among things that stand."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.monocular import flow, obstacles
from perception.monocular.back_projection import camera_pose, project
from perception.monocular.contact_covariance import CameraNoise, CovarianceModel, prior_covariance
from perception.monocular.edges import find_edges
from perception.monocular.obstacles import find_obstacles, floor_flows
from perception.monocular.result import Picture
from perception.primitives.camera import Camera

CAMERA = Camera.from_view(240, 240, math.pi / 2, math.pi / 2)
POSE = camera_pose(np.zeros(3) + np.array([0.0, 0.0, 0.5]), 0.0, math.radians(30.0), 0.0)
EXACT = CameraNoise(0.0, 0.0, 0.0, 0.0)


def test_on_a_ramp_of_brightness_the_covariance_is_that_of_its_slope():
    """Slope a along u alone: variance s^2 / (441 a^2 + f) along u, s^2 / f along v; 441 pixels in the window."""
    ramp = np.tile(np.arange(0, 120, 2, dtype=np.uint8), (60, 1))
    found = flow.corner_covariances(ramp, np.array([[30.0, 30.0]]))[0]
    along = flow.BRIGHTNESS_SIGMA**2 / (441 * 4.0 + flow.FLATTEST)
    np.testing.assert_allclose(
        found, np.diag([along, flow.BRIGHTNESS_SIGMA**2 / flow.FLATTEST]), rtol=1e-6
    )


def test_tracks_in_noise_scatter_along_the_outline_as_claimed():
    """A bend in a bright outline, tracked through noise of one grey level: the covariance has the shape of the scatter."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[0:61, 0:61].astype(float)
    clean = 120.0 + 80.0 * np.tanh((v - 30.0 - 0.02 * (u - 30.0) ** 2 - 0.3 * (u - 30.0)) / 3.0)
    start = np.array([[[30.0, 30.0]]], np.float32)
    ends = []
    for _ in range(400):
        first, second = (
            np.rint(clean + rng.normal(0.0, 1.0, clean.shape)).astype(np.uint8) for _ in range(2)
        )
        side = (flow.WINDOW_PX, flow.WINDOW_PX)
        end, _, _ = cv2.calcOpticalFlowPyrLK(first, second, start, None, winSize=side, maxLevel=0)
        ends.append(end[0, 0])
    scatter = np.cov(np.array(ends).T)
    claimed = flow.corner_covariances(np.rint(clean).astype(np.uint8), start[0])[0]
    lower = np.linalg.inv(np.linalg.cholesky(scatter))
    small, large = np.linalg.eigvalsh(lower @ claimed @ lower.T)
    assert np.linalg.cond(scatter) > 10.0
    assert large / small < 1.25  # two deviations of 400 samples; isotropic covariances: above 10


@pytest.mark.parametrize("corners", [1, 2, 4])
def test_things_at_rest_seem_to_move_by_the_chance_however_many_corners_they_have(
    corners, monkeypatch
):
    chance = 0.03  # 1500 draws do not tell a smaller one
    monkeypatch.setattr(obstacles, "CHANCE", chance)
    rng = np.random.default_rng(corners)
    ground = np.full((240, 240), 255, np.uint8)
    ground[:140] = 0
    ground[:, :100] = ground[:, 140:] = 0
    edges = find_edges(ground)
    assert len(edges.groups) == 1
    black = np.zeros((240, 240, 3), np.uint8)
    before, now = (Picture(black, CAMERA, POSE, t) for t in (0.0, 0.2))
    model = CovarianceModel(before, now, 0.65, prior_covariance(now, EXACT), 1.0)
    begin = np.column_stack([np.linspace(104.0, 136.0, corners), np.full(corners, 139.0)])
    P = np.tile([[0.09, 0.02], [0.02, 0.04]], (corners, 1, 1))
    owners = np.zeros(corners, np.int32)
    count = 0
    for _ in range(1500):
        end = begin + rng.multivariate_normal(np.zeros(2), P[0], corners)
        flows = floor_flows(begin, end, P, before, now, owners, 6.0)
        (seen,) = find_obstacles(edges, flows, now, 6.0, 0.0, 5.0, model)
        count += seen.moving
    assert count / 1500 == pytest.approx(chance, abs=3.5 * math.sqrt(chance / 1500))


def test_a_mover_is_seen_to_move_by_its_only_corner():
    black = np.zeros((240, 240, 3), np.uint8)
    before, now = (Picture(black, CAMERA, POSE, t) for t in (0.0, 0.2))
    ground = np.full((240, 240), 255, np.uint8)
    ground[:140] = 0
    edges = find_edges(ground)
    model = CovarianceModel(before, now, 0.65, prior_covariance(now, EXACT), 1.0)
    places = np.array([[0.85, 0.0]])
    ends = project(places + 0.2 * np.array([[0.0, 0.1]]), CAMERA, POSE)
    begins = project(places, CAMERA, POSE)
    owners = np.zeros(1, np.int32)
    sharp = floor_flows(begins, ends, np.eye(2)[None] * 0.04, before, now, owners, 6.0)
    blurred = replace(sharp, covariance=np.eye(2)[None] * 25.0)
    found = [
        find_obstacles(edges, flows, now, 6.0, 0.02, 0.5, model)[0] for flows in (sharp, blurred)
    ]
    assert [one.moving for one in found] == [True, False]
    assert np.hypot(*found[0].velocity_world) == pytest.approx(0.1, abs=1e-6)
