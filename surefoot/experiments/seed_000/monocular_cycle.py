"""The eight images of one monocular cycle, with its floor and its predictions evaluated against the truth.

The robot walks into the room of Han 2018 with its head tilted 30 deg down, among three robots that move to and fro;
the seed determines its turns. Camera poses are those of the simulator, as in the paper ("GPS"), and for comparison
those of the head's joints. The prediction error is the mean offset, column by column, between the predicted and the
true floor edge of a moving robot 0.65 s later. The NEES normalises this offset by its predicted covariance (mean over
the edge): 2 is consistent for two coordinates, more is overconfident, and 95 % should lie below 5.99. Poses of the
simulator have zero covariance; poses by joints have that of a walking trunk.

Source: Han 2018 (seed 000), section 6.3, Fig. 8.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from perception.monocular.back_projection import floor_points
from perception.monocular.contact_covariance import CameraNoise
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.result import MonocularResult, Picture, SeenObstacle
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3
from planning.commands import GazeCommand, WalkCommand
from sim.rendering.rays import RayCaster
from sim.robot import RobotConfig, SimulatedRobot
from sim.scenes import catalogue
from sim.truth import Truth
from sim.world import World

from ...report.plots.monocular import panes, stages
from ..support.experiment import Experiment, Outcome, Say, Target

FOLDER = Path("runs/experiments/000-E1")
CYCLES = 8  # per walk
BEYOND_M = 2.0  # farther away a pixel covers 3 cm, and the robot has 30 more steps to observe
TILT_DEG = 30.0  # seed 000
ON_FLOOR_M = 1e-3
INSIDE = 5.991  # 95 % quantile of chi-square with two degrees of freedom
EXACT = CameraNoise(pitch_deg=0.0, yaw_deg=0.0, roll_deg=0.0, height_m=0.0)

Walk = list[tuple[Picture, Picture, Picture, Picture, "GroundTruth"]]


class GroundTruth:
    """Truth at the time of the current image: moving robots, and the pixels that show the floor."""

    def __init__(self, robot: SimulatedRobot, image: Picture) -> None:
        world = robot.world
        self.moving_robots = world.moving_states()
        self.radii = [mover.radius_m for mover in world.scene.moving_objects]
        self.floor = true_floor(world.rays, image)

    def displacements(self, horizon_s: float) -> list[tuple[np.ndarray, float, np.ndarray]]:
        """Position, radius and displacement within the horizon of every moving robot, at constant velocity."""
        return [
            (np.array([x, y]), radius, np.array([vx, vy]) * horizon_s)
            for (x, y, vx, vy), radius in zip(self.moving_robots, self.radii, strict=True)
        ]


def true_floor(rays: RayCaster, image: Picture) -> np.ndarray:
    """Pixels whose ray meets the floor first, by ray casting."""
    pose = image.T_world_camera
    directions = image.camera.rays.reshape(-1, 3) @ pose.rotation.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = rays.cast(pose.position, directions.astype(np.float32))
    with np.errstate(invalid="ignore"):
        z = pose.position[2] + hits.distance_m * directions[:, 2]
    return np.asarray(z < ON_FLOOR_M).reshape(image.rgb.shape[:2])


def image_pairs(seed: int, cycles: int, scene: str = "robots_room") -> Walk:
    """Image pairs of one walk with given poses, the same with poses by joints, and the truth of each."""
    rng = np.random.default_rng([seed, 60])
    found: Walk = []
    with World(catalogue.load(scene, seed), seed=seed) as world:
        config = RobotConfig(tof=False, stereo=False, image_pairs=True)
        robot = SimulatedRobot(world, config, seed)
        truth = Truth(robot)
        robot.look(GazeCommand(0.0, math.radians(TILT_DEG)))
        robot.read(), robot.read()
        before = _pictures(robot.read(), truth)
        turn = 0.0
        while len(found) < cycles:
            frame = robot.read()
            now = _pictures(frame, truth)
            if frame.footstep_due:
                found.append((before[0], now[0], before[1], now[1], GroundTruth(robot, now[0])))
                if len(found) % 3 == 1:
                    turn = float(rng.uniform(-10.0, 10.0))
                robot.walk(WalkCommand(0.04, 0.0, math.radians(turn), 0.30, 0.35))
            before = now
    return found


def _pictures(frame: Frame, truth: Truth) -> tuple[Picture, Picture]:
    """The image with the simulator's camera pose, and with the joints' camera pose on the true body pose."""
    assert frame.colour is not None
    view = frame.colour
    assert view.T_body_camera is not None
    by_joints: Pose3 = truth.robot_pose().lifted() @ view.T_body_camera
    given, joints = (
        Picture(view.rgb, view.camera, pose, frame.stamp_s)
        for pose in (truth.camera_pose("colour"), by_joints)
    )
    return given, joints


def prediction_errors(result: MonocularResult, truth: GroundTruth) -> list[tuple[float, float]]:
    """Error, m, and NEES of the predicted edge of every moving robot that is near and seen whole."""
    errors = []
    eye = result.current.T_world_camera.position[:2]
    for centre, radius, moved in truth.displacements(result.horizon_s):
        if np.hypot(*(centre - eye)) > BEYOND_M:
            continue
        seen = _obstacle_of(result.obstacles, centre, radius)
        if seen is not None:
            true_edge = _edge(seen, result.current, centre, radius) + moved
            off = np.nanmean(seen.predicted_world - true_edge, axis=0)
            if np.isfinite(off).all():
                covariance = np.nanmean(seen.predicted_covariance, axis=0)
                errors.append(
                    (float(np.hypot(*off)), float(off @ np.linalg.solve(covariance, off)))
                )
    return errors


def _obstacle_of(
    obstacles: tuple[SeenObstacle, ...], centre: np.ndarray, radius: float
) -> SeenObstacle | None:
    """The obstacle with the most edge pixels at the moving robot's foot, if it shows that robot alone."""
    best, most = None, 4
    for obstacle in obstacles:
        near = np.hypot(*(obstacle.contact_world - centre).T) < radius + 0.05
        if np.count_nonzero(near) > most and np.mean(near) > 0.5:
            best, most = obstacle, int(np.count_nonzero(near))
    return best


