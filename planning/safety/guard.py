"""The guard: lets a footstep pass only if it stays clear of static and of moving obstacles.

The field looks one step ahead, but a robot of 0.10 m/s among obstacles that do not avoid it, at 0.06 m/s, is hit
from the side and from behind. Before each step the guard rolls out many plans (turn, walk on, side step, step
back, wait, then go on) for 7.8 s against the predicted obstacles and the occupied cells.

The plan with the least expected cost is walked: a part of it is the probability of contact with what may move, until
the end of the plan and some steps of standing. Small risks are avoided where that is cheap, and somebody is given way
before he is near. The probability of contact in the next seconds is bounded (`risk`): what the plan would bring, times
the share that still happens when the robot decides anew at every step. If the cheapest plan exceeds the
bound, the cheapest of those that keep it is walked; where none does, the cheapest of the least dangerous. In both cases
only if it is not more dangerous until its end: the bound alone would make the robot back away before somebody who is
faster.

Behind the robot, where it never looked, there may be a wall. Ground there that was never seen costs a plan the contact
that may wait on it, as far as the plan covers more of it than the desired step does, unless the robot has to give way
to somebody. Ahead, the cameras see the ground before the robot reaches it, but for the first steps of a walk.

A moving obstacle goes on as its modes of motion say, on the motion pattern learnt for it if there is one. Standing still
is a plan like the others and not safer, since these obstacles do not go round a robot. The guard keeps its plan until
another is clearly better.

Source: ours; it adds to seed 001, section 4, what a study in simulation showed to be missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.evidence import corner_m
from perception.primitives.gaussian import Gaussian, deviation
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from ..commands import WalkCommand
from ..footsteps import footstep, half_a_step_on, limited_step
from . import _guard_arguments as arguments
from . import _guard_kernels as kernels
from . import guard_settings as constants
from .ahead import stands_unseen
from .guard_settings import GuardConfig as GuardConfig
from .prediction import MotionPatterns
from .risk import Risk

SHOWN = 6  # steps of a plan that viewers draw


class Guard:
    """The guard of one walk; keeps the motion patterns of obstacles and the present plan."""

    def __init__(
        self, config: GuardConfig, robot: RobotModel = DARWIN_OP, cell_m: float = 0.05
    ) -> None:
        self.config, self.robot, self._cell_m = config, robot, cell_m
        self.cell_distance_m = robot.radius_m + corner_m(cell_m)
        """Distance kept between the middle of the body and that of an occupied cell, m."""
        self.patterns = MotionPatterns()
        self._present: np.ndarray | None = None  # the plan being walked
        self._last, self._last_s = WalkCommand(), -math.inf
        self._plans = _fixed_plans(config.steps, robot.gait)
        self.risk = 0.0
        """Probability of contact with what may move in the next `RISK_S` seconds, if it goes on to decide at every step."""
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
        unseen: Float[np.ndarray, "k 2"] | None = None,
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
            unseen: Middles of cells that were never seen, world frame, m; may include distant ones. None: all were seen.
        """
        self.patterns.update(obstacles)
        # after a long pause the last step was another component's
        paused = stamp_s - self._last_s > 1.5 * self.robot.gait.step_s
        ahead = half_a_step_on(Pose2(*robot.mean.tolist()), WalkCommand() if paused else self._last)
        robot = Gaussian(ahead.vector, robot.covariance)
        scene = _Scene(
            robot, obstacles, occupied, target, self.config, self.robot, stamp_s, self.patterns,
            self.cell_distance_m, unseen, self._cell_m,
        )  # fmt: skip
        self._last, self._last_s = self._safest(desired, scene), stamp_s
        return self._last

    def expected(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Obstacle]:
        """The tracks at their predicted positions, and remembered obstacles without a track; for the gaze."""
        everything = [*obstacles, *self.patterns.remembered(obstacles, stamp_s)]
        return [self.patterns.propagated(obstacle, stamp_s) for obstacle in everything]

    def _safest(self, desired: WalkCommand, scene: _Scene) -> WalkCommand:
        wish, bound = scene.walked(_desired_plans(desired, self.robot.gait)[:1]), self.config.risk
        harm, _ = scene.judge(wish)
        danger = scene.risks(wish, to_the_end=True)
        harm += constants.EXPECTED_CONTACT_M * danger
        self.word, self.risk = "guard", float(scene.risks(wish)[0])
        if harm[0] <= constants.PASS_M and self.risk <= bound:
            self._present, self.ahead = None, _shown(wish[0])
            return desired
        plans = self._candidates(desired)
        places = scene.walked(plans)
        harm, cost = scene.judge(places)
        touches = scene.touches(places)
        cost += constants.EXPECTED_CONTACT_M * touches
        if danger[0] <= bound:  # nobody to give way to
            cost += constants.EXPECTED_CONTACT_M * scene.ventures(places)
        cost[1] -= constants.KEEP_M + constants.KEEP_SHARE * harm[1]  # the present plan
        best = scene.cheapest(places, cost)
        self.risk = float(scene.risks(places[[best]])[0])
        if self.risk > bound:
            risks = scene.risks(places)
            least = float(np.min(risks, where=~touches, initial=1.0))
            keeps = ~touches & (risks <= max(bound, least + constants.SAME_RISK))
            other = scene.cheapest(places, np.where(keeps, cost, math.inf))
            later = scene.risks(places[[best, other]], to_the_end=True)
            if keeps.any() and later[1] <= later[0]:
                best, self.risk = other, float(risks[other])
        self.word = "least risk" if self.risk > bound else "guard"
        self._present, self.ahead = plans[best].copy(), _shown(places[best])
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
    """Everything that plans are judged by, as arrays for the kernels."""

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
        unseen: np.ndarray | None = None,
        cell_m: float = 0.05,
    ) -> None:
        everything = [*obstacles, *patterns.remembered(obstacles, stamp_s)]
        self._risk = Risk(robot, everything, stamp_s, config, model, patterns)
        self._gait, self._steps = model.gait, config.steps
        self._robot, self._target = robot.mean.astype(np.float64), target.astype(np.float64)
        self._cells = _cells(robot, occupied, everything, config.steps, model, cell_distance_m)
        self._body_m = model.breadth * constants.CELL_CONTACT_M
        self._cell_m = cell_m
        self._unseen = self._behind(np.zeros((0, 2)) if unseen is None else unseen)
        self._costs = arguments.Costs(constants.STEEP, constants.CONTACT_COST_M, constants.FADE_S)

    def walked(self, plans: Float[np.ndarray, "c 8"]) -> Float[np.ndarray, "c n 3"]:
        """The body in the middle and at the end of every step of the plans."""
        plans = np.ascontiguousarray(plans)
        given = self._robot, plans, self._target, self._gait.max_turn_rad, self._steps
        found: np.ndarray = kernels.walked(*given)
        return found

    def judge(
        self, places: Float[np.ndarray, "c n 3"]
    ) -> tuple[Float[np.ndarray, "c"], Float[np.ndarray, "c"]]:
        """Cost of what stands, and that cost with the way to the target, of every plan, m."""
        half_s = self._gait.step_s / 2.0
        results = kernels.judge(self._robot, places, self._target, half_s, self._cells, self._costs)
        harm = results[:, 0]
        return harm, harm + results[:, 1] + constants.HEADING_COST_M * results[:, 2]

    def risks(
        self, places: Float[np.ndarray, "c n 3"], to_the_end: bool = False
    ) -> Float[np.ndarray, "c"]:
        """Probability of contact with what may move: in the time of the bound if the robot decides anew at every step, or
        on the whole plan."""
        found = self._risk.of(places, self._robot, to_the_end)
        return found if to_the_end else constants.HAPPENS_SHARE * found

    def touches(self, places: Float[np.ndarray, "c n 3"]) -> Bool[np.ndarray, "c"]:
        """Whether every plan touches what stands in the time of the bound."""
        found: np.ndarray = kernels.touch_cells(places, 2 * self._risk.steps, self._cells)
        return found

    def ventures(self, places: Float[np.ndarray, "c n 3"]) -> Float[np.ndarray, "c"]:
        """Probability of a contact on unseen ground behind the robot in the time of the bound, of every plan, as far as it
        covers more of that ground than the first."""
        counts = kernels.covered(places, 2 * self._risk.steps, self._unseen, self._body_m)
        area = self._cell_m**2 * np.maximum(counts - counts[0], 0.0)
        found: np.ndarray = -np.expm1(-constants.UNSEEN_PER_M2 * area)
        return found

    def _behind(self, cells: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
        """The cells behind the shoulders that the body does not cover, but may in the time of the bound."""
        there = Pose2(*self._robot.tolist()).inverse().apply(cells)
        away = np.hypot(*there.T)
        reach = self._risk.steps * self._gait.step_s * self._gait.max_speed_mps + self._body_m
        return np.ascontiguousarray(
            cells[(there[:, 0] < 0.0) & (away > self._body_m) & (away <= reach)]
        )

    def cheapest(self, places: Float[np.ndarray, "c n 3"], cost: Float[np.ndarray, "c"]) -> int:
        """Number of the plan with the least expected cost: its own, and that of a contact until its end."""
        return self._risk.cheapest(places, cost, self._robot)

    def step(self, plan: np.ndarray) -> WalkCommand:
        """The first step of a plan, as the kernel makes it; a plan whose first part is over may pursue the target."""
        gait = self._gait
        begins = plan[arguments.REPEAT] > 0.0
        forward, left, turn = (plan[:3] if begins else plan[4:7]).tolist()
        if begins or plan[arguments.PURSUES] == 0.0:
            return limited_step(gait, forward / gait.step_s, left / gait.step_s, turn)
        dx, dy = (self._target - self._robot[:2]).tolist()
        if math.hypot(dx, dy) < 0.5 * forward:
            return limited_step(gait, 0.0, 0.0, 0.0)
        pose = Pose2(*self._robot.tolist())
        return footstep(math.atan2(dy, dx), forward / gait.step_s, pose, gait)


def _shown(places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """The body after each of the first steps of a plan, for viewers."""
    return places[1 : 2 * SHOWN : 2].copy()


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
    robot: Gaussian,
    occupied: Float[np.ndarray, "n 2"],
    obstacles: Sequence[Obstacle],
    steps: int,
    model: RobotModel,
    wanted_m: float,
) -> arguments.Cells:
    """What stands within reach, nearest first; the required distance is at most the present one, but for contact.

    A track that more likely stands, and that no cell shows, counts as one more cell of its size.
    """
    here = robot.mean[:2]
    corner = wanted_m - model.radius_m
    clear = np.hypot(*(occupied - here).T) > min(model.width_m, model.depth_m) / 2.0 + corner
    occupied = occupied[
        clear
    ]  # a cell that reaches under the trunk is an error, or shows what a track shows too
    stands = [one for one in obstacles if stands_unseen(one, occupied)]
    places = np.concatenate([occupied, np.array([o.position for o in stands]).reshape(-1, 2)])
    near = np.array([model.radius_m + one.radius_m for one in stands])
    P = robot.covariance[:2, :2]
    sigma = np.array([deviation(P + one.state.covariance[:2, :2]) for one in stands])
    margin = constants.STILL_MARGIN_M + np.minimum(sigma, constants.MOST_SIGMA_M)
    contact = np.full(len(occupied), model.breadth * constants.CELL_CONTACT_M)
    contact = np.concatenate([contact, near])
    wanted = np.concatenate([np.full(len(occupied), wanted_m), near + margin])
    gap = np.hypot(*(places - here).T)
    reach = steps * model.gait.step_s * model.gait.max_speed_mps
    close = np.flatnonzero(gap <= reach + wanted)
    close = close[np.argsort(gap[close], kind="stable")]
    gap, contact, wanted = gap[close], contact[close], wanted[close]
    needed = np.stack([np.clip(gap, contact, wanted), np.minimum(contact, gap)], axis=1)
    return arguments.Cells(np.ascontiguousarray(places[close], np.float64), needed)
