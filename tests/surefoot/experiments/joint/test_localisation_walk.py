"""The simplified walk of the localisation experiment against the full simulation; faults; sums over walks."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from perception.localisation import landmarks
from perception.localisation.landmarks import LandmarkConfig
from perception.primitives.frame import Frame, Imu, StepOdometry
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2
from planning.commands import GazeCommand, WalkCommand
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.world import World
from surefoot.config.presets import on_body
from surefoot.config.schema import Config
from surefoot.experiments.joint import localisation
from surefoot.experiments.joint import localisation_trial as trials
from surefoot.experiments.joint.localisation import combine
from surefoot.experiments.joint.localisation_walk import WalkInstant, scaled_noise, walk
from surefoot.experiments.support.experiment import load, measure
from surefoot.experiments.support.tag_sensor import TagNoise, TagSensor


def test_tags_by_geometry_agree_with_tags_in_images() -> None:
    """The same tags are detected, and ranges and bearings agree within the noise of both."""
    scene = catalogue.load("home", 1)
    config = LandmarkConfig()
    tags = TagSensor(scene, TagNoise(), config, np.random.default_rng(0))
    both, one, ranges, bearings = 0, 0, [], []
    with World(scene, "auto", 1) as world:
        robot = SimulatedRobot(world, RobotConfig(stereo=False, tof=False), 1)
        image = robot.config.colour_camera
        for _ in range(16):
            frame = robot.read()
            if frame.colour is None:
                continue
            by_images = landmarks.detect(frame.colour, scene.landmarks, config).sightings
            true = robot.camera_in_world(image.mount_m)
            assert frame.colour.T_body_camera is not None
            by_geometry = tags.look(world.rays, image, true, frame.colour.T_body_camera)
            by_number = {s.identity: s.measured for s in by_geometry}
            both += len({s.identity for s in by_images} & set(by_number))
            one += len({s.identity for s in by_images} ^ set(by_number))
            for s in by_images:
                if s.identity in by_number:
                    ranges.append((s.measured[0] - by_number[s.identity][0]) / s.measured[0])
                    bearings.append(s.measured[1] - by_number[s.identity][1])
            robot.walk(WalkCommand(0.0, 0.0, math.radians(13.0)))
            robot.look(GazeCommand(0.0, math.radians(20.0)))
    assert both >= 6
    assert one <= 0.35 * both  # differences at the image border and far away
    assert abs(float(np.median(ranges))) < 0.005
    assert float(np.median(np.abs(ranges))) < 0.008
    assert float(np.median(np.abs(bearings))) < math.radians(0.1)


def test_a_walk_is_reproducible() -> None:
    first, second = (list(itertools.islice(walk(3, Config()), 4)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.pose == b.pose
        assert np.array_equal(a.views[0].upright, b.views[0].upright)
        assert [s.measured.tolist() for s in a.sightings] == [
            s.measured.tolist() for s in b.sightings
        ]


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_the_dynamic_body_walks_and_a_fall_ends_the_walk(slope: float) -> None:
    config = on_body(Config(), "dynamic")
    dynamic = replace(config.robot.dynamic, slope_rad=(slope, 0.0))
    config = replace(config, robot=replace(config.robot, dynamic=dynamic))
    moments = list(itertools.islice(walk(3, config), 40 if slope else 6))
    assert [moment.fell for moment in moments[:-1]] == [False] * (len(moments) - 1)
    assert moments[-1].fell == (slope > 0.0)


def test_localisation_uses_the_requested_body(monkeypatch: pytest.MonkeyPatch) -> None:
    requested = []

    def fell(seed: int, body: str, length_m: float) -> dict[str, float]:
        requested.append((seed, body))
        return {"falls": float(seed)}

    def noisy(seed: int, body: str, factor: float) -> dict[str, float]:
        requested.append((seed, body))
        return {"anees": factor}

    def run_serially(work: Any, todo: Any, say: Any, what: str) -> list[Any]:
        return list(itertools.starmap(work, todo))

    monkeypatch.setattr(localisation, "one_walk", fell)
    monkeypatch.setattr(localisation, "noisy_walk", noisy)
    monkeypatch.setattr(localisation, "run_all", run_serially)
    monkeypatch.setattr(localisation, "combine", lambda found: {})
    monkeypatch.setattr(localisation, "_table", lambda found: [])
    _, outcome = measure(load("localisation"), lambda text: None, 2, "dynamic")
    assert requested == [(0, "dynamic"), (1, "dynamic"), (0, "dynamic"), (0, "dynamic")]
    assert outcome.figures["falls"] == outcome.figures["anees"] == 1.0
    assert outcome.table[0] == "seed 1 fell"


def instant_at(stamp_s: float, turn_rad: float = 0.1) -> WalkInstant:
    frame = Frame(
        stamp_s,
        odometry=StepOdometry(Pose2(0.02, 0.0, turn_rad), 0.5),
        imu=Imu(np.array([0.0, 0.0, turn_rad / 0.5]), np.array([0.0, 0.0, 9.81])),
    )
    seen = [Sighting(k, np.array([2.0, 0.1]), np.eye(2) * 1e-4) for k in range(4)]
    pose = Pose2(0.02 * stamp_s / 0.5, 0.0, 0.0)
    return WalkInstant(frame, seen, (), [], [], pose, [])


def test_a_jump_of_odometry_happens_once() -> None:
    fault = trials.jump(1.0, 0.5)
    ahead = [fault(instant_at(0.5 * k)).frame.odometry for k in range(6)]
    moved = [odometry.motion.x for odometry in ahead if odometry is not None]
    assert sum(x > 0.4 for x in moved) == 1
    assert moved[2] > 0.4


def test_sightings_are_missing_during_a_blackout_only() -> None:
    fault = trials.blackout(1.0, 1.0)
    assert [len(fault(instant_at(0.5 * k)).sightings) for k in range(6)] == [4, 4, 0, 0, 4, 4]


def test_the_given_share_of_sightings_are_outliers() -> None:
    fault = trials.outliers(0.3, np.random.default_rng(0))
    wrong = [s.measured[0] != 2.0 for k in range(200) for s in fault(instant_at(0.5 * k)).sightings]
    assert float(np.mean(wrong)) == pytest.approx(0.3, abs=0.05)


def test_delayed_odometry_lags_by_the_delay_without_loss() -> None:
    """At constant speed the sum of the motions lags by one delay, and so does the true pose."""
    fault = trials.late(0.05)
    moments = [instant_at(0.5 * k, 0.0) for k in range(1, 9)]
    late = [fault(moment) for moment in moments]
    path = sum(m.frame.odometry.motion.x for m in late if m.frame.odometry is not None)
    assert path == pytest.approx(8 * 0.02 - 0.02 * 0.05 / 0.5, abs=1e-9)
    assert late[-1].pose.x == pytest.approx(moments[-1].pose.x - 0.002, abs=1e-9)


def test_figures_over_walks_are_root_mean_squares_and_means() -> None:
    names = [
        "anees_pose", "anees_no_landmarks", "anees_obstacle", "position_rmse_m",
        "filter_rmse_m", "fixed_lag_rmse_m", "live_lag_rmse_m", "anees_live_lag",
        *(f"{f}_{end}" for f in ("outliers", "blackout", "jump", "clock") for end in ("anees", "end_m")),
    ]  # fmt: skip
    found = [dict.fromkeys(names, 1.0), dict.fromkeys(names, 2.0)]
    del found[1]["clock_anees"]
    figures = combine(found)
    assert_allclose(figures["position_rmse_m"], math.sqrt(2.5))
    assert figures["anees_pose"] == 1.5
    assert figures["clock_anees"] == 1.0
    assert figures["fixed_lag_over_filter"] == figures["live_lag_over_filter"] == 1.0
    assert figures["anees_pose_low"] < 1.0 < figures["anees_pose_high"]
    assert figures["faults_runs"] == 7.0


def test_a_trial_without_cameras_continues_by_odometry() -> None:
    scene = catalogue.load("home", 0)
    rng = np.random.default_rng(0)
    trial = trials.make_trial(scene.start, scene.landmarks, Config(), rng)
    for k in range(1, 6):
        trial.step(replace(instant_at(0.5 * k), sightings=[]), [])
    assert len(trial.nees) == 5
    assert np.all(np.isfinite(trial.nees))
    assert not any(trial.in_view)


def test_another_noise_is_a_factor_of_every_error_of_body_sensors_and_tags() -> None:
    usual, tags = RobotConfig(), TagNoise()
    robot, noisy = scaled_noise(usual, 1.5)
    for made, before in (
        (robot.slip.turn_sigma_deg, usual.slip.turn_sigma_deg),
        (robot.sway.roll_deg, usual.sway.roll_deg),
        (robot.imu.gyro_bias_radps, usual.imu.gyro_bias_radps),
        (robot.head.offset_deg, usual.head.offset_deg),
        (robot.tof_camera.noise_m, usual.tof_camera.noise_m),
        (noisy.corner_px, tags.corner_px),
    ):
        assert made == pytest.approx(1.5 * before)
    assert (robot.sway.standing_share, robot.head.speed_radps) == (
        usual.sway.standing_share,
        usual.head.speed_radps,
    )


def test_the_extremes_over_other_noise_are_those_of_the_means_over_walks() -> None:
    found = [{"half": 0.5, "more": 1.0}, {"half": 0.7, "more": 1.8}]
    figures = localisation.noise_figures(found)
    assert figures["noise_anees_min"] == pytest.approx(0.6)
    assert figures["noise_anees_max"] == pytest.approx(1.4)
