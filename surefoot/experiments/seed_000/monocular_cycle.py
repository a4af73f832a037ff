"""The eight pictures of one monocular cycle, its floor and its predictions against the truth.

The robot of seed 000 walks into its room, head 30 deg down, with three robots going to and fro; where it
turns is drawn by the seed. Poses of the camera are those the simulator gives, as in the seed ("GPS"); beside it
the predictions with the head's own joints. A prediction is right if the edge of a moving robot on the floor
is, 0.65 s later, where it was said to be: column by column along the edge, mean offset. NEES holds that offset
against the covariance that came with it, the mean over the edge; 2 is right for two coordinates, more is
overconfident, and 95 % should lie inside 5.99. The simulator's poses are claimed exact, the joints' as sure as a
walking trunk's.

Source: seed 000, section 6.3, Fig. 8.
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
CYCLES = 8  # of each walk
BEYOND_M = 2.0  # farther off a pixel is 3 cm, and the robot has 30 steps to look again
TILT_DEG = 30.0  # seed 000
ON_FLOOR_M = 1e-3
INSIDE = 5.991  # 95 % of a chi squared of two
EXACT = CameraNoise(pitch_deg=0.0, yaw_deg=0.0, roll_deg=0.0, height_m=0.0)

Walk = list[tuple[Picture, Picture, Picture, Picture, "Moment"]]


class Moment:
    """What is true when the current picture is taken: movers, and which pixels show the floor."""

    def __init__(self, robot: SimulatedRobot, picture: Picture) -> None:
        world = robot.world
        self.movers = world.moving_states()
        self.radii = [mover.radius_m for mover in world.scene.moving_objects]
        self.floor = true_floor(world.rays, picture)

    def place(self, horizon_s: float) -> list[tuple[np.ndarray, float, np.ndarray]]:
        """(x, y), radius and displacement within the horizon of every mover, going straight on."""
        return [
            (np.array([x, y]), radius, np.array([vx, vy]) * horizon_s)
            for (x, y, vx, vy), radius in zip(self.movers, self.radii, strict=True)
        ]


def true_floor(rays: RayCaster, picture: Picture) -> np.ndarray:
    """Pixels whose ray meets the floor first, by the scene itself."""
    pose = picture.T_world_camera
    directions = picture.camera.rays.reshape(-1, 3) @ pose.rotation.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = rays.cast(pose.position, directions.astype(np.float32))
    with np.errstate(invalid="ignore"):
        z = pose.position[2] + hits.distance_m * directions[:, 2]
    return np.asarray(z < ON_FLOOR_M).reshape(picture.rgb.shape[:2])


def walk(seed: int, cycles: int, scene: str = "robots_room") -> Walk:
    """Pairs of pictures of one walk: by given poses, the same by joints, and the truth of each."""
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
                found.append((before[0], now[0], before[1], now[1], Moment(robot, now[0])))
                if len(found) % 3 == 1:
                    turn = float(rng.uniform(-10.0, 10.0))
                robot.walk(WalkCommand(0.04, 0.0, math.radians(turn), 0.30, 0.35))
            before = now
    return found


def _pictures(frame: Frame, truth: Truth) -> tuple[Picture, Picture]:
    """The picture by the pose the simulator gives, and by the joints from where the body really stands."""
    assert frame.colour is not None
    view = frame.colour
    assert view.T_body_camera is not None
    by_joints: Pose3 = truth.robot_pose().lifted() @ view.T_body_camera
    given, joints = (
        Picture(view.rgb, view.camera, pose, frame.stamp_s)
        for pose in (truth.camera_pose("colour"), by_joints)
    )
    return given, joints


def prediction_errors(result: MonocularResult, moment: Moment) -> list[tuple[float, float]]:
    """How far off the predicted edge of every mover that is seen whole and near, m, and its NEES."""
    errors = []
    eye = result.current.T_world_camera.position[:2]
    for centre, radius, moved in moment.place(result.horizon_s):
        if np.hypot(*(centre - eye)) > BEYOND_M:
            continue
        owner = _owner(result.obstacles, centre, radius)
        if owner is not None:
            truly = _edge(owner, result.current, centre, radius) + moved
            off = np.nanmean(owner.predicted_world - truly, axis=0)
            if np.isfinite(off).all():
                claimed = np.nanmean(owner.predicted_covariance, axis=0)
                errors.append((float(np.hypot(*off)), float(off @ np.linalg.solve(claimed, off))))
    return errors


def _owner(
    obstacles: tuple[SeenObstacle, ...], centre: np.ndarray, radius: float
) -> SeenObstacle | None:
    """The obstacle with the most edge pixels at the mover's foot, if it is the mover alone."""
    best, most = None, 4
    for obstacle in obstacles:
        near = np.hypot(*(obstacle.contact_world - centre).T) < radius + 0.05
        if np.count_nonzero(near) > most and np.mean(near) > 0.5:
            best, most = obstacle, int(np.count_nonzero(near))
    return best


