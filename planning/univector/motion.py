"""Heading and speed of the next step among moving obstacles.

In the order of the paper: the evaluations, the extended radii, for each moving obstacle the change of speed that avoids
it, virtual obstacles for those that come along the way, and the field over all of them. Each addition has a switch in
`FieldConfig`.

Source: Yoo 2010 (seed 001), section 6; the choice between different speeds for several obstacles is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.gaussian import Gaussian, deviation
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from ..gaze import evaluations
from ..gaze.evaluations import EvaluationConfig
from . import fields
from .collision import EXACT, Band, colliding_speeds, miss_deviation, widened_band
from .fields import FieldConfig
from .speed import CLEAR, VIRTUAL, Change, change, least_distance
from .virtual_obstacle import VirtualObstacle, virtual_obstacle

SLOWEST_MPS = 0.005  # ours: slower obstacles count as static
ALONG_RAD, ACROSS_RAD = math.radians(30.0), math.radians(45.0)
"""Ours: up to the first angle an obstacle comes along the way, from the second on across it. Between them the weight of
its virtual obstacle fades; with an edge it would come and go, since the angle changes as the robot turns aside."""
NO_CELLS = np.zeros((0, 2))


@dataclass(frozen=True)
class Advice:
    """Result of the field.

    Args:
        heading_rad: Direction to walk, world frame.
        speed_mps: Speed at the end of the next step.
        changes: Change of speed for each obstacle, in their order.
        psi: psi_sf + psi_ob of each, in [0, 2]; zeros without gaze coupling.
        centres, extended_m, virtual: Discs of the field, world frame, m: obstacles, cells, virtual obstacles; weight
            of each virtual one, 0 for the others.
    """

    heading_rad: float
    speed_mps: float
    changes: tuple[Change, ...]
    psi: Float[np.ndarray, "n"]
    centres: Float[np.ndarray, "m 2"]
    extended_m: Float[np.ndarray, "m"]
    virtual: Float[np.ndarray, "m"]


@dataclass(frozen=True)
class _Mover:
    """A moving obstacle in O_R, or in the same axes turned."""

    place: np.ndarray
    velocity: np.ndarray
    covariance: np.ndarray
    radius_m: float
    psi: float
    number: int


def advise(
    robot: Gaussian,
    speed_mps: float,
    obstacles: Sequence[Obstacle],
    goal: Float[np.ndarray, "2"],
    goal_heading: float | None,
    config: FieldConfig,
    model: RobotModel = DARWIN_OP,
    evaluation: EvaluationConfig | None = None,
    cells: Float[np.ndarray, "k 2"] = NO_CELLS,
    cell_m: float = 0.0,
) -> Advice:
    """Heading and speed of the next step.

    Args:
        robot: Gaussian over (x, y, yaw), world frame, m and rad.
        speed_mps: Present forward speed.
        obstacles: Tracks, world frame; static ones count with velocity 0.
        goal: p_d, world frame, m.
        goal_heading: th_tg, rad; None for any.
        config: The field and the switches of its additions.
        model: Radius, speeds and step time of the robot.
        evaluation: Thresholds of psi; None: the defaults.
        cells: Middles of occupied cells without a track, world frame, m.
        cell_m: Side of a cell.

    Source: seed 001, section 4 and 6.
    """
    here, yaw = robot.mean[:2], float(robot.mean[2])
    moves = np.array([_moves(o) for o in obstacles], np.bool_)
    velocities = np.array([o.velocity for o in obstacles]).reshape(-1, 2) * moves[:, None]
    centres = np.array([o.position for o in obstacles]).reshape(-1, 2)
    psi = np.zeros(len(obstacles))
    if config.gaze_coupling:
        psi = _psi(robot, obstacles, velocities, evaluation or EvaluationConfig())
    radii = np.array([o.radius_m for o in obstacles]).reshape(-1)
    extended = fields.extended_radius(radii, np.hypot(*velocities.T), psi, config, model.radius_m)
    movers = _movers(robot, obstacles, moves, extended, psi, config)
    changes, acceleration, bound = _speed(movers, speed_mps, config, model.gait)
    all_changes = [CLEAR] * len(obstacles)
    for mover, one in zip(movers, changes, strict=True):
        all_changes[mover.number] = one
    still = np.zeros(len(cells))
    discs = [*centres, *cells]
    sizes = [
        *(extended + _position_sigma(robot, obstacles, config)),
        *fields.extended_radius(still + cell_m / 2, still, still, config, model.radius_m),
    ]
    weights = [0.0] * len(discs)
    to_goal = fields.move_to_goal(here[None].astype(np.float64), goal, goal_heading, config)[0]
    turn = math.atan2(to_goal[1], to_goal[0]) - yaw
    for extra in _virtual([_turned(m, turn) for m in movers], speed_mps, config):
        discs.append(here + _rotation(yaw + turn) @ extra.place)
        sizes.append(extra.radius_m)
        weights.append(extra.weight)
    virtual, places = np.array(weights), np.array(discs).reshape(-1, 2)
    u = fields.total(
        here[None].astype(np.float64),
        goal,
        goal_heading,
        places,
        np.array(sizes),
        config,
        np.array([yaw]),
        virtual=virtual,
    )[0]
    step = acceleration * model.gait.step_s
    low, high = (bound, speed_mps) if bound < speed_mps else (speed_mps, bound)
    speed = min(max(speed_mps + step, low), high)
    heading = math.atan2(float(u[1]), float(u[0])) if np.hypot(*u) > 0.0 else yaw
    return Advice(heading, speed, tuple(all_changes), psi, places, np.array(sizes), virtual)


def relative_covariance(robot: Gaussian, obstacle: Obstacle) -> Float[np.ndarray, "4 4"]:
    """Covariance of an obstacle (x, y, vx, vy) in O_R, with that of the pose of the robot.

    Args:
        robot: Gaussian over (x, y, yaw), world frame.
        obstacle: World frame.

    Source: ours; first order, robot and obstacle independent.
    """
    c, s = math.cos(robot.mean[2]), math.sin(robot.mean[2])
    R = np.array([[c, s], [-s, c]])
    both = np.kron(np.eye(2), R)
    P = both @ obstacle.state.covariance @ both.T
    P[:2, :2] += R @ robot.covariance[:2, :2] @ R.T
    x, y = R @ (obstacle.position - robot.mean[:2])
    vx, vy = R @ obstacle.velocity
    turned = np.array([y, -x, vy, -vx])
    return np.asarray(P + robot.covariance[2, 2] * np.outer(turned, turned))


def _movers(
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    moves: Bool[np.ndarray, "n"],
    extended: Float[np.ndarray, "n"],
    psi: Float[np.ndarray, "n"],
    config: FieldConfig,
) -> list[_Mover]:
    """The moving obstacles in O_R; arguments as in `advise`."""
    turn = _rotation(-float(robot.mean[2]))
    return [
        _Mover(
            turn @ (obstacles[k].position - robot.mean[:2]),
            turn @ obstacles[k].velocity,
            relative_covariance(robot, obstacles[k]) if config.uncertainty else EXACT,
            float(extended[k]),
            float(psi[k]),
            k,
        )
        for k in np.flatnonzero(moves).tolist()
    ]


def _virtual(
    movers: Sequence[_Mover], speed_mps: float, config: FieldConfig
) -> list[VirtualObstacle]:
    """Virtual obstacles of the moving obstacles that come along the way to the goal, rather than across it.

    The obstacle must bring the robot, on its way to the goal, within S_oe + d_e, where its own field would turn the
    robot aside. By the collision of the present heading the case is over once the robot has turned: it would turn
    back, and aside again (head-on 205 deg in all, 133 deg by this rule, 163 deg without virtual obstacles).

    Args:
        movers: In axes whose x leads to the goal; so are the virtual obstacles.
        speed_mps, config: As in `advise`.

    Source: seed 001, section 4, case (c); the way to the goal in place of the heading is ours.
    """
    if not config.virtual_obstacles:
        return []
    found = []
    for m in movers:
        band = colliding_speeds(m.place, m.velocity, m.radius_m + config.d_e_m)
        angle = math.atan2(abs(m.velocity[1]), -m.velocity[0])
        along = min((ACROSS_RAD - angle) / (ACROSS_RAD - ALONG_RAD), 1.0)
        if along <= 0.0 or band is None or not band.contains(speed_mps):
            continue
        one = virtual_obstacle(m.place, m.velocity, speed_mps, m.radius_m, m.psi, config)
        if one is not None:
            found.append(replace(one, weight=along * one.weight))
    return found


def _turned(mover: _Mover, angle: float) -> _Mover:
    """The same in axes turned by an angle, rad, but for the covariance."""
    back = _rotation(-angle)
    return replace(mover, place=back @ mover.place, velocity=back @ mover.velocity)


def _rotation(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def _moves(obstacle: Obstacle) -> bool:
    return obstacle.moving >= MOVING and float(np.hypot(*obstacle.velocity)) >= SLOWEST_MPS


def _psi(
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    velocities: np.ndarray,
    evaluation: EvaluationConfig,
) -> np.ndarray:
    """psi_sf + psi_ob of each obstacle."""
    offsets = np.array([o.position - robot.mean[:2] for o in obstacles]).reshape(-1, 2)
    covariances = np.array([o.state.covariance[:2, :2] for o in obstacles]).reshape(-1, 2, 2)
    psi_ob = evaluations.of_obstacles(offsets, velocities, covariances, evaluation)
    return evaluations.of_self(robot.covariance, evaluation) + psi_ob


def _position_sigma(
    robot: Gaussian, obstacles: Sequence[Obstacle], config: FieldConfig
) -> np.ndarray:
    """Standard deviation of the relative position to add to S_oe, m."""
    if not config.uncertainty:
        return np.zeros(len(obstacles))
    sigma = [deviation(o.state.covariance[:2, :2] + robot.covariance[:2, :2]) for o in obstacles]
    return fields.SIGMAS * np.minimum(np.array(sigma).reshape(-1), fields.MAX_SIGMA_M)


def _speed(
    movers: Sequence[_Mover], speed_mps: float, config: FieldConfig, gait: GaitLimits
) -> tuple[list[Change], float, float]:
    """Change of speed for each moving obstacle, the acceleration, and the speed at which it ends."""
    most = fields.acceleration_mps2(gait)
    cruise = math.copysign(most, gait.cruise_mps - speed_mps)
    if not config.velocity_change:
        return [CLEAR] * len(movers), cruise, gait.cruise_mps
    bands = [
        widened_band(
            *(mover.place, mover.velocity, mover.radius_m, mover.covariance),
            *(fields.SIGMAS, fields.MAX_SIGMA_M, fields.HORIZON_S),
        )
        for mover in movers
    ]
    if config.mode != "ours":
        return _printed_speed(movers, bands, speed_mps, gait, cruise)
    radii = [mover.radius_m + _miss_sigma(mover, speed_mps) for mover in movers]
    changes = [
        change(mover.place, mover.velocity, radius, band, speed_mps, gait)
        for mover, radius, band in zip(movers, radii, bands, strict=True)
    ]

    def clear(acceleration: float, bound: float) -> bool:
        return all(
            least_distance(m.place, m.velocity, speed_mps, acceleration, bound, fields.HORIZON_S)
            >= r - 1e-6
            for m, r, one in zip(movers, radii, changes, strict=True)
            if one.case != VIRTUAL.case
        )

    if clear(cruise, gait.cruise_mps):
        return [_virtual_or_clear(c) for c in changes], cruise, gait.cruise_mps
    asked = sorted({0.0, *(c.acceleration_mps2 for c in changes)}, key=abs)
    for acceleration in asked:
        bound = gait.max_speed_mps if acceleration > 0.0 else 0.0
        bound = speed_mps if acceleration == 0.0 else bound
        if clear(acceleration, bound):
            return changes, acceleration, bound
    turned = [c if c.case == CLEAR.case else VIRTUAL for c in changes]
    return (
        turned,
        -most,
        0.0,
    )  # no acceleration avoids all: slow down and turn aside


def _printed_speed(
    movers: Sequence[_Mover],
    bands: Sequence[Band | None],
    speed_mps: float,
    gait: GaitLimits,
    cruise: float,
) -> tuple[list[Change], float, float]:
    """The same by the printed law; of several accelerations the largest, which the paper leaves open."""
    changes = [
        change(m.place, m.velocity, m.radius_m, band, speed_mps, gait, literal=True)
        for m, band in zip(movers, bands, strict=True)
    ]
    asked = max((c.acceleration_mps2 for c in changes), key=abs, default=0.0)
    if asked == 0.0:
        return changes, cruise, gait.cruise_mps
    return changes, asked, gait.max_speed_mps if asked > 0.0 else 0.0


def _virtual_or_clear(one: Change) -> Change:
    """The change without a change of speed."""
    return one if one.case == VIRTUAL.case else CLEAR


def _miss_sigma(mover: _Mover, speed_mps: float) -> float:
    """Standard deviation of the miss at the present speed, limited, m."""
    sigma = miss_deviation(
        mover.place, mover.velocity, mover.covariance, speed_mps, fields.HORIZON_S
    )
    return fields.SIGMAS * min(sigma, fields.MAX_SIGMA_M)
