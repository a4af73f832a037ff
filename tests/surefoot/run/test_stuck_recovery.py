"""Recovery when stuck: the robot scans, and passes gaps that are too narrow for a disc."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.estimate import Estimate
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.commands import GazeCommand, WalkCommand
from planning.planners import stuck_recovery
from planning.planners.avoidance_planner import Look
from planning.planners.depth_loss_fallback import DepthLossFallback
from planning.planners.mission import MissionConfig
from planning.planners.planner import Decision
from planning.planners.settings import PlanningConfig
from planning.planners.stuck_recovery import RECOVERY, StuckRecovery
from planning.world_model import WorldModel
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate
from surefoot.run.simulate import make_planner

CONFIG = replace(Config(), mission=MissionConfig(time_limit_s=90.0))
SLOT = """
extent = [0, 0, 2.9, 2.4]
start = [0.5, 1.2, 0]
goals = [[2.1, 1.2]]
[[box]]
name = "left"
at = [1.5, 1.79]
size = [0.24, 1.18, 0.32]
[[box]]
name = "right"
at = [1.5, 0.47]
size = [0.24, 0.94, 0.32]
"""


class Constant:
    """A planner that always asks for the same step."""

    reached = 0

    def __init__(self, walk: WalkCommand) -> None:
        self.walk = walk

    def observe(self, world: WorldModel) -> None:
        """Nothing."""

    def decide(self, world: WorldModel) -> Decision:
        return Decision(self.walk, GazeCommand(), "walk")

    def distance_to_goal(self, world: WorldModel) -> float:
        return 1.0

    def finished(self, world: WorldModel) -> bool:
        return False


def seen(stamp_s, *obstacles):
    """A localised robot with tracks."""
    pose = Gaussian(np.zeros(3), np.eye(3) * 1e-4)
    return WorldModel(Estimate(stamp_s, pose, obstacles=obstacles))


def mover(x, y):
    return Obstacle(Gaussian(np.array([x, y, -0.05, 0.0]), np.eye(4) * 1e-4), 0.1, moving=0.9)


def words(walk, obstacles=lambda stamp: (), steps=10):
    """Why each step was made, one every 0.65 s."""
    planner = StuckRecovery(Constant(walk), CONFIG.planning, ((2.0, 0.0),))
    stamps = 0.65 * np.arange(steps)
    return [
        planner.decide(seen(t, *obstacles(t))).why.startswith(RECOVERY) for t in stamps.tolist()
    ]


def test_a_robot_that_has_stood_for_three_seconds_scans():
    assert words(WalkCommand()) == [False] * 6 + [True] * 4


@pytest.mark.parametrize("walk", [WalkCommand(0.02, 0.0, 0.0), WalkCommand(0.0, 0.0, 0.2)])
def test_a_robot_that_walks_or_turns_is_not_stuck(walk):
    assert not any(words(walk))


def test_a_robot_that_waits_for_a_moving_obstacle_is_not_stuck():
    assert not any(words(WalkCommand(), lambda t: (mover(0.8, 0.3),)))


def test_a_scan_ends_when_a_moving_obstacle_comes_near():
    found = words(WalkCommand(), lambda t: (mover(0.8, 0.3),) if t > 5.0 else ())
    assert found == [False] * 6 + [True] * 2 + [False] * 2


class NeverThrough:
    """A manoeuvre whose passage is always found blocked: three steps of scan, five of passage, in turns."""

    active = True

    def __init__(self, config: PlanningConfig, goals: tuple[tuple[float, float], ...]) -> None:
        self.steps, self.looks = 0, []

    @property
    def looking(self) -> bool:
        return self.steps % 8 < 3

    def look_about(self) -> None:
        """It scans anyway."""

    def decide(self, world: WorldModel) -> Decision:
        self.steps += 1
        self.looks += [object.__new__(Look)] if self.steps % 8 == 3 else []
        return Decision(WalkCommand(), GazeCommand(), "scan" if self.looking else "SF")


def test_a_recovery_that_finds_no_passage_ends_after_two_scans(monkeypatch):
    monkeypatch.setattr(stuck_recovery, "AvoidancePlanner", NeverThrough)
    found = words(WalkCommand(), steps=6 + 16 + 45)
    assert found == [False] * 6 + [True] * 16 + [False] * 45  # 30 s of the planner follow


@pytest.mark.parametrize(
    ("change", "expected"),
    [({}, True), ({"look_about": False}, False), ({"planner": "field"}, False)],
)
def test_the_search_planner_has_the_recovery_unless_it_is_switched_off(change, expected):
    planner = make_planner(
        replace(CONFIG, mission=replace(CONFIG.mission, **change)), ((1.0, 0.0),)
    )
    assert isinstance(planner, DepthLossFallback)
    assert isinstance(planner._planner, StuckRecovery) is expected


def test_a_slot_narrower_than_the_searched_disc_is_passed_sideways(tmp_path):
    """From wall to wall two cartons, 26 cm apart: the search keeps 16 cm to each side of its middle.

    Seeds 0, 1 and 2 arrive after 103, 98 and 107 s.
    """
    scene = tmp_path / "slot.toml"
    scene.write_text(SLOT)
    config = replace(
        CONFIG,
        scene=str(scene),
        seed=0,
        mission=MissionConfig(time_limit_s=150.0),
        robot=replace(CONFIG.robot, stereo=False, colour=False, tof_source="rays"),
    )
    simulate.simulate(config, tmp_path / "run", False, lambda text: None)
    run = RunFolder.open(tmp_path / "run")
    found = evaluate(run)
    assert found["contacts"] == 0
    assert found["min_clearance_m"] > 0.01
    way = run.read_trajectory("truth/trajectory.txt")
    assert way is not None
    assert way.positions[-1, 0] > 1.8  # beyond the cartons
    made = run.read_csv("commands.csv")
    assert made is not None
    assert any(word.startswith(RECOVERY) for word in made.words("why"))
