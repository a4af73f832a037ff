"""The limit of stereo: a room without texture, and the behaviour of the pipeline in it.

The same views are rendered twice: textured, and with every surface untextured, shaded by albedo and incidence angle,
so that only edges of objects remain. Disparities in untextured images must be rejected; accepted ones are compared
with the true depth. Then the pipeline processes the untextured pairs: with the time-of-flight camera it detects the
floor, with stereo alone it does not.

Source: seed 003, experiment E7.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from perception.depth import stereo
from perception.primitives.camera import Camera
from perception.primitives.frame import Frame, RangeView, StereoView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.robot import RobotConfig
from sim.scenes import catalogue
from sim.sensors.cameras import stereo_pair
from sim.sensors.tof_camera import TofCamera
from sim.world import World

from ...config.schema import Config
from ...recordings.recording import RecordingInfo
from ...run.pipeline import Pipeline
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.simulated_depth import true_depth
from .stereo_range import WRONG_PX

SCENES = ("boxes", "home")
PLACES = 2  # views in each room
CAMERA_M = 0.38  # height of the robot's camera while it walks
SUPERSAMPLED = 2  # rays across a pixel, against aliasing at edges
AMBIENT = 0.4  # share of ambient light


def untextured_image(
    world: World, camera: Camera, T_world_camera: Pose3
) -> Float[np.ndarray, "h w"]:
    """Grey levels of the untextured scene by ray casting: albedo times ambient and cosine shading."""
    s = SUPERSAMPLED
    fine = Camera(
        camera.width * s,
        camera.height * s,
        camera.fx * s,
        camera.fy * s,
        (camera.cx + 0.5) * s - 0.5,
        (camera.cy + 0.5) * s - 0.5,
    )
    rays = fine.rays / np.linalg.norm(fine.rays, axis=-1, keepdims=True)
    directions = (rays.reshape(-1, 3) @ T_world_camera.rotation.T).astype(np.float32)
    hits = world.rays.cast(T_world_camera.position, directions)
    grey = 255.0 * hits.albedo * (AMBIENT + (1.0 - AMBIENT) * hits.cosine)
    return np.asarray(grey.reshape(camera.height, s, camera.width, s).mean(axis=(1, 3)), np.float64)


def untextured_pair(
    world: World, robot: RobotConfig, T_world_left: Pose3, rng: np.random.Generator
) -> tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """An untextured stereo pair with the noise of the robot's cameras."""
    config = robot.stereo_camera
    right_pose = T_world_left @ Pose3((robot.baseline_m, 0.0, 0.0))
    left, right = (
        untextured_image(world, config.camera, pose)
        + rng.normal(0.0, config.noise_grey, (config.height, config.width))
        for pose in (T_world_left, right_pose)
    )
    return (
        np.clip(np.rint(left), 0, 255).astype(np.uint8),
        np.clip(np.rint(right), 0, 255).astype(np.uint8),
    )


def floors_found(frames: list[Frame], start: Pose2) -> int:
    """Number of frames in which the pipeline detects a floor, each as the first frame of a walk."""
    seen = 0
    for frame in frames:
        pipeline = Pipeline(Config(), RecordingInfo("plain", "simulation", start=start))
        estimate = pipeline.cycle(frame).estimate
        seen += any(view.seen is not None for view in estimate.views)
    return seen


def run(seeds: int, say: Say) -> Outcome:
    """About 25 s per seed."""
    robot = RobotConfig()
    pixels = false = accepted = accepted_textured = 0
    with_tof: list[Frame] = []
    stereo_alone: list[Frame] = []
    for seed in range(seeds):
        for name in SCENES:
            scene = catalogue.load(name, seed)
            rng = np.random.default_rng([seed, 37])
            with World(scene, seed=seed) as world:
                for place in range(PLACES):
                    say(f"{name}, seed {seed}, place {place + 1} of {PLACES}")
                    yaw = scene.start.yaw + rng.uniform(-0.6, 0.6)
                    head = head_rotation(0.0, float(rng.uniform(0.2, 0.5)))
                    on_body = Pose3.from_rotation(head, np.array([0.0, 0.0, CAMERA_M]))
                    pose = replace(scene.start, yaw=yaw).lifted() @ on_body
                    camera = robot.stereo_camera.camera
                    left, right = stereo_pair(
                        world, robot.stereo_camera, robot.baseline_m, pose, rng
                    )
                    textured = stereo.depth(StereoView(left, right, robot.baseline_m, camera))
                    left, right = untextured_pair(world, robot, pose, rng)
                    view = StereoView(left, right, robot.baseline_m, camera, on_body)
                    seen = stereo.depth(view)
                    true = true_depth(world, camera, pose)
                    fB = camera.fx * robot.baseline_m
                    there = np.isfinite(seen.z)
                    with np.errstate(invalid="ignore"):
                        wrong = there & (np.abs(fB / seen.z - fB / true) > WRONG_PX)
                    pixels += there.size
                    false += int(wrong.sum())
                    accepted += int(there.sum())
                    accepted_textured += int(np.isfinite(textured.z).sum())
                    tof = TofCamera(robot.tof_camera, rng)
                    range_m, amplitude = tof.measure(world.rays, pose)
                    alone = Frame(0.0, stereo=view)
                    stereo_alone.append(alone)
                    ranges = RangeView(range_m, amplitude, tof.camera, on_body)
                    with_tof.append(replace(alone, tof=ranges))
    figures = {
        "false_points_pct": 100.0 * false / pixels,
        "wrong_of_accepted_pct": 100.0 * false / max(accepted, 1),
        "accepted_plain_pct": 100.0 * accepted / pixels,
        "accepted_painted_pct": 100.0 * accepted_textured / pixels,
        "floor_with_tof_share": floors_found(with_tof, Pose2()) / len(with_tof),
        "floor_by_stereo_alone_share": floors_found(stereo_alone, Pose2()) / len(stereo_alone),
    }
    return Outcome(figures, [])


EXPERIMENT = Experiment(
    id="003-E7",
    title="A room without texture: stereo rejects its pixels, and time of flight detects the floor",
    run=run,
    targets={
        "false_points_pct": Target("<", 5.0),
        "floor_with_tof_share": Target(">=", 1.0),
    },
    seeds=2,
)
