"""A gaze policy of your own: look at the nearest moving obstacle, else left and right of the path by turns.

surefoot simulate home --gaze examples.my_gaze:NearestFirst
surefoot experiment INT-2 --seeds 2 --gaze examples.my_gaze:NearestFirst
"""

import math

from surefoot import GazeCommand

SIDE_RAD, TILT_RAD = math.radians(30.0), math.radians(28.0)


class NearestFirst:
    def __init__(self, config, robot):  # GazeConfig, and the RobotModel with the limits of its head
        self.most = math.radians(robot.head.pan_deg)
        self.side = SIDE_RAD

    def next(self, stamp_s, robot, via, obstacles, known=None):  # once a footstep; world frame, m
        targets = [o.position for o in obstacles if o.moving > 0.3]
        if targets:
            targets = [robot.inverse().apply(target) for target in targets]  # body frame
            x, y = min(targets, key=lambda target: math.hypot(*target))
            pan = math.atan2(y, x)
        else:
            x, y = robot.inverse().apply(via)
            self.side = -self.side
            pan = math.atan2(y, x) + self.side
        return GazeCommand(max(-self.most, min(pan, self.most)), TILT_RAD)
