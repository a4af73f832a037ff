"""Covariances of contact points, velocities and predicted contact points, from errors of pixels and camera pose.

The ray of a pixel meets the floor at P = c + d, with c the camera centre and d the vector from it to the floor. If
the ray changes by dr, because the pixel is displaced or the camera rotates by a small w (dr = w x d) or rises, then
P moves along the floor by dP = dr - (d_xy / d_z) dr_z. The error of the camera pose is common to all pixels of one
picture and independent between pictures.

Source: ours; floor points are those of seed 000, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .back_projection import floor_points, viewing_direction
from .flow import CORNER_SIGMA_PX
from .result import Flows, Picture

UNKNOWN_SPEED_MPS = (
    0.08  # ours: sigma of a speed without flow; robots in the scenes have 0.06 to 0.10
)


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


@dataclass(frozen=True, eq=False)
class CovarianceModel:
    """Error propagation of one cycle.

    Args:
        previous: None in a cycle without optical flow.
        current: Picture in which the obstacles are seen.
        horizon_s: Time from `current` to the prediction, s.
        noise: Errors of camera pose and edge pixels.
    """

    previous: Picture | None
    current: Picture
    horizon_s: float
    noise: CameraNoise

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
        current, noise, horizon = self.current, self.noise, self.horizon_s
        E = noise.pose_covariance
        by_pose = pose_jacobian(contact, current.T_world_camera)
        px = pixel_jacobian(edge, contact, current.camera, current.T_world_camera)
        of_edge = noise.edge_px**2 * px @ px.transpose(0, 2, 1)
        P_contact = of_edge + by_pose @ E @ by_pose.transpose(0, 2, 1)
        residuals = measured - velocity
        spread = residuals.T @ residuals / max(len(measured), 1)
        if flow < 0 or self.previous is None:
            P_velocity = UNKNOWN_SPEED_MPS**2 * np.eye(2) + spread
            return P_contact, P_velocity, P_contact + horizon**2 * P_velocity
        seconds = current.stamp_s - self.previous.stamp_s
        now, of_flow = self._of_flow(flows, flow, seconds)
        own = of_flow + spread
        P_velocity = now @ E @ now.T + own
        both = by_pose + horizon * now  # edge and corner share the error of the current camera pose
        predicted = of_edge + both @ E @ both.transpose(0, 2, 1) + horizon**2 * own
        return P_contact, P_velocity, predicted

    def _of_flow(
        self, flows: Flows, flow: int, seconds: float
    ) -> tuple[Float[np.ndarray, "2 4"], Float[np.ndarray, "2 2"]]:
        """Jacobian of a flow's velocity by the current camera pose, and its covariance by pixel and previous pose."""
        assert self.previous is not None
        ends = []
        for pixels, picture in ((flows.previous, self.previous), (flows.current, self.current)):
            pixel, pose = pixels[flow : flow + 1], picture.T_world_camera
            place = floor_points(pixel, picture.camera, pose, math.inf)
            px = pixel_jacobian(pixel, place, picture.camera, pose)[0]
            ends.append((pose_jacobian(place, pose)[0] / seconds, px * CORNER_SIGMA_PX / seconds))
        (before, _), (now, px) = ends
        return now, px @ px.T + before @ self.noise.pose_covariance @ before.T