def _edge(obstacle: SeenObstacle, image: Picture, centre: np.ndarray, radius: float) -> np.ndarray:
    """Where the image column of each edge pixel meets the moving robot's circle; NaN where it misses it."""
    pixels = obstacle.edge.astype(np.float64)
    a = floor_points(pixels + np.array([0.0, 30.0]), image.camera, image.T_world_camera)
    b = floor_points(pixels, image.camera, image.T_world_camera)
    along = (b - a) / np.hypot(*(b - a).T)[:, None]
    ahead = np.einsum("ij,ij->i", centre - a, along)
    lateral = np.hypot(*(a + ahead[:, None] * along - centre).T)
    with np.errstate(invalid="ignore"):
        reach = ahead - np.sqrt(radius**2 - lateral**2)
    return np.asarray(a + reach[:, None] * along)


def panes_with_content(result: MonocularResult) -> int:
    """Number of panes with any content; a uniform pane does not count."""
    return sum(int(np.ptp(image)) > 0 for _, image in panes(result))


def run(seeds: int, say: Say) -> Outcome:
    """One walk of eight cycles per seed, about six seconds each."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    ious: list[float] = []
    errors: dict[str, list[tuple[float, float]]] = {"given": [], "joints": []}
    pane_counts: list[int] = []
    table = ["seed  floor IoU  predictions  median error, m"]
    for seed in range(seeds):
        cycle = Monocular(MonocularConfig(camera_noise=EXACT))
        by_joints = Monocular(MonocularConfig())
        seed_errors: list[tuple[float, float]] = []
        saved = False
        for number, (before, now, joints_before, joints_now, truth) in enumerate(
            image_pairs(seed, CYCLES)
        ):
            result = cycle.cycle(before, now)
            ground = result.ground > 0
            ious.append(float((ground & truth.floor).sum() / (ground | truth.floor).sum()))
            seed_errors += prediction_errors(result, truth)
            errors["joints"] += prediction_errors(by_joints.cycle(joints_before, joints_now), truth)
            if not saved and (number == CYCLES - 1 or any(o.moving for o in result.obstacles)):
                saved = True
                image = cv2.cvtColor(stages(result), cv2.COLOR_RGB2BGR)
                name = FOLDER / f"stages-{seed}.png"
                name.unlink(missing_ok=True)
                cv2.imwrite(str(name), image)
                pane_counts.append(panes_with_content(result) if name.is_file() else 0)
        errors["given"] += seed_errors
        median = float(np.median([error for error, _ in seed_errors])) if seed_errors else math.nan
        table.append(
            f"{seed:4d}  {np.mean(ious[-CYCLES:]):9.4f}  {len(seed_errors):11d}  {median:15.4f}"
        )
        say(table[-1])
    given, joints = (np.array(errors[name]).reshape(-1, 2) for name in ("given", "joints"))
    return Outcome(
        {
            "floor_iou": float(np.mean(ious)),
            "floor_iou_min": float(np.min(ious)),
            "prediction_error_m": float(np.median(given[:, 0])),
            "prediction_error_p90_m": float(np.quantile(given[:, 0], 0.9)),
            "prediction_error_joints_m": float(np.median(joints[:, 0])),
            "prediction_nees": float(np.mean(given[:, 1])),
            "prediction_nees_median": float(np.median(given[:, 1])),
            "prediction_nees_inside": float(np.mean(given[:, 1] <= INSIDE)),
            "prediction_nees_joints": float(np.mean(joints[:, 1])),
            "prediction_nees_joints_inside": float(np.mean(joints[:, 1] <= INSIDE)),
            "predictions": float(len(given)),
            "stages": float(min(pane_counts, default=0)),
        },
        table,
    )


EXPERIMENT = Experiment(
    id="000-E1",
    title="Eight stages of a monocular cycle (Han 2018, Fig. 8); floor and predictions against the truth",
    run=run,
    targets={
        "floor_iou": Target(">=", 0.97),
        "prediction_error_m": Target("<=", 0.03),
        "prediction_nees": Target("<=", 2.0),
        "prediction_nees_inside": Target(">=", 0.95),
        "prediction_nees_joints": Target("<=", 2.0),
        "prediction_nees_joints_inside": Target(">=", 0.95),
        "stages": Target("==", 8.0),
    },
    seeds=10,
)
