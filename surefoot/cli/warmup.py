"""Compile every kernel once, so that no user waits for it: `python -m surefoot.cli.warmup`.

Compiled code is kept beside the modules; later starts load it in milliseconds. The calls are the public
ones, with inputs as small as they may be: a miniature walk through an empty world and a recording's depth.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame, StepOdometry, StereoView
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.planners.search_planner import SearchPlanner

from ..config.schema import Config
from ..progress import Say
from ..recordings.recording import RecordingInfo
from ..run.pipeline import Pipeline


def frame(stamp_s: float, rng: np.random.Generator) -> Frame:
    """A floor with a box on it before a wall, seen by a small robot's head."""
    camera = Camera.from_view(96, 72, 1.0, 0.8)
    head = Pose3.from_rotation(head_rotation(0.0, 0.5), np.array([0.0, 0.0, 0.4]))
    rays = camera.rays @ head.rotation.T
    z = np.where(rays[..., 2] < -0.05, 0.4 / np.maximum(-rays[..., 2], 0.05), np.nan)
    z = np.fmin(z, 1.5 / np.maximum(rays[..., 0], 0.05))
    z[20:40, 40:56] = 0.7
    noise = rng.normal(0.0, 0.002, z.shape)
    texture = rng.integers(0, 255, (72, 96)).astype(np.uint8)
    return Frame(
        stamp_s,
        depth=DepthView((z + noise).astype(np.float32), camera, head),
        stereo=StereoView(texture, np.roll(texture, -8, axis=1), 0.04, camera, head),
        odometry=StepOdometry(Pose2(), 0.0),
        footstep_due=True,
    )


def warm(say: Say) -> None:
    """Run every compiled path once, two at a time.

    Args:
        say: Takes a line for each part, with its time.
    """
    parts = (
        _cycles,
        _panorama,
        _walkers_by_picture,
        _floors_and_steps,
        _levels,
        _seldom,
        _published_ways,
        _robot_log,
        _walking_body,
        _camera_in_the_hand,
    )
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for line in pool.map(_timed, parts):
            say(line)


def _timed(part: Callable[[np.random.Generator], str]) -> str:
    began = time.perf_counter()
    words = part(np.random.default_rng(0))
    return f"{words}: {time.perf_counter() - began:.1f} s"


def _cycles(rng: np.random.Generator) -> str:
    """A robot that stands before a box."""
    config = Config()
    pipeline = Pipeline(config, RecordingInfo("warm-up", "simulation", start=Pose2()))
    navigator = SearchPlanner(config.planning, [(2.0, 0.0)])
    for number in range(20):
        seen = frame(0.325 * number, rng)
        navigator.decide(pipeline.cycle(seen))
    return "cycle and decision"


def _floors_and_steps(rng: np.random.Generator) -> str:
    """Floors by every method, plane regions, tracks, guard and field."""
    from perception.depth import structured_light
    from perception.depth.points import Points
    from perception.floor import choose
    from perception.obstacles.track import Detection
    from perception.obstacles.tracker import ObstacleTracker
    from perception.terrain import segmentation
    from planning.commands import WalkCommand
    from planning.safety import guard
    from planning.univector import motion

    xyz = np.column_stack([rng.uniform(-1, 1, (400, 2)), rng.uniform(1, 2, 400)])
    xyz[:, 1] = 0.4
    cloud = Points(xyz, np.full(400, 0.005), np.arange(400))
    config = Config()
    pipeline = Pipeline(config, RecordingInfo("warm-up", "simulation", start=Pose2()))
    expected = pipeline.pose_source.expected_floor(None)
    for method in ("ransac", "hough"):
        choose.find(cloud, expected, rng, choose.FloorConfig(method=method))
    mover = Obstacle(Gaussian(np.array([0.6, 0.0, -0.05, 0.0]), np.eye(4) * 1e-3), 0.1, moving=1.0)
    robot = Gaussian(np.zeros(3), np.eye(3) * 1e-4)
    seen_depth = frame(0.0, rng).depth
    assert seen_depth is not None
    segmentation.find(structured_light.depth(seen_depth))
    tracker = ObstacleTracker()
    for number in range(4):
        seen_again = Detection(np.array([1.0, 0.0]), np.eye(2) * 1e-4, 0.1)
        tracker.update(0.3 * number, [seen_again], robot)
    guard.choose(
        WalkCommand(0.04),
        robot,
        [mover],
        np.array([[1.0, 0.0]]),
        np.array([2.0, 0.0]),
        config.guard,
        config.robot_model,
    )
    crossing = Obstacle(
        Gaussian(np.array([0.4, 0.4, 0.0, -0.05]), np.eye(4) * 1e-4), 0.1, moving=1.0
    )
    motion.advise(
        robot,
        0.06,
        [mover, crossing],
        np.array([2.0, 0.0]),
        None,
        config.univector,
        config.robot_model,
    )
    return "floors and steps"


