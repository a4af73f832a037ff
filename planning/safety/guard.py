"""The guard: lets a footstep pass only if it stays clear of static and of moving obstacles.

The field looks one step ahead, but a robot of 0.10 m/s among obstacles that do not avoid it, at 0.06 m/s, is hit
from the side and from behind. Before each step the guard rolls out many plans (turn, walk on, side step, step
back, wait, then go on) for 7.8 s against the predicted obstacles, with a distance that grows with their covariance,
and against the occupied cells.

The plan with the least expected cost is walked: a part of it is the probability of contact with what may move, until
the end of the plan and some steps of standing. Small risks are avoided where that is cheap, and somebody is given way
before he is near. Another part is the number of movers that a plan leaves behind the range of the neck: what is out of
view comes from behind unnoticed. The probability of contact in the next seconds is bounded (`risk`): if that plan exceeds
the bound, the best of those that keep it is walked, unless it is more dangerous until its end. Such a bound alone would
make the robot back away before somebody who is faster.

A moving obstacle follows the motion pattern learnt for it. Without a pattern it goes straight on or reverses at any
time, and a plan is charged for every position from which the robot could not leave its path in time. The end of a
plan is charged likewise, else the robot would back away for as long as plans are judged. Standing still is a plan
like the others and not safer, since these obstacles do not go round a robot. The guard keeps its plan until another
is clearly better.

Source: ours; it adds to seed 001, section 4, what a study in simulation showed to be missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.evidence import corner_m
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from ..commands import WalkCommand
from ..footsteps import footstep, half_a_step_on, limited_step
from . import _guard_arguments as arguments
from . import _guard_kernels as kernels
from . import _risk_kernels
from . import guard_settings as constants
from .guard_settings import GuardConfig as GuardConfig
from .hypotheses import Hypotheses
from .prediction import MotionPatterns
from .risk import Risk

SHOWN = 6  # steps of a plan that viewers draw


class Guard:
    """The guard of one walk; keeps the motion patterns of obstacles and the present plan."""

    def __init__(
        self, config: GuardConfig, robot: RobotModel = DARWIN_OP, cell_m: float = 0.05
    ) -> None:
        self.config, self.robot = config, robot
        self.cell_distance_m = robot.radius_m + corner_m(cell_m)
        """Distance kept between the middle of the body and that of an occupied cell, m."""
        self.patterns = MotionPatterns()
        self._present: np.ndarray | None = None  # the plan being walked
        self._last, self._last_s = WalkCommand(), -math.inf
        self._plans = _fixed_plans(config.steps, robot.gait)
        self.risk = 0.0
        """Probability of contact with what may move, in the next `RISK_S` seconds on the plan chosen last."""
        self.word = "guard"
        """Why another step than the desired one was chosen last: "guard", or "least risk" if no plan keeps the bound."""
        self.ahead = np.zeros((0, 3))
        """(n, 3) poses of the body after each of its next steps: x, y, yaw, world frame, m and rad."""

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

        A step is safe if the robot can make it and then walk to the target at a sufficient distance.

        Args:
            desired: Step that the planner asks for.
            robot: Gaussian over (x, y, yaw), world frame.
            obstacles: Tracks at the present time, world frame, each under the hypothesis of straight motion.
            occupied: Middles of occupied cells, world frame, m; may include distant ones.
            target: Via point, world frame, m.
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
        """
        self.patterns.update(obstacles)
        # after a long pause the last step was another component's
        paused = stamp_s - self._last_s > 1.5 * self.robot.gait.step_s
        ahead = half_a_step_on(Pose2(*robot.mean.tolist()), WalkCommand() if paused else self._last)
        robot = Gaussian(ahead.vector, robot.covariance)
        scene = _Scene(
            robot, obstacles, occupied, target, self.config, self.robot, stamp_s, self.patterns,
            self.cell_distance_m,
        )  # fmt: skip
        self._last, self._last_s = self._safest(desired, scene), stamp_s
        return self._last

    def expected(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Obstacle]:
        """The tracks at their predicted positions, and remembered obstacles without a track; for the gaze."""
        everything = [*obstacles, *self.patterns.remembered(obstacles, stamp_s)]
        return [self.patterns.propagated(obstacle, stamp_s) for obstacle in everything]

    def _safest(self, desired: WalkCommand, scene: _Scene) -> WalkCommand:
        wish, bound = _desired_plans(desired, self.robot.gait)[:1], self.config.risk
        harm, _ = scene.judge(wish)
        harm += constants.EXPECTED_CONTACT_M * scene.risks(wish, to_the_end=True)
        self.word, self.risk = "guard", float(scene.risks(wish)[0])
        if harm[0] <= constants.PASS_M and self.risk <= bound:
            self._present, self.ahead = None, scene.poses(wish[0])
            return desired
        plans = self._candidates(desired)
        harm, cost = scene.judge(plans)
        touches = scene.touches(plans)
        cost += constants.OUT_OF_VIEW_M * scene.out_of_view(plans)
        cost += constants.EXPECTED_CONTACT_M * touches
        cost[1] -= self.config.keep_m + self.config.keep_share * harm[1]  # the present plan
        best = scene.cheapest(plans, cost)
        if scene.risks(plans[[best]])[0] > bound:
            self.word = "least risk"
            keeps = (scene.risks(plans) <= bound) & ~touches
            if keeps.any():
                other = scene.cheapest(plans, np.where(keeps, cost, math.inf))
                later = scene.risks(plans[[best, other]], to_the_end=True)
                if later[1] <= later[0]:
                    self.word, best = "guard", other
        self.risk = float(scene.risks(plans[[best]])[0])
        self._present, self.ahead = plans[best].copy(), scene.poses(plans[best])
        return desired if best == 0 else scene.step(plans[best])

    def _candidates(self, desired: WalkCommand) -> np.ndarray:
        """All plans: first the desired step and then pursuit, second the rest of the present plan."""
        wishes = _desired_plans(desired, self.robot.gait)
        rest = wishes[0].copy()
        if self._present is not None:
            rest = self._present.copy()
            rest[arguments.REPEAT] = max(rest[arguments.REPEAT] - 1.0, 0.0)
            if rest[arguments.REPEAT] == 0.0 and rest[arguments.PURSUES] == 0.0:
                rest[:3], rest[arguments.REPEAT] = rest[4:7], 1.0  # its second part continues
        return np.concatenate([wishes[:1], rest[None], wishes[1:], self._plans])


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
        stamp_s: Present time, in the clock of `Obstacle.seen_s`; None: the latest sighting of any track.
    """
    if stamp_s is None:
        stamp_s = max((obstacle.seen_s for obstacle in obstacles), default=0.0)
    return Guard(config, model).choose(desired, robot, obstacles, occupied, target, stamp_s)


class _Scene:
    """Everything that plans are judged by, as arrays for the kernel."""

    def __init__(
        self,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: np.ndarray,
        target: np.ndarray,
        config: GuardConfig,
        model: RobotModel,
        stamp_s: float,
        patterns: MotionPatterns,
        cell_distance_m: float,
    ) -> None:
        gait = model.gait
        hypotheses = Hypotheses(robot, stamp_s, config, model, patterns, occupied)
        everything = [*obstacles, *patterns.remembered(obstacles, stamp_s)]
        for obstacle in everything:
            hypotheses.add(obstacle)
        self._risk = Risk(robot, everything, stamp_s, config, model, patterns)
        for line in patterns.lost(obstacles, stamp_s):
            hypotheses.add_lost(line)
        self._limits = gait
        self._robot, self._target = robot.mean.astype(np.float64), target.astype(np.float64)
        self._gait = arguments.Gait(
            gait.max_turn_rad, gait.step_s, gait.max_speed_mps, max(gait.max_side_mps, 1e-3)
        )
        self._discs = hypotheses.discs()
        self._cells = _cells(robot.mean[:2], occupied, config.steps, model, cell_distance_m)
        self._costs = arguments.Costs(
            soft_m=constants.SOFT_M,
            soft_cost_m=constants.SOFT_COST_M,
            steep=constants.STEEP,
            touch_m=config.margin_m,
            contact_cost_m=constants.CONTACT_COST_M,
            fade_s=config.fade_s,
            react_s=config.react_s,
            following=config.following_cost,
            max_sigma_m=config.sigmas * config.max_sigma_m,
        )

    def judge(self, plans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cost of obstacles, and total cost, of every plan, m."""
        results = np.empty((len(plans), 4))
        kernels.roll_out(
            self._robot,
            np.ascontiguousarray(plans),
            self._target,
            self._gait,
            self._discs,
            self._cells,
            self._costs,
            results,
        )
        harm = results[:, 0] + results[:, 1]
        return harm, harm + results[:, 2] + constants.HEADING_COST_M * results[:, 3]

    def risks(self, plans: np.ndarray, to_the_end: bool = False) -> Float[np.ndarray, "c"]:
        """Probability of contact with what may move on every plan, in the time of the bound or until its end."""
        return self._risk.of(plans, self._robot, self._target, self._gait, to_the_end)

    def touches(self, plans: np.ndarray) -> Bool[np.ndarray, "c"]:
        """Whether every plan touches an occupied cell in the time of the bound."""
        found: np.ndarray = _risk_kernels.touch_cells(
            self._robot, plans, self._target, self._gait, self._risk.steps, self._cells
        )
        return found

    def out_of_view(self, plans: np.ndarray) -> Float[np.ndarray, "c"]:
        """Expected number of near movers that every plan has out of view after the time of the bound."""
        return self._risk.out_of_view(plans, self._robot, self._target, self._gait)

    def cheapest(self, plans: np.ndarray, cost: Float[np.ndarray, "c"]) -> int:
        """Number of the plan with the least expected cost: its own, and that of a contact until its end."""
        return self._risk.cheapest(plans, cost, self._robot, self._target, self._gait)

    def step(self, plan: np.ndarray) -> WalkCommand:
        """The first step of a plan, as the kernel makes it; a plan whose first part is over may pursue the target."""
        gait = self._limits
        begins = plan[arguments.REPEAT] > 0.0
        forward, left, turn = (plan[:3] if begins else plan[4:7]).tolist()
        if begins or plan[arguments.PURSUES] == 0.0:
            return limited_step(gait, forward / gait.step_s, left / gait.step_s, turn)
        dx, dy = (self._target - self._robot[:2]).tolist()
        if math.hypot(dx, dy) < 0.5 * forward:
            return limited_step(gait, 0.0, 0.0, 0.0)
        pose = Pose2(*self._robot.tolist())
        return footstep(math.atan2(dy, dx), forward / gait.step_s, pose, gait)

    def poses(self, plan: np.ndarray) -> Float[np.ndarray, "n 3"]:
        """The body after each of the first steps of a plan, for viewers."""
        found: np.ndarray = _risk_kernels.walked(self._robot, plan, self._target, self._gait, SHOWN)
        return found[1::2]


