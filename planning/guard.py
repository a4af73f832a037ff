"""The guard: lets only steps pass that stay clear of what stands and of what may move.

The field looks one step ahead, but a robot of 0.10 m/s among blind movers of 0.06 m/s is hit from the side
and from behind. So before each step many plans (turn, walk on, side step, step back, wait, then go) are
rolled out for 7.8 s against every mover, with a distance that grows with its covariance, and
against the occupied cells. A mover goes where its line is known to lead; where nothing is known it goes on, or
turns back at any moment: then a plan is charged for every place from which the robot could not get out of its
way in time. Standing is a plan like the others and no safer: a mover does not go round a robot. The plan
chosen is remembered: the next step goes on with it unless another is clearly better.

Source: ours; it adds to seed 001, section 4, what a study in simulation showed to be missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from . import _guard_kernels
from .commands import WalkCommand
from .footsteps import GaitConfig
from .prediction import Habits, PredictionConfig


@dataclass(frozen=True)
class GuardConfig:
    """Horizon, margins, hypotheses and prices."""

    gait: GaitConfig = field(default_factory=GaitConfig)
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
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
    doubt_s: float = (
        2.5  # ours (study: 3.3): how long the hypotheses that it turned back unseen are followed
    )
    longest_unseen_s: float = (
        15.0  # ours: a mover lost for longer is taken to be lost for this long
    )
    turns_every_s: float = 20.0  # navigation trials: movers turn every 12 to 25 s
    turn_weight: float = 0.25  # ours: a turn within the time that getting out of the way takes
    learnt_weight: float = 0.04  # ours: the same where it was never seen to turn
    react_s: float = 1.3  # ours: until a turn is noticed and the robot makes its next step
    soft_m: float = 0.10  # ours: band beyond the margin that is avoided if it costs little
    uneasy_m: float = 0.15  # ours: m of detour that leaving the band is worth
    steep: float = 40.0  # ours: m of detour that each m of missing distance is worth
    contact_m: float = 4.0  # ours: m of detour that a contact is worth, beside that
    w_heading: float = 0.05  # ours: m per rad of facing away from the target at the end
    keep_m: float = 0.04  # ours: another plan must be better by so much than the one begun
    pass_m: float = 0.10  # ours: the desired step passes if it does no more harm than this
    fade_s: float = 4.0  # ours: harm this much later weighs 1/e

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ConfigError(f"guard: steps={self.steps} must be at least 1")
        for name in ("body_radius_m", "doubt_s", "soft_m", "fade_s", "cell_contact_m",
                     "turns_every_s"):  # fmt: skip
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
        harm_m: What it risks, in metres of detour that avoiding it is worth; 0: nothing near.
        cost_m: Harm, distance that it leaves to the target, and heading.
    """

    command: WalkCommand
    harm_m: float
    cost_m: float


class Guard:
    """The guard of one walk: remembers the ways of movers, and the plan begun."""

    def __init__(self, config: GuardConfig) -> None:
        self.config = config
        self.habits = Habits(config.prediction)
        self._begun: np.ndarray | None = None
        self._plans = _fixed_plans(config)

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
    ) -> WalkCommand:
        """The desired step if it is safe, else the first step of the best plan.

        A step is safe if it can be followed by walking on to the target without coming too close.

        Args:
            desired: What the field asks for.
            robot: Gaussian over (x, y, yaw), world frame.
            obstacles: Tracks, world frame, as of now, gone straight on since they were seen.
            occupied: Middles of occupied cells, world frame, m; far ones may be included.
            target: Via point, world frame, m.
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
        """
        self.habits.learn(obstacles)
        scene = _Scene(robot, obstacles, occupied, target, self.config, stamp_s, self.habits)
        harm, _ = scene.judge(_wishes(desired, self.config)[:1])
        if harm[0] <= self.config.pass_m:
            self._begun = None
            return desired
        plans = self._with_wishes(desired)
        harm, cost = scene.judge(plans, prune=True)
        cost[1] -= self.config.keep_m
        best = int(np.argmin(cost))
        self._begun = plans[best].copy()
        return desired if best == 0 else _step(plans[best], self.config)

    def _with_wishes(self, desired: WalkCommand) -> np.ndarray:
        """The plans: the desired step and then pursuit first, what is left of the plan begun second."""
        wishes = _wishes(desired, self.config)
        begun = wishes[0].copy()
        if self._begun is not None:
            begun = self._begun.copy()
            begun[3] = max(begun[3] - 1.0, 0.0)
            if begun[3] == 0.0 and begun[7] == 0.0:  # its second part goes on
                begun[:3], begun[3] = begun[4:7], 1.0
        return np.concatenate([wishes[:1], begun[None], wishes[1:], self._plans])