def _levels(rng: np.random.Generator) -> str:
    """Footsteps over a step of the ground."""
    from mapping.ground.surface import Border, Surface
    from planning.footholds.foothold import FootNoise
    from planning.footholds.search import Stance, plan

    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    ground = [
        Surface(
            np.array([ahead, 0.0]),
            np.array([height, 0.0, 0.0]),
            1e-6 * np.eye(3),
            square + np.array([ahead, 0.0]),
            np.full(4, int(Border.DROP)),
            np.full(4, 0.002),
        )
        for ahead, height in ((0.0, 0.0), (1.0, 0.03))
    ]
    noise = FootNoise(0.001, 0.001, 0.01)
    plan(
        ground, Stance(-1, Pose2(0.2, 0.0)), np.array([1.2, 0.0]), 0.1, Config().robot_model, noise
    )
    return "levels"


def _seldom(rng: np.random.Generator) -> str:
    """Kernels of single options: all additions of the field, an obstacle too near for the guard, global localisation, PCD."""
    from mapping.grid.egocentric_grid import EgocentricGrid
    from perception.localisation import scan_search
    from perception.localisation.scan import Scan
    from planning.commands import WalkCommand
    from planning.safety import guard
    from planning.univector import motion
    from planning.univector.fields import FieldConfig
    from sim.sensors.geometric_sensor import GeometricSensor

    from ..recordings._lzf_kernels import lzf_decompress

    config, robot, goal = Config(), Gaussian(np.zeros(3), np.eye(3) * 1e-4), np.array([2.0, 0.0])
    coming = Obstacle(
        Gaussian(np.array([0.5, 0.1, -0.2, 0.0]), np.eye(4) * 1e-2), 0.1, moving=1.0, seen_s=0.0
    )
    motion.advise(robot, 0.06, [coming], goal, None, FieldConfig(), config.robot_model)
    cells = np.array([[0.3, -0.2], [0.3, 0.4]])
    guard.choose(WalkCommand(0.04), robot, [coming], cells, goal, config.guard, config.robot_model)
    along = np.linspace(-1.0, 1.0, 50)
    wall = np.column_stack([np.full(50, 2.0), along])
    seen = Scan(wall, np.tile([-1.0, 0.0], (50, 1)), np.full(50, 0.003))
    scan_search.find(seen, [(Pose2(), seen)], Gaussian(np.zeros(3), np.eye(3) * 1e-3))
    sensor, discs = GeometricSensor(rng), np.array([[1.0, 0.0, 0.1], [1.5, 0.3, 0.1]])
    sensor.look(discs, 0.0, 0.5, colour=True)
    sensor.rays(discs, np.array([-3.0, -3.0, 3.0, 3.0]), np.zeros((1, 3)))
    lzf_decompress(np.zeros(2, np.uint8), 1)
    EgocentricGrid(config.grid, np.zeros(2)).update(wall, np.ones(50, np.bool_), 0.0, np.zeros(2))
    return "seldom"


def _published_ways(rng: np.random.Generator) -> str:
    """The methods as printed that runs may choose, and colours of depth."""
    from dataclasses import replace

    from perception.depth.depth_to_colour import colours_of_depth
    from perception.features.mdghm_sift import SiftConfig, detect
    from planning.search import astar
    from planning.search.potential import SearchConfig

    probability, unknown = np.zeros((40, 40), np.float32), np.zeros((40, 40), np.bool_)
    probability[10:20, 20] = 0.9
    ends = np.zeros(2), 0.05, np.array([0.4, 0.7]), np.array([1.6, 0.8])
    for literal in (False, True):
        config = replace(SearchConfig(), literal=literal)
        found = astar.find_path(probability, unknown, *ends, config)
        assert found is not None
        assert len(found.curve) > 1
    picture = rng.integers(0, 255, (72, 96)).astype(np.uint8)
    detect(picture, replace(SiftConfig(), moments_in_descriptor=True))
    camera, rgb = Camera.from_view(96, 72, 1.0, 0.8), rng.integers(0, 255, (72, 96, 3))
    colours_of_depth(np.ones((72, 96), np.float32), camera, rgb.astype(np.uint8), camera, Pose3())
    return "published ways"