def _desired_plans(desired: WalkCommand, gait: GaitLimits) -> np.ndarray:
    """(3, 8) plans that begin with the desired step, then pursue the target or stand."""
    cruise = gait.cruise_mps * gait.step_s
    wish = [desired.forward_m, desired.lateral_m, desired.turn_rad]
    return np.array(
        [[*wish, 1, cruise, 0, 0, 1], [*wish, 1, 0, 0, 0, 0], [*wish, 2, 0, 0, 0, 0]], np.float64
    )


@cache
def _fixed_plans(steps: int, gait: GaitLimits) -> np.ndarray:
    """(c, 8) plans: every first step, for some steps, with every continuation."""
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
    here: np.ndarray, occupied: np.ndarray, steps: int, model: RobotModel, wanted_m: float
) -> arguments.Cells:
    """The cells within reach, nearest first; the required distance is at most the present one."""
    gap = np.hypot(*(occupied - here).T)
    contact_m = model.breadth * constants.CELL_CONTACT_M
    reach = steps * model.gait.step_s * model.gait.max_speed_mps + wanted_m
    near = np.flatnonzero(gap <= reach)
    near = near[np.argsort(gap[near], kind="stable")]
    wanted = np.clip(gap[near], contact_m, wanted_m)
    touch = np.minimum(np.full(len(wanted), contact_m), gap[near])
    places = np.ascontiguousarray(occupied[near], np.float64)
    return arguments.Cells(places, np.stack([wanted, touch], axis=1))
