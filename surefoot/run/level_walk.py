"""Simulate a walk over a scene of several levels and write its run folder: a `GroundWalker` leads it, not the pipeline.

Pose by steps, gyro and the steep surfaces in view, height by the joints, a map of surfaces and footsteps: there is no floor plane,
no occupancy grid and no track in such a run, and no recording of it, which would not have the joints of the feet.

Source: ours.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mapping.io import ground_file
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from planning.footholds.foothold import Foothold
from planning.planners.mission import ON_LEVELS
from planning.planners.planner import Decision

from ..config import toml
from ..config.schema import Config
from ..results.level_truth import LevelTruth
from ..results.row_stream import PoseStream, RowStream
from ..results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from ..results.timing_log import TimingLog
from ..results.version import commit, version
from .ground_walk import FeetReading, GroundWalker
from .interrupt import stop_requested
from .summary import Say, Summary

if TYPE_CHECKING:
    from sim.scene import Scene

FOOTSTEPS, HEIGHTS = "footsteps.csv", "heights.csv"
FOOTSTEP_HEADER = ("stamp_s", "foot", "x_m", "y_m", "yaw_rad", "height_m", "missed", "unseen")
COMMAND_HEADER = (
    "stamp_s", "forward_m", "lateral_m", "turn_rad", "pan_rad", "tilt_rad", "why", "risk",
)  # fmt: skip
LEAST_RISER_M = 0.01  # ours: tops that differ by less are one level


def planned(config: Config, scene: Scene) -> Config:
    """The configuration with the planner of several levels where the scene has them.

    Raises:
        ConfigError: A setting does not go with such a walk.
    """
    mission = config.mission
    if not scene.ground and mission.planner != ON_LEVELS:
        return config
    if mission.planner not in (ON_LEVELS, "search"):
        raise ConfigError(
            f"scene {scene.name!r} has several levels, and planner {mission.planner!r} walks on one; "
            f"leave --planner out, or set it to {ON_LEVELS}"
        )
    refused = {
        "robot.body='dynamic' is not led over levels; set 'kinematic'": config.robot.body == "dynamic",
        "mission.wander needs a map of one floor; leave it out": mission.wander,
        "mission.headings_deg: it arrives with any heading; leave them out": bool(mission.headings_deg),
        "faults.inject is not noticed there; leave it out": bool(config.faults.inject),
        "moving objects are not seen there; choose a scene without": bool(scene.moving_objects),
        "it needs a depth camera; choose --robot g1": not (config.robot.tof or _has_depth_camera(config)),
    }  # fmt: skip
    for problem, holds in refused.items():
        if holds:
            raise ConfigError(f"planner {ON_LEVELS!r}: {problem}")
    steps = config.robot_model.steps
    step_m = min(steps.up_m, steps.down_m)
    tops = sorted({0.0, *(round(part.top_m, 6) for part in scene.ground)})
    risers = [b - a for a, b in itertools.pairwise(tops) if b - a > LEAST_RISER_M]
    if not min(step_m, steps.reach_m) > 0.0 or (risers and min(risers) > step_m):
        needed = (
            f"; the scene {scene.name!r} has risers of {100 * min(risers):.0f} cm" if risers else ""
        )
        raise ConfigError(
            f"robot {config.robot.model!r} steps up and down {100 * step_m:.0f} cm and {100 * steps.reach_m:.0f} cm "
            f"ahead ([steps] of its description){needed}; choose --robot g1"
        )
    return replace(config, mission=replace(mission, planner=ON_LEVELS))


def _has_depth_camera(config: Config) -> bool:
    """Whether the description of the robot has one."""
    found = config.robot.described
    return found is not None and found.sensor("depth") is not None


def walk(
    config: Config, scene: Scene, placed: Scene, start: Gaussian, folder: RunFolder, say: Say, report: bool
) -> Summary:  # fmt: skip
    """Walk to the goals of a scene, until they are reached, no step leads on, or the time is up.

    Args:
        config: As `planned` leaves it.
        scene: As the robot is told it: start and goals.
        placed: With the true start.
        start: Pose that the robot is told.
        folder: Of the run.
        say: Receives lines of progress.
        report: Write report.html.
    """
    from sim.robot import SimulatedRobot
    from sim.world import World

    goals = scene.goals[: config.mission.goals]
    reached, frames, fell_at_s, why = 0, 0, None, ""
    with contextlib.ExitStack() as stack:
        world = stack.enter_context(World(placed, config.renderer, config.seed))
        robot = stack.enter_context(SimulatedRobot(world, config.robot, config.seed))
        walker = GroundWalker(config, robot.own_body, np.array(goals[0]), start)
        tables, truth = _Tables(folder, config), LevelTruth(robot, folder)
        stopped = stack.enter_context(stop_requested())
        interrupted = False
        while world.stamp_s < config.mission.time_limit_s and not interrupted:
            frame, before = robot.read(), walker.next_foothold
            stance, asked = walker.stance, why
            truth.note(world.stamp_s)
            feet = FeetReading(robot.feet(), robot.foot_heights())
            began_s = time.thread_time()
            decision = walker.cycle(frame, feet)
            busy_ms = 1e3 * (time.thread_time() - began_s)
            frames += 1
            tables.note(frame.stamp_s, walker, feet, decision, busy_ms)
            interrupted = stopped()
            if decision is None:
                continue
            if walker.stance != stance and before is not None and asked in ("walk", "up", "down"):
                tables.landed(frame.stamp_s, walker, before)
                if not truth.landed(world.stamp_s, walker.stance, before.height_m):
                    fell_at_s = world.stamp_s
                    break
            why = decision.why
            left_m = float(np.linalg.norm(walker.goal - walker.stands[0].vector[:2]))
            say(
                f"frame {frames}, t {world.stamp_s:.1f} s, {left_m:.2f} m to the goal, {walker.stands[1]:.2f} m up"
            )
            if why == "arrived":
                reached += 1
                if reached == len(goals):
                    break
                walker.goal = np.array(goals[reached])
            elif why == "unknown":
                break
            robot.walk(decision.walk)
            robot.look(decision.gaze)
        truth.finish(placed)
        seconds = world.stamp_s
        renderer = world.renderer
    tables.finish(walker)
    notes = [f"stopped where no step led on: {why}"] if why == "unknown" else []
    notes += [] if fell_at_s is None else [f"the robot fell after {fell_at_s:.1f} s"]
    summary = Summary(
        folder.root, frames, seconds, reached=(reached, len(goals)), notes=tuple(notes),
        fell_at_s=fell_at_s, body=config.robot.body, interrupted=interrupted,
    )  # fmt: skip
    folder.write_json(
        "summary.json",
        {
            **{key: value for key, value in summary.as_dict().items() if key != "run"},
            "name": f"{scene.name}-{config.seed}", "kind": "simulation", "recording": "",
            "start": start.mean.tolist(), "start_covariance": start.covariance.tolist(),
            "goal_positions": [list(goal) for goal in goals], "landmarks": [],
            "renderer": renderer, "version": version(), "commit": commit(),
            "command": f"surefoot simulate --config {folder.path('config.toml')}",
        },
    )  # fmt: skip
    if report:
        from ..report.page import write_report
        from ..store.run_tables import write_run_tables

        write_report(folder)
        write_run_tables(folder)
    return summary


class _Tables:
    """The tables of the run."""

    def __init__(self, folder: RunFolder, config: Config) -> None:
        self._folder = folder
        self._poses = RowStream(folder, "trajectory_covariance.csv", COVARIANCE_HEADER)
        self._trajectory = PoseStream(folder, "trajectory.txt")
        self._heights = RowStream(folder, HEIGHTS, ("stamp_s", "height_m", "sigma_m"))
        self._commands = RowStream(folder, "commands.csv", COMMAND_HEADER)
        self._footsteps = RowStream(folder, FOOTSTEPS, FOOTSTEP_HEADER)
        self._timing = TimingLog(folder)
        folder.write_text("config.toml", toml.dumps(config))

    def note(
        self,
        stamp_s: float,
        walker: GroundWalker,
        feet: FeetReading,
        decision: Decision | None,
        busy_ms: float,
    ) -> None:
        """A frame."""
        pose, (height_m, sigma_m) = walker.localiser.pose, walker.height(feet)
        x, y, yaw = pose.mean.tolist()
        self._poses.append(estimate_row(stamp_s, pose))
        self._trajectory.append((stamp_s, x, y, height_m, yaw))
        self._heights.append((stamp_s, height_m, sigma_m))
        times = {} if decision is None else decision.timing_ms
        self._timing.note(stamp_s, {"total": busy_ms, **times})
        if decision is not None:
            step, gaze = decision.walk, decision.gaze
            self._commands.append(
                (stamp_s, step.forward_m, step.lateral_m, step.turn_rad, gaze.pan_rad, gaze.tilt_rad, decision.why, np.nan)
            )  # fmt: skip

    def landed(self, stamp_s: float, walker: GroundWalker, planned_hold: Foothold) -> None:
        """A foot has landed."""
        pose, height_m = walker.stands
        foot = "left" if walker.stance > 0 else "right"
        self._footsteps.append(
            (
                stamp_s,
                foot,
                pose.x,
                pose.y,
                pose.yaw,
                height_m,
                planned_hold.missed,
                planned_hold.unseen,
            )
        )

    def finish(self, walker: GroundWalker) -> None:
        """Close all tables, and write the map."""
        for table in (
            self._poses,
            self._trajectory,
            self._heights,
            self._commands,
            self._footsteps,
        ):
            table.close()
        self._timing.close()
        pose, height_m = walker.stands
        content = ground_file.entries(walker.surfaces, pose)
        self._folder.write_json(ground_file.NAME, {**content, "body_height_m": height_m})