def choose(
    desired: WalkCommand,
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    occupied: Float[np.ndarray, "n 2"],
    target: Float[np.ndarray, "2"],
    config: GuardConfig,
    stamp_s: float | None = None,
) -> WalkCommand:
    """As `Guard.choose`, for one step without memory.

    Args:
        stamp_s: Now, in the clock of `Obstacle.seen_s`; None: the latest sighting of any track.
    """
    if stamp_s is None:
        stamp_s = max((obstacle.seen_s for obstacle in obstacles), default=0.0)
    return Guard(config).choose(desired, robot, obstacles, occupied, target, stamp_s)


def assess(
    desired: WalkCommand,
    robot: Gaussian,
    obstacles: Sequence[Obstacle],
    occupied: Float[np.ndarray, "n 2"],
    target: Float[np.ndarray, "2"],
    config: GuardConfig,
    stamp_s: float | None = None,
) -> list[Assessment]:
    """Every plan, best first (the desired one if it is safe); arguments as for `choose`."""
    plans = np.concatenate([_wishes(desired, config), _fixed_plans(config)])
    if stamp_s is None:
        stamp_s = max((obstacle.seen_s for obstacle in obstacles), default=0.0)
    habits = Habits(config.prediction)
    scene = _Scene(robot, obstacles, occupied, target, config, stamp_s, habits)
    harm, cost = scene.judge(plans)
    order = np.argsort(cost, kind="stable")
    if harm[0] <= config.pass_m:
        order = np.concatenate([[0], order[order != 0]])
    return [
        Assessment(desired if i == 0 else _step(plans[i], config), float(harm[i]), float(cost[i]))
        for i in order
    ]


