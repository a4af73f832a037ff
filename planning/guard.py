"""The guard: lets only steps pass that stay clear of what stands and of what may move.

The field looks one step ahead, but a robot of 0.10 m/s among blind movers of 0.06 m/s is hit from the side
and from behind. So before each step a set of plans (turn, walk on, side step, step back, wait) is rolled
out for 7.8 s against each mover under several hypotheses (it goes on, it turns back, it stops), with a
distance that grows with its covariance, and against the occupied cells. Standing is a plan like the
others and no safer: a mover does not go round a robot.

Source: ours; it adds to seed 001, section 4, what a study in simulation showed to be missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from . import _guard_kernels
from .commands import WalkCommand
from .footsteps import GaitConfig


@dataclass(frozen=True)
class GuardConfig:
    """Horizon, margins and hypotheses."""

    gait: GaitConfig = field(default_factory=GaitConfig)
    steps: int = 12  # own: 7.8 s, what the study found enough
    body_radius_m: float = 0.15  # S_r, seed 001
    margin_m: float = 0.05  # ours: between surfaces, of movers
    sigmas: float = 1.0  # ours: share of the deviation added to the margin
    max_sigma_m: float = 0.15  # ours: more doubt than this would freeze the robot
    acceleration_mps2: float = 0.004  # ours: of movers, how their covariance grows
    cell_distance_m: float = 0.17  # ours: body to the middle of an occupied cell, wanted
    cell_contact_m: float = 0.13  # ours: the same, never to be given up
    moving_share: float = 0.3  # ours: less probable movers are taken to stand
    small_radius_m: float = 0.20  # ours: larger standing tracks are left to the occupied cells
    max_mover_mps: float = 0.15  # ours: estimated velocities are capped here
    doubt_s: float = (
        2.5  # ours (study: 3.3): how long the hypotheses that it turns back or stops are followed
    )
    longest_unseen_s: float = (
        15.0  # ours: a mover lost for longer is taken to be lost for this long
    )
    soft_m: float = 0.10  # ours: band beyond the margin that is avoided if it costs little
    w_cells: float = 4.0  # ours: what stands is certain, where a mover goes is not
    w_unease: float = 0.15  # ours: m of detour that leaving the band is worth
    w_heading: float = 0.05  # ours: m per rad of facing away from the target at the end
    fade_s: float = 4.0  # ours: a violation this much later weighs 1/e

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ConfigError(f"guard: steps={self.steps} must be at least 1")
        for name in ("body_radius_m", "doubt_s", "soft_m", "fade_s", "cell_contact_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"guard: {name}={value} must be positive and finite")
        if self.cell_contact_m > self.cell_distance_m:
            raise ConfigError(
                f"guard: cell_contact_m={self.cell_contact_m} is above cell_distance_m="
                f"{self.cell_distance_m}; lower it"
            )


@dataclass(frozen=True)
class Assessment:
    """What the guard made of one plan.

    Args:
        command: Its first step.
        violation_m: How far it comes closer than it should, later ones weighing less; 0: clear.
        cost_m: Distance that it leaves to the target, unease and heading included.
    """

    command: WalkCommand
    violation_m: float
    cost_m: float


def choose(
    desired: WalkCommand,
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    occupied: Float[np.ndarray, "n 2"],
    target: Float[np.ndarray, "2"],
    config: GuardConfig,
    stamp_s: float | None = None,
) -> WalkCommand:
    """The desired step if it is safe, else the first step of the best plan.

    A step is safe if it can be followed by walking on to the target without coming too close. Else the
    clear plan that ends nearest to the target is taken, and if none is clear, the one of least violation.

    Args:
        desired: What the field asks for.
        robot: Gaussian over (x, y, yaw), world frame.
        obstacles: Tracks, world frame, as of now.
        occupied: Middles of occupied cells, world frame, m; far ones may be included.
        target: Via point, world frame, m.
        config: Margins and hypotheses.
        stamp_s: Now, in the clock of `Obstacle.seen_s`; None: the latest sighting of any track.
    """
    return assess(desired, robot, obstacles, occupied, target, config, stamp_s)[0].command


def assess(
    desired: WalkCommand,
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    occupied: Float[np.ndarray, "n 2"],
    target: Float[np.ndarray, "2"],
    config: GuardConfig,
    stamp_s: float | None = None,
) -> list[Assessment]:
    """Every plan, best first; arguments as for `choose`."""
    plans = _plans(desired, config)
    if stamp_s is None:
        stamp_s = max((obstacle.seen_s for obstacle in obstacles), default=0.0)
    movers, needed = _hypotheses(robot, obstacles, stamp_s, config)
    cells, cells_needed = _cells(robot.mean[:2], occupied, config)
    results = np.empty((len(plans), 4))
    _guard_kernels.roll_out(
        robot.mean.astype(np.float64),
        plans,
        target.astype(np.float64),
        config.steps,
        config.gait.max_turn_rad,
        movers,
        needed,
        cells,
        cells_needed,
        config.w_cells,
        config.soft_m,
        config.gait.step_s,
        config.fade_s,
        results,
    )
    violation = results[:, 0]
    cost = results[:, 2] + config.w_unease * results[:, 1] + config.w_heading * results[:, 3]
    order = np.lexsort((cost, np.round(violation, 3)))
    if violation[0] == 0.0:  # the desired one
        order = np.concatenate([[0], order[order != 0]])
    return [
        Assessment(
            desired if i == 0 else _step(plans[i], config), float(violation[i]), float(cost[i])
        )
        for i in order
    ]


def _step(plan: np.ndarray, config: GuardConfig) -> WalkCommand:
    gait = config.gait
    forward, left, turn = (float(v) for v in plan[:3])
    return gait.command(forward / gait.step_s, left / gait.step_s, turn)


def _plans(desired: WalkCommand, config: GuardConfig) -> np.ndarray:
    """(c, 8) as `_guard_kernels.roll_out` takes them; the desired step, then pursuit, comes first."""
    gait = config.gait
    step, turn = gait.step_s, gait.max_turn_rad
    cruise, top, half = (
        gait.cruise_mps * step,
        gait.max_speed_mps * step,
        gait.cruise_mps * step / 2,
    )
    back, side = -gait.max_back_mps * step, gait.max_side_mps * step
    wish = [desired.forward_m, desired.lateral_m, desired.turn_rad]
    stand = [0.0, 0.0, 0.0, 0.0]
    plans = [[*wish, 1, cruise, 0.0, 0.0, 1.0]]
    plans += [[speed, 0.0, 0.0, 0, speed, 0.0, 0.0, 1.0] for speed in (top, half)]
    plans += [[*wish, 1, *stand], [*wish, 2, *stand]]
    plans += [[0.0, 0.0, 0.0, n, cruise, 0.0, 0.0, 1.0] for n in (1, 2, 4)]  # wait, then go
    plans += [[0.0, 0.0, 0.0, 1, *stand]]
    for sign in (1.0, -1.0):
        for n in (1, 2, 3, 5, 7, 10):
            for speed in (top, cruise, half, 0.0, back):
                plans.append([speed, 0.0, sign * turn, n, speed, 0.0, 0.0, 0.0])
            plans.append([0.0, 0.0, sign * turn, n, cruise, 0.0, 0.0, 0.0])
            plans.append([0.0, 0.0, sign * turn, n, top, 0.0, 0.0, 0.0])
            plans.append([back, 0.0, sign * turn, n, top, 0.0, 0.0, 0.0])
            plans.append([back, sign * side, sign * turn, n, top, 0.0, 0.0, 0.0])
        for forward in (back, 0.0, half, cruise):
            for n in (1, 3, 12):
                plans.append([forward, sign * side, 0.0, n, *stand])
    plans += [
        [speed, 0.0, 0.0, n, *stand] for speed in (back, half, cruise, top) for n in (1, 4, 12)
    ]
    return np.array(plans, np.float64)


def _hypotheses(
    robot: Gaussian, obstacles: Sequence[Obstacle], stamp_s: float, config: GuardConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (h, samples, 2) of discs and the distance (h, samples) to be kept from each."""
    times = (np.arange(2 * config.steps) + 1) * config.gait.step_s / 2
    places: list[np.ndarray] = [np.zeros((0, len(times), 2))]
    needed: list[np.ndarray] = [np.zeros((0, len(times)))]
    for obstacle in obstacles:
        moves = obstacle.moving >= config.moving_share
        if not moves and obstacle.radius_m > config.small_radius_m:
            continue
        near = config.body_radius_m + obstacle.radius_m + config.margin_m
        gap = float(np.hypot(*(obstacle.position - robot.mean[:2]))) - near
        distance = near + config.sigmas * _deviation(robot, obstacle, times, config)
        if moves:
            where, needs = _to_and_fro(obstacle, distance, times, stamp_s, config)
        else:
            where = np.broadcast_to(obstacle.position, (1, len(times), 2))
            needs = np.minimum(distance, max(gap + near, near - config.margin_m))[None]
        away = np.hypot(*(where[:, 0] - robot.mean[:2]).T)
        reach = (
            config.steps * config.gait.step_s * (config.gait.max_speed_mps + config.max_mover_mps)
        )
        within = away < reach + distance[-1] + config.soft_m
        places.append(where[within])
        needed.append(needs[within])
    return np.concatenate(places), np.concatenate(needed)


