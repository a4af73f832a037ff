"""The guard: lets only steps pass that stay clear of what stands and of what may move.

The field looks one step ahead, but a robot of 0.10 m/s among blind movers of 0.06 m/s is hit from the side
and from behind. So before each step many plans (turn, walk on, side step, step back, wait, then go) are
rolled out for 7.8 s against every mover, with a distance that grows with its covariance, and
against the occupied cells. A mover goes where its line is known to lead; where nothing is known it goes on, or
turns back at any moment: then a plan is charged for every place from which the robot could not get out of its
way in time. A plan that ends where it could not get out of the way of one who goes on is charged likewise:
else the robot backs away, for as long as it is judged, from who is a little faster than it. Standing is a plan
like the others and no safer: a mover does not go round a robot. The plan chosen is remembered: the next step
goes on with it unless another is clearly better.

Source: ours; it adds to seed 001, section 4, what a study in simulation showed to be missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from ..commands import WalkCommand
from ..footsteps import footstep, half_a_step_on, limited_step
from . import _guard_kernels
from .guard_settings import CELL_CONTACT_M, CELL_DISTANCE_M
from .guard_settings import GuardConfig as GuardConfig
from .hypotheses import Hypotheses
from .prediction import MotionPatterns


class Guard:
    """The guard of one walk: remembers the ways of movers, and the plan begun."""

    def __init__(self, config: GuardConfig, robot: RobotModel) -> None:
        self.config, self.robot = config, robot
        self.habits = MotionPatterns(config.prediction)
        self._begun: np.ndarray | None = None
        self._last, self._last_s = WalkCommand(), -math.inf
        self._plans = _fixed_plans(config.steps, robot.gait)

    @property
    def cell_distance_m(self) -> float:
        """Distance kept between the middle of the body and that of an occupied cell, m."""
        return self.robot.breadth * CELL_DISTANCE_M

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
        # others have decided since, if the last step of its own is long ago
        long_ago = stamp_s - self._last_s > 1.5 * self.robot.gait.step_s
        ahead = half_a_step_on(
            Pose2(*robot.mean.tolist()), WalkCommand() if long_ago else self._last
        )
        robot = Gaussian(ahead.vector, robot.covariance)
        scene = _Scene(
            robot, obstacles, occupied, target, self.config, self.robot, stamp_s, self.habits
        )
        self._last, self._last_s = self._safest(desired, scene), stamp_s
        return self._last

    def _safest(self, desired: WalkCommand, scene: _Scene) -> WalkCommand:
        harm, _ = scene.judge(_wishes(desired, self.robot.gait)[:1])
        if harm[0] <= self.config.pass_m:
            self._begun = None
            return desired
        plans = self._with_wishes(desired)
        harm, cost = scene.judge(plans, prune=True)
        if np.isfinite(cost[1]):
            cost[1] -= self.config.keep_m + self.config.keep_share * harm[1]
        best = int(np.argmin(cost))
        self._begun = plans[best].copy()
        return desired if best == 0 else scene.step(plans[best])

    def expected(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Obstacle]:
        """The tracks where they should be by now, and what is remembered but followed no more: for the eyes."""
        everything = [*obstacles, *self.habits.remembered(obstacles, stamp_s)]
        return [self.habits.now(obstacle, stamp_s) for obstacle in everything]

    def _with_wishes(self, desired: WalkCommand) -> np.ndarray:
        """The plans: the desired step and then pursuit first, what is left of the plan begun second."""
        wishes = _wishes(desired, self.robot.gait)
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
    model: RobotModel = DARWIN_OP,
    stamp_s: float | None = None,
) -> WalkCommand:
    """As `Guard.choose`, for one step without memory.

    Args:
        stamp_s: Now, in the clock of `Obstacle.seen_s`; None: the latest sighting of any track.
    """
    if stamp_s is None:
        stamp_s = max((obstacle.seen_s for obstacle in obstacles), default=0.0)
    return Guard(config, model).choose(desired, robot, obstacles, occupied, target, stamp_s)


class _Scene:
    """Everything that plans are judged by, laid out for the kernel."""

    def __init__(
        self,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: np.ndarray,
        target: np.ndarray,
        config: GuardConfig,
        model: RobotModel,
        stamp_s: float,
        habits: MotionPatterns,
    ) -> None:
        gait = model.gait
        where = Hypotheses(robot, stamp_s, config, model, habits)
        for obstacle in [*obstacles, *habits.remembered(obstacles, stamp_s)]:
            where.add(obstacle)
        for line in habits.lost(obstacles, stamp_s):
            where.add_lost(line)
        self._w_heading, self._limits = config.w_heading, gait
        self._robot, self._target = robot.mean.astype(np.float64), target.astype(np.float64)
        self._gait = np.array(
            [gait.max_turn_rad, gait.step_s, gait.max_speed_mps, max(gait.max_side_mps, 1e-3)]
        )
        self._movers = where.arrays()
        self._cells = _cells(robot.mean[:2], occupied, config.steps, model)
        self._prices = np.array(
            [
                config.soft_m,
                config.uneasy_m,
                config.steep,
                config.margin_m,
                config.contact_m,
                config.fade_s,
                config.react_s,
                config.at_heels,
                config.sigmas * config.max_sigma_m,
            ]
        )

    def judge(self, plans: np.ndarray, prune: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Harm and cost of every plan, m; infinite for one given up early."""
        places, velocities, needed, doubts, weights, turning = self._movers
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
            doubts,
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

    def step(self, plan: np.ndarray) -> WalkCommand:
        """The first step of a plan, as it was judged: a plan whose first part is over may pursue the target."""
        gait = self._limits
        begins = plan[3] > 0.0
        forward, left, turn = (plan[:3] if begins else plan[4:7]).tolist()
        if begins or plan[7] == 0.0:
            return limited_step(gait, forward / gait.step_s, left / gait.step_s, turn)
        dx, dy = (self._target - self._robot[:2]).tolist()
        if math.hypot(dx, dy) < 0.5 * forward:
            return limited_step(gait, 0.0, 0.0, 0.0)
        return footstep(
            math.atan2(dy, dx), forward / gait.step_s, Pose2(*self._robot.tolist()), gait
        )