class _Scene:
    """Everything that plans are judged by, laid out for the kernel."""

    def __init__(
        self,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: np.ndarray,
        target: np.ndarray,
        config: GuardConfig,
        stamp_s: float,
        habits: Habits,
    ) -> None:
        gait = config.gait
        where = _Hypotheses(robot, stamp_s, config, habits)
        for obstacle in obstacles:
            where.add(obstacle)
        self._w_heading = config.w_heading
        self._robot, self._target = robot.mean.astype(np.float64), target.astype(np.float64)
        self._gait = np.array(
            [gait.max_turn_rad, gait.step_s, gait.max_speed_mps, max(gait.max_side_mps, 1e-3)]
        )
        self._movers = where.arrays()
        self._cells = _cells(robot.mean[:2], occupied, config)
        self._prices = np.array(
            [
                config.soft_m,
                config.uneasy_m,
                config.steep,
                config.margin_m,
                config.contact_m,
                config.fade_s,
                config.react_s,
            ]
        )

    def judge(self, plans: np.ndarray, prune: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Harm and cost of every plan, m; infinite for one given up early."""
        places, velocities, needed, weights, turning = self._movers
        cells, cells_needed = self._cells
        results = np.empty((len(plans), 4))
        _guard_kernels.roll_out(
            self._robot,
            np.ascontiguousarray(plans),
            self._target,
            self._gait,
            places,
            velocities,
            needed,
            weights,
            turning,
            cells,
            cells_needed,
            self._prices,
            prune,
            results,
        )
        harm = results[:, 0] + results[:, 1]
        return harm, harm + results[:, 2] + self._w_heading * results[:, 3]


def _step(plan: np.ndarray, config: GuardConfig) -> WalkCommand:
    gait = config.gait
    first = plan[:3] if plan[3] > 0.0 else plan[4:7]
    forward, left, turn = (float(v) for v in first)
    return gait.command(forward / gait.step_s, left / gait.step_s, turn)


def _wishes(desired: WalkCommand, config: GuardConfig) -> np.ndarray:
    """(c, 8) as `_guard_kernels.roll_out` takes them: the desired step, then pursuit; or then standing."""
    cruise = config.gait.cruise_mps * config.gait.step_s
    wish = [desired.forward_m, desired.lateral_m, desired.turn_rad]
    return np.array(
        [[*wish, 1, cruise, 0, 0, 1], [*wish, 1, 0, 0, 0, 0], [*wish, 2, 0, 0, 0, 0]], np.float64
    )


@cache
def _fixed_plans(config: GuardConfig) -> np.ndarray:
    """(c, 8): every way to begin, for some steps, and every way to go on."""
    gait = config.gait
    step, turn = gait.step_s, gait.max_turn_rad
    cruise, top = gait.cruise_mps * step, gait.max_speed_mps * step
    half, back, side = cruise / 2, -gait.max_back_mps * step, gait.max_side_mps * step
    firsts = [
        [speed, 0.0, sign * turn]
        for speed in (top, cruise, half, 0.0, back)
        for sign in (1.0, 0.5, 0.0, -0.5, -1.0)
    ]
    firsts += [[f, sign * side, 0.0] for f in (back, 0.0, half, cruise) for sign in (1.0, -1.0)]
    thens = [[cruise, 0.0, 0.0, 1.0], [top, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]
    thens += [[top, 0.0, sign * turn, 0.0] for sign in (0.0, 1.0, -1.0)]
    thens += [[back, 0.0, 0.0, 0.0]]
    plans = [[*first, n, *then] for first in firsts for n in (1, 2, 4, 7) for then in thens]
    plans += [[*first, config.steps, 0.0, 0.0, 0.0, 0.0] for first in firsts]
    return np.array(plans, np.float64)


class _Hypotheses:
    """Where discs may be at the samples, how far to keep away, and how likely they turn there."""

    def __init__(
        self, robot: Gaussian, stamp_s: float, config: GuardConfig, habits: Habits
    ) -> None:
        self._robot, self._stamp_s, self._config, self._habits = robot, stamp_s, config, habits
        samples = 2 * config.steps
        self._times = (np.arange(samples) + 1) * config.gait.step_s / 2
        self._places = [np.zeros((0, samples, 2))]
        self._velocities = [np.zeros((0, samples, 2))]
        self._needed = [np.zeros((0, samples))]
        self._turning = [np.zeros((0, samples))]
        self._weights: list[float] = []

    def arrays(self) -> tuple[np.ndarray, ...]:
        """As `_guard_kernels.roll_out` takes them."""
        return (
            np.concatenate(self._places),
            np.concatenate(self._velocities),
            np.concatenate(self._needed),
            np.array(self._weights, np.float64),
            np.concatenate(self._turning),
        )

    def add(self, obstacle: Obstacle) -> None:
        """All that one obstacle may do."""
        config = self._config
        moves = obstacle.moving >= config.moving_share
        if not moves and obstacle.radius_m > config.small_radius_m:
            return
        near = config.body_radius_m + obstacle.radius_m + config.margin_m
        away = float(np.hypot(*(obstacle.position - self._robot.mean[:2])))
        reach = self._times[-1] * (config.gait.max_speed_mps + config.prediction.most_mps)
        if away > reach + near + config.max_sigma_m + config.soft_m:
            return
        distance = near + config.sigmas * _deviation(self._robot, obstacle, self._times, config)
        if moves:
            self._add_mover(obstacle, distance)
            return
        places = np.broadcast_to(obstacle.position, (len(self._times), 2))
        needed = np.minimum(distance, max(away, near - config.margin_m))
        self._put(places, np.zeros_like(places), needed, 1.0, np.zeros(len(self._times)))

    def _put(
        self,
        places: np.ndarray,
        velocities: np.ndarray,
        needed: np.ndarray,
        weight: float,
        turning: np.ndarray,
    ) -> None:
        self._places.append(places[None])
        self._velocities.append(velocities[None])
        self._needed.append(needed[None])
        self._weights.append(weight)
        self._turning.append(turning[None])

    def _add_mover(self, obstacle: Obstacle, distance: np.ndarray) -> None:
        """It goes on as forecast; if it was lost, it may have turned or stopped at any time since."""
        config, times = self._config, self._times
        unseen = min(max(self._stamp_s - obstacle.seen_s, 0.0), config.longest_unseen_s)
        forecast = self._habits.forecast(obstacle, self._stamp_s, times)
        turning = np.where(forecast.learnt, config.learnt_weight, config.turn_weight)
        self._put(forecast.places, forecast.velocities, distance, 1.0, turning)
        if forecast.since_seen or unseen <= config.gait.step_s:
            return
        velocity = obstacle.velocity
        speed = float(np.hypot(*velocity))
        velocity = velocity * min(1.0, config.prediction.most_mps / max(speed, 1e-9))
        seen_at = obstacle.position - obstacle.velocity * unseen
        early = np.where(times <= config.doubt_s, distance, 0.0)
        pieces = 1 + int(speed * unseen / float(distance.min()))
        weight = -math.expm1(-unseen / config.turns_every_s)
        never = np.zeros(len(times))
        for k in range(1, 2 * pieces + 1):
            share = 1.0 - k / pieces  # below 1, ..., 0, ..., -1
            places = seen_at + share * velocity * (unseen + times[:, None])
            self._put(places, np.zeros_like(places), early, max(weight, 0.2), never)


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
    """The cells within reach, the distance to be kept (no more than there is), and that of contact."""
    gap = np.hypot(*(occupied - here).T)
    reach = config.steps * config.gait.step_s * config.gait.max_speed_mps + config.cell_distance_m
    near = gap <= reach
    wanted = np.clip(gap[near], config.cell_contact_m, config.cell_distance_m)
    touch = np.minimum(np.full(len(wanted), config.cell_contact_m), gap[near])
    return np.ascontiguousarray(occupied[near], np.float64), np.stack([wanted, touch], axis=1)