def _edge(
    obstacle: SeenObstacle, picture: Picture, centre: np.ndarray, radius: float
) -> np.ndarray:
    """Where the column of each edge pixel truly meets the mover's circle; NaN where it misses it."""
    pixels = obstacle.edge.astype(np.float64)
    a = floor_points(pixels + np.array([0.0, 30.0]), picture.camera, picture.T_world_camera)
    b = floor_points(pixels, picture.camera, picture.T_world_camera)
    along = (b - a) / np.hypot(*(b - a).T)[:, None]
    ahead = np.einsum("ij,ij->i", centre - a, along)
    aside = np.hypot(*(a + ahead[:, None] * along - centre).T)
    with np.errstate(invalid="ignore"):
        reach = ahead - np.sqrt(radius**2 - aside**2)
    return np.asarray(a + reach[:, None] * along)


def shown(result: MonocularResult) -> int:
    """How many of the panes show anything: an even tone is no stage."""
    return sum(int(np.ptp(image)) > 0 for _, image in panes(result))


def run(seeds: int, say: Say) -> Outcome:
    """One walk of eight cycles a seed, about six seconds each."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    ious: list[float] = []
    errors: dict[str, list[tuple[float, float]]] = {"given": [], "joints": []}
    drawn: list[int] = []
    table = ["seed  floor IoU  predictions  median error, m"]
    for seed in range(seeds):
        cycle = Monocular(MonocularConfig(camera_noise=EXACT))
        by_joints = Monocular(MonocularConfig())
        mine: list[tuple[float, float]] = []
        pictured = False
        for number, (before, now, joints_before, joints_now, moment) in enumerate(
            walk(seed, CYCLES)
        ):
            result = cycle.cycle(before, now)
            ground = result.ground > 0
            ious.append(float((ground & moment.floor).sum() / (ground | moment.floor).sum()))
            mine += prediction_errors(result, moment)
            errors["joints"] += prediction_errors(
                by_joints.cycle(joints_before, joints_now), moment
            )
            if not pictured and (number == CYCLES - 1 or any(o.moving for o in result.obstacles)):
                pictured = True
                picture = cv2.cvtColor(stages(result), cv2.COLOR_RGB2BGR)
                name = FOLDER / f"stages-{seed}.png"
                name.unlink(missing_ok=True)
                cv2.imwrite(str(name), picture)
                drawn.append(shown(result) if name.is_file() else 0)
        errors["given"] += mine
        median = float(np.median([error for error, _ in mine])) if mine else math.nan
        table.append(f"{seed:4d}  {np.mean(ious[-CYCLES:]):9.4f}  {len(mine):11d}  {median:15.4f}")
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
            "stages": float(min(drawn, default=0)),
        },
        table,
    )


EXPERIMENT = Experiment(
    id="000-E1",
    title="Eight stages of a monocular cycle; floor and predictions against the truth",
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
