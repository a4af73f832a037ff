"""A planner of your own: straight to the goal, standing still while something is in the way.

surefoot simulate empty_room --planner examples.my_planner:WalkStraight    # arrives after a minute
surefoot simulate boxes --planner examples.my_planner:WalkStraight         # stands before a box: "blocked"
surefoot experiment INT-4 --seeds 4 --planner examples.my_planner:WalkStraight
"""

import numpy as np

from planning.footsteps import footstep
from planning.planners.goals import Goals, GoalSeeker
from surefoot import Decision, GazeCommand, WalkCommand


class WalkStraight(GoalSeeker):  # GoalSeeker counts the goals and ends the walk
    def __init__(self, config, goals):  # PlanningConfig, and (x, y) in m
        super().__init__(Goals(goals, config.mission))
        self.gait = config.robot.gait

    def observe(self, world):  # every frame: nothing to keep
        pass

    def decide(self, world):  # once a footstep: world is a surefoot.WorldModel
        goal, ahead = self.goal, GazeCommand(pan_rad=0.0, tilt_rad=0.5)
        if goal is None or world.pose is None or world.grid is None:
            return Decision(WalkCommand(), ahead, "wait")
        robot, grid = world.pose2, world.grid
        occupied = grid.centres()[grid.known & (grid.probability > 0.7)]
        x, y = robot.inverse().apply(occupied).T  # in the body frame, m
        blocked = np.any((x > 0.0) & (x < 0.4) & (np.abs(y) < 0.15))
        heading = np.arctan2(goal[1] - robot.y, goal[0] - robot.x)
        speed = 0.0 if blocked else self.gait.cruise_mps
        walk = footstep(heading, speed, robot, self.gait)
        return Decision(walk, ahead, "blocked" if blocked else "walk")
