"""How sure a place on the floor is that one camera saw: pixels are coarse, and a walking trunk trembles.

A pixel's ray meets the floor at P = c + d, with c the eye and d the way down. A ray that is off by dr, or an eye
turned by a small w (then dr = w x d) or raised, moves P along the floor by dr less what keeps it on the floor:
dP = dr - (d_xy / d_z) dr_z. The eye's error is one for all pixels of a picture, and another in the next picture.

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
from .back_projection import ahead_of, floor_points
from .result import Flows, Picture


@dataclass(frozen=True)
class DeviationConfig:
    """Deviations of the eye from where joints have it, and of pixels from where they belong."""

    pitch_deg: float = 0.7  # walking trials
    yaw_deg: float = 0.5  # walking trials
    roll_deg: float = 0.7  # walking trials
    height_m: float = 0.004  # walking trials: of the eye
    edge_px: float = 1.0  # ours: of a contact edge
    unseen_mps: float = (
        0.08  # ours: of a speed that no flow tells; robots to be met have 0.06 to 0.10
    )

    def __post_init__(self) -> None:
        for name in ("pitch_deg", "yaw_deg", "roll_deg", "height_m", "edge_px", "unseen_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"deviations: {name}={value} must be finite and not negative")

    @property
    def eye_covariance(self) -> Float[np.ndarray, "4 4"]:
        """Of pitch, yaw and roll, rad, and height, m."""
        angles = [math.radians(v) for v in (self.pitch_deg, self.yaw_deg, self.roll_deg)]
        return np.diag(np.square([*angles, self.height_m]))


def eye_jacobian(
    places: Float[np.ndarray, "n 2"], T_world_camera: Pose3
) -> Float[np.ndarray, "n 2 4"]:
    """How places on the floor, m, move with the eye: per rad of pitch (down), yaw (left), roll (right), per m of height.

    Pitch and roll are about level axes, to the left of and along where the camera looks, as a trunk sways.
    """
    c = T_world_camera.position
    x, y = ahead_of(T_world_camera)
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
    """How the places on the floor, m, of pixels (u, v) move with the pixel, m per px."""
    c, R = T_world_camera.position, T_world_camera.rotation
    down = np.concatenate([places - c[:2], np.full((len(places), 1), -c[2])], axis=1)
    ones, columns = np.ones(len(pixels)), []
    for step in np.eye(2) / 2:
        ray = camera.back_project(pixels + step, ones) - camera.back_project(pixels - step, ones)
        off = (down @ R[:, 2])[:, None] * (ray @ R.T)
        columns.append(off[:, :2] + (down[:, :2] / c[2]) * off[:, 2:])
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class Sureness:
    """Covariances of one cycle.

    Args:
        previous: None in a cycle without a partner.
        current: Picture the obstacles are seen in.
        horizon_s: How far ahead the prediction looks.
        noise_px: Deviation to which corners are followed.
        config: Deviations of eye and edge.
    """

    previous: Picture | None
    current: Picture
    horizon_s: float
    noise_px: float
    config: DeviationConfig

    def of_obstacle(
        self,
        edge: Float[np.ndarray, "m 2"],
        contact: Float[np.ndarray, "m 2"],
        flows: Flows,
        flow: int,
        told: Float[np.ndarray, "2"],
        said: Float[np.ndarray, "k 2"],
    ) -> tuple[Float[np.ndarray, "m 2 2"], Float[np.ndarray, "2 2"], Float[np.ndarray, "m 2 2"]]:
        """Covariance of each contact, m^2, of the velocity, (m/s)^2, and of each predicted contact, m^2.

        Args:
            edge, contact: Pixels and the places on the floor they stand for, m.
            flows, flow: All of them, and which one tells the velocity; -1 for none.
            told: The velocity that is told, m/s.
            said: What each corner of the obstacle says of it, m/s, `flow` among them, or what those too fast to be
                taken say: what they say otherwise than told is error as well, of a speed that is not believed and
                of corners that do not agree.
        """
        current, config, horizon = self.current, self.config, self.horizon_s
        E = config.eye_covariance
        of_eye = eye_jacobian(contact, current.T_world_camera)
        px = pixel_jacobian(edge, contact, current.camera, current.T_world_camera)
        of_edge = config.edge_px**2 * px @ px.transpose(0, 2, 1)
        seen = of_edge + of_eye @ E @ of_eye.transpose(0, 2, 1)
        otherwise = said - told
        doubt = otherwise.T @ otherwise / max(len(said), 1)
        if flow < 0 or self.previous is None:
            velocity = config.unseen_mps**2 * np.eye(2) + doubt
            return seen, velocity, seen + horizon**2 * velocity
        seconds = current.stamp_s - self.previous.stamp_s
        now, of_flow = self._of_flow(flows, flow, seconds)
        own = of_flow + doubt
        velocity = now @ E @ now.T + own
        both = of_eye + horizon * now  # one eye sees the edge and the corner
        predicted = of_edge + both @ E @ both.transpose(0, 2, 1) + horizon**2 * own
        return seen, velocity, predicted

    def _of_flow(
        self, flows: Flows, flow: int, seconds: float
    ) -> tuple[Float[np.ndarray, "2 4"], Float[np.ndarray, "2 2"]]:
        """How the velocity of a flow moves with the current eye, and its covariance by pixel and previous eye."""
        assert self.previous is not None
        ends = []
        for pixels, picture in ((flows.previous, self.previous), (flows.current, self.current)):
            pixel, pose = pixels[flow : flow + 1], picture.T_world_camera
            place = floor_points(pixel, picture.camera, pose, math.inf)
            px = pixel_jacobian(pixel, place, picture.camera, pose)[0]
            ends.append((eye_jacobian(place, pose)[0] / seconds, px * self.noise_px / seconds))
        (before, _), (now, px) = ends
        return now, px @ px.T + before @ self.config.eye_covariance @ before.T