def _robot_log(rng: np.random.Generator) -> str:
    """A wheeled robot drives a circle among tags, named and unnamed, and among radio beacons."""
    from perception.planar.association import filter_unknown
    from perception.planar.log_localiser import localise
    from perception.planar.planar import Journey, filter_journey
    from perception.planar.planar_log import PlanarLog

    at_s = 0.1 * np.arange(400)
    totals = np.column_stack([0.1 * at_s, 0.1 * at_s])
    heading = totals[:, 1]
    places = np.array([[2.0, 0.0], [0.0, 3.0], [-2.0, 0.0], [0.0, -2.0]])
    marks = np.arange(len(at_s)) % len(places)
    away = places[marks] - np.column_stack([np.sin(heading), 1.0 - np.cos(heading)])
    distance = np.hypot(*away.T) + rng.normal(0.0, 0.02, len(at_s))
    bearing = np.remainder(np.arctan2(away[:, 1], away[:, 0]) - heading + np.pi, 2 * np.pi) - np.pi
    for angle in (bearing, np.full(len(at_s), np.nan)):
        seen = np.column_stack([distance, angle])
        localise(PlanarLog(at_s, totals, at_s.copy(), marks, seen, places))
    start = Gaussian(np.zeros(3), np.diag([0.02, 0.02, 0.01]) ** 2)
    steps = np.column_stack([np.full(400, 0.1), *np.diff(totals, axis=0, prepend=0.0).T])
    seen = np.column_stack([distance * np.cos(bearing), bearing])
    drive = Journey(start, steps, np.arange(401), marks, seen, places)
    filter_journey(drive)
    filter_unknown(drive)
    return "robot log"


def _walking_body(rng: np.random.Generator) -> str:
    """Three steps of the body with servos and soles, and what its cameras see."""
    from dataclasses import replace

    from sim.robot import SimulatedRobot
    from sim.scenes import catalogue
    from sim.world import World

    config = replace(Config().robot, body="dynamic")
    with World(catalogue.load("empty_room", 0)) as world, SimulatedRobot(world, config) as robot:
        for _ in range(6):
            robot.read()
    return "walking body"


def _walkers_by_picture(rng: np.random.Generator) -> str:
    """Seed 000: the cycle of pictures, the swarm and the exact search."""
    from perception.monocular.cycle import Monocular, MonocularConfig
    from planning.swarm import random_floors, search
    from planning.swarm.objective import Objective, ObjectiveConfig
    from planning.swarm.search import SwarmConfig

    from ..benchmarks import monocular

    previous, current = monocular.scene(rng)
    Monocular(MonocularConfig()).cycle(previous, current)
    floor = random_floors.make(rng)
    objective = Objective.of(
        floor.movable, floor.camera, floor.T_body_camera, Pose2(), floor.goal, ObjectiveConfig()
    )
    search.exact(objective)
    for mode in ("literal", "spread"):
        search.fly(objective, SwarmConfig(mode), rng)
    return "pictures and swarm"


def _camera_in_the_hand(rng: np.random.Generator) -> str:
    """Odometry, surface, traversability."""
    from mapping.io.clouds import FIRST_CAPACITY, CloudBuilder, CloudConfig
    from mapping.surface.traversability import traversability
    from mapping.surface.tsdf import Tsdf
    from mapping.surface.tsdf_config import TsdfConfig
    from perception.depth import structured_light
    from perception.odometry.depth_bend import of_pair
    from perception.odometry.pyramid import build
    from perception.odometry.rgbd_odometry import Odometer

    CloudBuilder(CloudConfig(most_voxels=8)).add(rng.uniform(0.0, 1.0, (50, 3)))
    CloudBuilder().add(rng.uniform(0.0, 2.0, (2 * FIRST_CAPACITY, 3)))
    odometer, surface = Odometer(rng), Tsdf(TsdfConfig(voxel_m=0.005))  # small: storage grows
    for number in range(3):
        view = frame(0.1 * number, rng).depth
        assert view is not None
        depth = structured_light.depth(view)
        rgb = rng.integers(0, 255, (*depth.z.shape, 3)).astype(np.uint8)
        odometer.track_images(depth, rgb)
        surface.integrate(depth, Pose3(), rgb)
    odometer.trajectory()
    of_pair(build(depth, rgb), build(depth, rgb), Pose3(), 1.0, 0)
    traversability(surface.mesh())
    return "odometry and surface"


def _panorama(rng: np.random.Generator) -> str:
    """Seed 004: a panorama of three views and what stands in it."""
    from mapping.panorama.sizes import surroundings
    from mapping.panorama.stitching import stitch
    from mapping.panorama.views import view_of_depth
    from perception.depth import structured_light

    views = []
    for pan in (0.4, 0.0, -0.4):
        view = frame(0.0, rng).depth
        assert view is not None
        head = Pose3.from_rotation(head_rotation(pan, 0.5), np.array([0.0, 0.0, 0.4]))
        views.append(view_of_depth(structured_light.depth(view), 3.0, prior=head))
    surroundings(stitch(views, rng), views)
    return "panorama"


if __name__ == "__main__":
    print("compiling kernels, once", file=sys.stderr)
    warm(lambda line: print(f"  {line}", file=sys.stderr))