def _wishes(desired: WalkCommand, gait: GaitLimits) -> np.ndarray:
    """(c, 8) as `_guard_kernels.roll_out` takes them: the desired step, then pursuit; or then standing."""
    cruise = gait.cruise_mps * gait.step_s
    wish = [desired.forward_m, desired.lateral_m, desired.turn_rad]
    return np.array(
        [[*wish, 1, cruise, 0, 0, 1], [*wish, 1, 0, 0, 0, 0], [*wish, 2, 0, 0, 0, 0]], np.float64
    )


@cache
def _fixed_plans(steps: int, gait: GaitLimits) -> np.ndarray:
    """(c, 8): every way to begin, for some steps, and every way to go on."""
    step, turn = gait.step_s, gait.max_turn_rad
    cruise, top = gait.cruise_mps * step, gait.max_speed_mps * step
    half, back, side = cruise / 2, -gait.max_back_mps * step, gait.max_side_mps * step
    firsts = [[f, 0.0, t * turn] for f in (top, cruise, half, 0, back) for t in (1, 0, -1)]
    firsts += [[f, 0.0, t * turn / 2] for f in (top, cruise) for t in (1, -1)]
    firsts += [[f, sign * side, 0.0] for f in (back, 0.0, half, cruise) for sign in (1.0, -1.0)]
    thens = [[cruise, 0.0, 0.0, 1.0], [top, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]
    thens += [[top, 0.0, sign * turn, 0.0] for sign in (0.0, 1.0, -1.0)]
    thens += [[back, 0.0, 0.0, 0.0]]
    plans = [[*first, n, *then] for first in firsts for n in (1, 3, 6) for then in thens]
    plans += [[*first, steps, 0.0, 0.0, 0.0, 0.0] for first in firsts]
    return np.array(plans, np.float64)


def _cells(
    here: np.ndarray, occupied: np.ndarray, steps: int, model: RobotModel
) -> tuple[np.ndarray, np.ndarray]:
    """The cells within reach, nearest first, the distance to be kept (no more than there is), and of contact."""
    gap = np.hypot(*(occupied - here).T)
    wanted_m, contact_m = model.breadth * CELL_DISTANCE_M, model.breadth * CELL_CONTACT_M
    reach = steps * model.gait.step_s * model.gait.max_speed_mps + wanted_m
    near = np.flatnonzero(gap <= reach)
    near = near[np.argsort(gap[near], kind="stable")]
    wanted = np.clip(gap[near], contact_m, wanted_m)
    touch = np.minimum(np.full(len(wanted), contact_m), gap[near])
    return np.ascontiguousarray(occupied[near], np.float64), np.stack([wanted, touch], axis=1)