def _to_and_fro(
    obstacle: Obstacle,
    distance: np.ndarray,
    times: np.ndarray,
    stamp_s: float,
    config: GuardConfig,
) -> tuple[np.ndarray, np.ndarray]:
    """Where on its line a mover may be: it goes on, stops, turns back; any time since it was last seen."""
    velocity = obstacle.velocity
    speed = float(np.hypot(*velocity))
    velocity = velocity * min(1.0, config.max_mover_mps / max(speed, 1e-9))
    unseen = min(max(stamp_s - obstacle.seen_s, 0.0), config.longest_unseen_s)
    seen_at = obstacle.position - velocity * unseen
    near = distance.min()
    early = np.where(times <= config.doubt_s, distance, 0.0)
    pieces = 1 + int(speed * unseen / near)
    shares = [1.0 - 2.0 * k / (2 * pieces) for k in range(2 * pieces + 1)]  # 1, ..., 0, ..., -1
    places = [seen_at + share * velocity * (unseen + times[:, None]) for share in shares]
    needed = [distance if share == 1.0 else early for share in shares]
    return np.array(places), np.array(needed)


def _deviation(
    robot: Gaussian, obstacle: Obstacle, times: np.ndarray, config: GuardConfig
) -> np.ndarray:
    """Deviation of the relative position along its worst axis at the times, m, capped.

    A mover's velocity counts with its covariance; a thing that only may move, with its probability times
    the whole second moment (law of total variance).
    """
    P, v = obstacle.state.covariance, obstacle.velocity
    here, cross, speed = P[:2, :2] + robot.covariance[:2, :2], P[:2, 2:], P[2:, 2:]
    share = 1.0
    if obstacle.moving < config.moving_share:
        share, speed = obstacle.moving, speed + np.outer(v, v)
    t = times[:, None, None]
    grown = here + share * (t * (cross + cross.T) + t**2 * speed)
    middle = (grown[:, 0, 0] + grown[:, 1, 1]) / 2
    spread = np.hypot((grown[:, 0, 0] - grown[:, 1, 1]) / 2, grown[:, 0, 1])
    noise = share * (config.acceleration_mps2 * times**2 / 2) ** 2
    return np.minimum(np.sqrt(np.maximum(middle + spread, 0.0) + noise), config.max_sigma_m)


def _cells(
    here: np.ndarray, occupied: np.ndarray, config: GuardConfig
) -> tuple[np.ndarray, np.ndarray]:
    """The cells within reach, and the distance to be kept: no more than there is, never below contact."""
    gap = np.hypot(*(occupied - here).T)
    reach = config.steps * config.gait.step_s * config.gait.max_speed_mps + config.cell_distance_m
    near = gap <= reach
    needed = np.clip(gap[near], config.cell_contact_m, config.cell_distance_m)
    return np.ascontiguousarray(occupied[near], np.float64), needed
