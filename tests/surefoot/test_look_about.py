"""Where the search finds no way the robot looks about, and slips through what a disc cannot pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.commands import GazeCommand, WalkCommand
from planning.planners.mission import MissionConfig
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.fallback import Fallback
from surefoot.look_about import WORD, LookAbout
from surefoot.planners import Decision, make
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate
from surefoot.run.pipeline import Pipeline

CONFIG = replace(Config(), mission=MissionConfig(time_limit_s=90.0))
SLOT = """
extent = [0, 0, 2.9, 2.4]
start = [0.5, 1.2, 0]
goals = [[2.4, 1.2]]
[[box]]
name = "left"
at = [1.5, 1.79]
size = [0.24, 1.18, 0.32]
[[box]]
name = "right"
at = [1.5, 0.47]
size = [0.24, 0.94, 0.32]
"""


class Told:
    """A planner that always asks for the same step."""

    reached = 0

    def __init__(self, walk: WalkCommand) -> None:
        self.walk = walk

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Nothing."""

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        return Decision(self.walk, GazeCommand(), "walk")

    def distance_to_goal(self, estimate: Estimate) -> float:
        return 1.0

    def finished(self, estimate: Estimate) -> bool:
        return False


def seen(stamp_s, *obstacles):
    """Somebody who knows where it is and sees something."""
    pose = Gaussian(np.zeros(3), np.eye(3) * 1e-4)
    return Estimate(stamp_s, pose, (), (), obstacles, None)


def mover(x, y):
    return Obstacle(Gaussian(np.array([x, y, -0.05, 0.0]), np.eye(4) * 1e-4), 0.1, moving=0.9)


def words(walk, obstacles=lambda stamp: (), steps=10):
    """Why each step was made, one every 0.65 s."""
    planner = LookAbout(Told(walk), CONFIG, ((2.0, 0.0),))
    pipeline = Pipeline(CONFIG, RecordingInfo("none", "simulation"))
    stamps = 0.65 * np.arange(steps)
    return [
        planner.decide(Frame(t), seen(t, *obstacles(t)), pipeline).why.startswith(WORD)
        for t in stamps.tolist()
    ]


def test_who_has_stood_for_three_seconds_looks_about():
    assert words(WalkCommand()) == [False] * 6 + [True] * 4


@pytest.mark.parametrize("walk", [WalkCommand(0.02, 0.0, 0.0), WalkCommand(0.0, 0.0, 0.2)])
def test_who_walks_or_turns_is_not_stuck(walk):
    assert not any(words(walk))


def test_who_lets_somebody_by_is_not_stuck():
    assert not any(words(WalkCommand(), lambda t: (mover(0.8, 0.3),)))


def test_looking_about_ends_when_something_comes_near():
    found = words(WalkCommand(), lambda t: (mover(0.8, 0.3),) if t > 5.0 else ())
    assert found == [False] * 6 + [True] * 2 + [False] * 2


@pytest.mark.parametrize(
    ("change", "expected"),
    [({}, True), ({"look_about": False}, False), ({"planner": "field"}, False)],
)
def test_the_joint_stack_looks_about_unless_told_not_to(change, expected):
    planner = make(replace(CONFIG, mission=replace(CONFIG.mission, **change)), ((1.0, 0.0),))
    assert isinstance(planner, Fallback)
    assert isinstance(planner._planner, LookAbout) is expected


def test_a_slot_narrower_than_the_searched_disc_is_passed_sideways(tmp_path):
    """From wall to wall two cartons, 26 cm apart: the search keeps 16 cm to each side of its middle."""
    scene = tmp_path / "slot.toml"
    scene.write_text(SLOT)
    config = replace(CONFIG, scene=str(scene), robot=replace(CONFIG.robot, stereo=False))
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
    assert any(word.startswith(WORD) for word in made.words("why"))
