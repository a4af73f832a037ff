"""A motion model of your own for tracked obstacles: a Kalman filter at constant velocity, in world axes.

    surefoot process data/walk --set tracker.motion_model=examples.my_motion_model:ConstantVelocity

The tracker makes one for every new obstacle. Unlike ours it takes the robot's pose as exact.
"""

import numpy as np

from surefoot import Gaussian, Innovation, Pose2

ACCELERATION_MPS2 = 0.008
H = np.eye(2, 4)  # the position of (x, y, vx, vy) is measured


class ConstantVelocity:
    def __init__(self, seen, robot, config):  # Detection, Gaussian over (x, y, yaw), TrackConfig
        self.config = config
        self.robot = Pose2(*robot.mean)
        self.radius_m, self.height_m = seen.radius_m, seen.height_m
        self.x = np.array([*self.robot.apply(seen.position), 0.0, 0.0])
        self.P = np.zeros((4, 4))
        self.P[:2, :2] = self._turned(seen.covariance)
        self.P[2:, 2:] = np.eye(2) * config.speed_sigma_mps**2

    @property
    def state(self):
        """What is reported, over (x, y, vx, vy)."""
        return Gaussian(self.x.copy(), self.P.copy())

    motion = None  # the state has only one hypothesis

    @property
    def moving(self):
        """Probability of moving: how surely the speed is not 0."""
        square = self.x[2:] @ np.linalg.solve(self.P[2:, 2:], self.x[2:])
        return 1.0 - float(np.exp(-0.5 * square))

    def predict(self, dt, robot):
        """Advance dt seconds; the robot is now there."""
        self.robot = Pose2(*robot.mean)
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.vstack([np.eye(2) * dt**2 / 2.0, np.eye(2) * dt])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + G @ G.T * ACCELERATION_MPS2**2

    def density(self, positions, covariances):
        """How likely each detection is of this obstacle, per square metre."""
        errors = self.robot.apply(positions) - self.x[:2]
        S = self._turned(covariances) + self.P[:2, :2]
        square = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(S), errors)
        return np.exp(-0.5 * square) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))

    def update(self, seen):
        """Take in a detection, body frame."""
        S = self.P[:2, :2] + self._turned(seen.covariance)
        error = self.robot.apply(seen.position) - self.x[:2]
        gain = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + gain @ error
        self.P = (np.eye(4) - gain @ H) @ self.P
        self.radius_m = max(self.radius_m, seen.radius_m)
        self.height_m = max(self.height_m, seen.height_m)
        return Innovation(None, np.linalg.solve(np.linalg.cholesky(S), error))

    def _turned(self, covariance):
        R = self.robot.rotation
        return R @ covariance @ R.T
