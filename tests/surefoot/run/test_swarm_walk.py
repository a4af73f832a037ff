"""The walker by colour, from pixels to the run folder: what it sees is tracked, logged and drawn."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace

import numpy as np
import pytest

from planning.planners.swarm_planner import SwarmPlanner
from sim.robot import SimulatedRobot
from sim.scenes import catalogue
from sim.world import World
from surefoot.config.load import load
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate
from surefoot.run.pipeline import Pipeline


@pytest.fixture(scope="module")
def walked(tmp_path_factory, pages):
    config = load(
        None, ["mission.planner=swarm", "mission.time_limit_s=12"], scene="robots_room", seed=1
    )
    out = tmp_path_factory.mktemp("swarm") / "run"
    with pages():
        simulate.simulate(config, out, True, lambda text: None)
    return RunFolder.open(out)


def test_every_table_and_map_is_the_same_offline(walked, assert_same_offline):
    assert_same_offline(walked.root)


def test_a_track_that_was_seen_lies_where_the_robot_of_that_moment_is(walked):
    tracks = [
        one
        for one in walked.read_json("obstacles.json")["tracks"]
        if one["seen"] == one["stamp"] and one["moving"] > 0.9
    ]
    assert len(tracks) > 10
    truth = walked.read_csv("truth/obstacles.csv").matrix("stamp_s", "x_m", "y_m")
    off = []
    for one in tracks:
        now = truth[np.abs(truth[:, 0] - one["stamp"]) < 1e-6]
        apart = now[:, 1:] - one["mean"][:2]
        P = np.array(one["covariance"])[:2, :2]
        off.append(np.einsum("ni,ij,nj->n", apart, np.linalg.inv(P), apart).min())
        assert np.hypot(*apart.T).min() < 0.25
    assert np.mean(np.array(off) < 9.21) > 0.9  # chi-square, 99 % of the honest ones


def test_every_sighting_of_a_track_is_logged_with_its_innovation(walked):
    rows = walked.read_csv("innovations.csv")
    sources = np.array(rows.words("source"))
    whitened = rows.matrix("whitened_0", "whitened_1")[sources == "track"]
    assert len(whitened) > 20
    assert np.median(np.sum(whitened**2, axis=1)) < 5.99  # chi-square, 95 % of the honest ones


def test_the_stages_are_in_the_report(walked):
    names = [view["name"] for view in json.loads((walked.root / "views.json").read_text())]
    assert any(name.startswith("stages") for name in names)
    assert "stages, then" in (walked.root / "report.html").read_text()


@contextlib.contextmanager
def walker(version="ours", goals=None):
    """Planner, pipeline and robot in the seed's room."""
    settings = ["mission.planner=swarm", f"swarm.version={version}"]
    config = load(None, settings, scene="robots_room")
    scene = catalogue.load("robots_room", 0)
    told = RecordingInfo("x", "simulation", start=scene.start, start_covariance=1e-4 * np.eye(3))
    with World(scene, "tiny", 0) as world, SimulatedRobot(world, config.robot, 0) as robot:
        yield SwarmPlanner(config.planning, goals or scene.goals), Pipeline(config, told), robot


def test_a_picture_that_is_not_its_cameras_is_not_walked_by(caplog):
    with walker() as (planner, pipeline, robot):
        frame = robot.read()
        assert frame.colour is not None
        halved = np.ascontiguousarray(frame.colour.rgb[::2, ::2])
        frame = replace(frame, colour=replace(frame.colour, rgb=halved))
        world = pipeline.cycle(frame)
        planner.observe(world)
        decision = planner.decide(world)
    assert decision.why == "blocked"
    assert decision.walk.forward_m == decision.walk.turn_rad == 0.0
    assert "picture not used" in caplog.text


def test_in_the_dark_it_does_not_leave_its_place():
    blocked = 0
    with walker() as (planner, pipeline, robot):
        for _ in range(14):
            frame = robot.read()
            assert frame.colour is not None
            black = replace(frame.colour, rgb=np.zeros_like(frame.colour.rgb))
            frame = replace(frame, colour=black)
            world = pipeline.cycle(frame)
            planner.observe(world)
            if frame.footstep_due:
                decision = planner.decide(world)
                blocked += decision.why in ("blocked", "guard")
                assert decision.walk.forward_m == decision.walk.lateral_m == 0.0
                robot.walk(decision.walk)
                robot.look(decision.gaze)
    assert blocked > 3


@pytest.mark.parametrize("dark", [False, True])
def test_the_published_walker_walks_by_pixels_alone_in_steps_of_four_centimetres(dark):
    """Its goal is 0.2 m ahead, below the picture: without a free pixel it turns, with one it takes the whole step."""
    whys = []
    with walker("published", [(0.0, -0.1)]) as (planner, pipeline, robot):
        for _ in range(8):
            frame = robot.read()
            assert frame.colour is not None
            if dark:
                black = replace(frame.colour, rgb=np.zeros_like(frame.colour.rgb))
                frame = replace(frame, colour=black)
            world = pipeline.cycle(frame)
            planner.observe(world)
            if frame.footstep_due:
                decision = planner.decide(world)
                whys.append(decision.why)
                if decision.why == "walk":
                    assert decision.walk.forward_m == pytest.approx(0.04)
                    pixel = decision.image_target.pixel
                    assert decision.image_target.movable[pixel[1], pixel[0]] > 0
                robot.look(decision.gaze)
    assert whys[-1] == ("blocked" if dark else "walk")
    assert set(whys) <= ({"survey", "blocked"} if dark else {"survey", "walk"})
