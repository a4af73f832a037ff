"""Covariances of contact points, velocities and predicted contact points, from errors of pixels and camera pose.

The ray of a pixel meets the floor at P = c + d, with c the camera centre and d the vector from it to the floor. If
the ray changes by dr, because the pixel is displaced or the camera rotates by a small w (dr = w x d) or rises, then
P moves along the floor by dP = dr - (d_xy / d_z) dr_z. The error of the camera pose is common to all pixels of one
picture. The two pictures of a pair share half of its variance, the offsets of the joints; the texture of the floor ties
them closer (`pair_pose`).

Source: ours; floor points are those of seed 000, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .back_projection import floor_points, viewing_direction
from .result import Flows, Picture

UNKNOWN_SPEED_MPS = 0.08
"""Ours: standard deviation of the speed where no flow was measured; robots in the scenes have 0.06 to 0.10."""


@dataclass(frozen=True)
class CameraNoise:
    """Standard deviations of the camera pose given by the joints, and of edge pixels."""

    pitch_deg: float = 0.7  # walking trials
    yaw_deg: float = 0.5  # walking trials
    roll_deg: float = 0.7  # walking trials
    height_m: float = 0.004  # walking trials
    edge_px: float = 1.0  # ours

    def __post_init__(self) -> None:
        for name in ("pitch_deg", "yaw_deg", "roll_deg", "height_m", "edge_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"camera noise: {name}={value} must be finite and not negative")

    @property
    def pose_covariance(self) -> Float[np.ndarray, "4 4"]:
        """Covariance of pitch, yaw and roll, rad, and height, m."""
        angles = [math.radians(v) for v in (self.pitch_deg, self.yaw_deg, self.roll_deg)]
        return np.diag(np.square([*angles, self.height_m]))


def pose_jacobian(
    places: Float[np.ndarray, "n 2"], T_world_camera: Pose3
) -> Float[np.ndarray, "n 2 4"]:
    """Derivatives of floor points, m, with respect to pitch (down), yaw (left), roll (right), rad, and height, m.

    The axes of pitch and roll are horizontal: to the left of the viewing direction, and along it.
    """
    c = T_world_camera.position
    x, y = viewing_direction(T_world_camera)
    axes = np.array([[-y, x, 0.0], [0.0, 0.0, 1.0], [x, y, 0.0]])
    down = np.concatenate([places - c[:2], np.full((len(places), 1), -c[2])], axis=1)
    turned = np.cross(axes[None], down[:, None])
    moved = turned[..., :2] + (down[:, None, :2] / c[2]) * turned[..., 2:]
    raised = down[:, None, :2] / c[2]
    return np.concatenate([moved, raised], axis=1).transpose(0, 2, 1)


def pixel_jacobian(
    pixels: Float[np.ndarray, "n 2"],
    places: Float[np.ndarray, "n 2"],
    camera: Camera,
    T_world_camera: Pose3,
) -> Float[np.ndarray, "n 2 2"]:
    """Derivatives of the floor points of pixels with respect to (u, v), m per px."""
    c, R = T_world_camera.position, T_world_camera.rotation
    down = np.concatenate([places - c[:2], np.full((len(places), 1), -c[2])], axis=1)
    ones, columns = np.ones(len(pixels)), []
    for step in np.eye(2) / 2:
        ray = camera.back_project(pixels + step, ones) - camera.back_project(pixels - step, ones)
        off = (down @ R[:, 2])[:, None] * (ray @ R.T)
        columns.append(off[:, :2] + (down[:, :2] / c[2]) * off[:, 2:])
    return np.stack(columns, axis=-1)


COMMON = 0.5  # walking trials: of the variance of 0.7 deg, 0.5 deg of sway are half; the rest are offsets of joints
STATES = 10
"""Errors of the poses of a pair: pitch, yaw, roll, rad, and height, m, of the previous and of the current camera, as in
`pose_jacobian`, and the displacement (x, y) of the previous camera, world frame, m."""


def prior_covariance(current: Picture, noise: CameraNoise) -> Float[np.ndarray, "10 10"]:
    """Covariance of the errors of a pair whose poses are given by joints.

    Offsets of joints are common to both pictures. A trunk that sways about its feet displaces the camera by its height
    times the angle, in each picture.
    """
    E = noise.pose_covariance
    tilt = max(E[0, 0], E[2, 2])
    P = np.zeros((STATES, STATES))
    P[:8, :8] = np.kron([[1.0, COMMON], [COMMON, 1.0]], E)
    P[8:, 8:] = 2.0 * tilt * current.T_world_camera.translation[2] ** 2 * np.eye(2)
    return P


@dataclass(frozen=True, eq=False)
class CovarianceModel:
    """Error propagation of one cycle.

    Args:
        previous: None in a cycle without optical flow.
        current: Picture in which the obstacles are seen.
        horizon_s: Time from `current` to the prediction, s.
        errors: Covariance of the errors of the pair's poses, see `STATES`.
        edge_px: Standard deviation of edge pixels.
    """

    previous: Picture | None
    current: Picture
    horizon_s: float
    errors: Float[np.ndarray, "10 10"]
    edge_px: float

    def of_obstacle(
        self,
        edge: Float[np.ndarray, "m 2"],
        contact: Float[np.ndarray, "m 2"],
        flows: Flows,
        flow: int,
        velocity: Float[np.ndarray, "2"],
        measured: Float[np.ndarray, "k 2"],
    ) -> tuple[Float[np.ndarray, "m 2 2"], Float[np.ndarray, "2 2"], Float[np.ndarray, "m 2 2"]]:
        """Covariances of each contact point, m^2, of the velocity, (m/s)^2, and of each predicted contact point, m^2.

        Args:
            edge, contact: Pixels, and their floor points, m.
            flows, flow: All flows, and the index of the one that gives the velocity; -1 for none.
            velocity: The estimated velocity, m/s.
            measured: Velocities of the obstacle's corners, m/s. Their mean square deviation from `velocity` is
                added to its covariance: it covers corners that disagree, and a measured speed below the threshold.
        """
        current, horizon, E = self.current, self.horizon_s, self.errors
        by_pose = pose_jacobian(contact, current.T_world_camera)
        px = pixel_jacobian(edge, contact, current.camera, current.T_world_camera)
        of_edge = self.edge_px**2 * px @ px.transpose(0, 2, 1)
        P_contact = of_edge + by_pose @ E[4:8, 4:8] @ by_pose.transpose(0, 2, 1)
        residuals = measured - velocity
        spread = residuals.T @ residuals / max(len(measured), 1)
        if flow < 0:
            P_velocity = UNKNOWN_SPEED_MPS**2 * np.eye(2) + spread
            return P_contact, P_velocity, P_contact + horizon**2 * P_velocity
        by_error, own = self._of_flows(flows, np.array([flow]))
        P_velocity = by_error[0] @ E @ by_error[0].T + own[0] + spread
        shared = by_pose @ E[4:8] @ by_error[0].T  # edge and corner share a pose
        P_predicted = P_contact + horizon**2 * P_velocity
        return P_contact, P_velocity, P_predicted + horizon * (shared + shared.transpose(0, 2, 1))

    def of_flows(self, flows: Flows) -> Float[np.ndarray, "n 2 2"]:
        """Covariance of the velocity of each flow, (m/s)^2; NaN above the horizon."""
        by_error, own = self._of_flows(flows, np.arange(len(flows)))
        return np.asarray(by_error @ self.errors @ by_error.transpose(0, 2, 1) + own)

    def _of_flows(
        self, flows: Flows, which: Int[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "n 2 10"], Float[np.ndarray, "n 2 2"]]:
        """Derivatives of the velocities of some flows with respect to the errors, and covariances by their pixels."""
        previous, current = self.previous, self.current
        assert previous is not None, "flows have a previous picture"
        by_error = np.zeros((len(which), 2, STATES))
        by_error[..., 8:] = -np.eye(2)
        sides = ((flows.previous, previous, 0, -1.0), (flows.current, current, 4, 1.0))
        for pixels, picture, first, sign in sides:
            pose = picture.T_world_camera
            place = floor_points(pixels[which], picture.camera, pose, math.inf)
            by_error[..., first : first + 4] = sign * pose_jacobian(place, pose)
        px = pixel_jacobian(flows.current[which], place, current.camera, pose)
        seconds = current.stamp_s - previous.stamp_s
        own = px @ flows.covariance[which] @ px.transpose(0, 2, 1)
        return by_error / seconds, own / seconds**2
