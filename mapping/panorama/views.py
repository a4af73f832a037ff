"""Views: the input of a panorama. Each has a depth image, grey images for features, and a prior pose.

Angles of the panorama refer to the base frame: the body frame for a standing robot, the world frame for views
taken while walking, or the camera frame of the first view if no pose is known. The prior comes from the
joint encoders and the localisation; without it the views are placed by their content alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from perception.features.pictures import amplitude_picture, range_picture
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting


@dataclass(frozen=True)
class View:
    """One view.

    Args:
        depth: Depth with sigma; the prior replaces its `T_body_camera`.
        pictures: Grey images of the same pixels: range, amplitude, or colour as grey.
        prior: T_base_camera by encoders and localisation; None if unknown.
        stamp_s: Time of the view, s.
        grey: Amplitude, or colour as grey, of the same pixels, for the alignment of whole images; None without it.
    """

    depth: Depth
    pictures: tuple[UInt8[np.ndarray, "h w"], ...]
    prior: Pose3 | None = None
    stamp_s: float = 0.0
    grey: UInt8[np.ndarray, "h w"] | None = None

    def __post_init__(self) -> None:
        for picture in self.pictures:
            if picture.shape != self.depth.z.shape:
                raise InputError(
                    f"view: picture of {picture.shape} px for depth of {self.depth.z.shape}; "
                    "give pictures of the same pixels"
                )


YAWS_DEG = (-60.0, -30.0, 0.0, 30.0, 60.0)
PITCHES_DEG = (-17.0, 17.0)
OTHER_DEG = 0.1  # ours: standard deviation of roll, and of gear play about any axis


def head_directions() -> list[tuple[float, float]]:
    """(pan, tilt) of the head for the nine views, rad, left and down positive as in `head_rotation`.

    All key yaws at level, and two views above and two below between them.

    Source: seed 004, section 4 (key yaw -60 to 60 by 30 deg, key pitch -17, 0, 17 deg; nine views).
    """
    wanted = [(yaw, 0.0) for yaw in YAWS_DEG]
    wanted += [(yaw, pitch) for pitch in PITCHES_DEG for yaw in (-30.0, 30.0)]
    return [(-math.radians(yaw), -math.radians(pitch)) for yaw, pitch in wanted]


@dataclass(frozen=True)
class PriorConfig:
    """Standard deviations of the prior pose."""

    pan_deg: float = setting(
        0.5, "deg", "standard deviation of the pan encoder", "seed 004 as specified"
    )
    tilt_deg: float = setting(
        0.5, "deg", "standard deviation of the tilt encoder", "seed 004 as specified"
    )
    position_m: float = 0.005  # ours: neck and lever arm, while standing

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"prior: {name}={getattr(self, name)} must be positive")


def prior_covariance(prior: Pose3, config: PriorConfig) -> Float[np.ndarray, "6 6"]:
    """Covariance of a prior pose: rotation (rad^2), then translation (m^2), both in the camera's axes.

    A pan error rotates about the vertical of the base, a tilt error about the x axis of the camera, and both together
    by half their product about the axis across.
    """
    upright = prior.rotation.T[:, 2]
    horizontal = np.array([1.0, 0.0, 0.0])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = (
        math.radians(config.pan_deg) ** 2 * np.outer(upright, upright)
        + math.radians(config.tilt_deg) ** 2 * np.outer(horizontal, horizontal)
        + math.radians(OTHER_DEG) ** 2 * np.eye(3)
    )
    across = (
        math.radians(config.pan_deg)
        * math.radians(config.tilt_deg)
        / 2.0
        * np.cross(upright, horizontal)
    )
    covariance[:3, :3] += np.outer(across, across)
    covariance[3:, 3:] = config.position_m**2 * np.eye(3)
    return covariance


def view_of_depth(
    depth: Depth,
    farthest_m: float,
    picture: UInt8[np.ndarray, "h w"] | None = None,
    prior: Pose3 | None = None,
    stamp_s: float = 0.0,
) -> View:
    """A view with its range as a grey image, and another image: the given one, or the amplitude.

    Args:
        depth: Depth of any sensor.
        farthest_m: Range that is white in the range image, m.
        picture: Colour as grey, of the same pixels; None: the amplitude, if the depth has one.
        prior: T_base_camera.
        stamp_s: Time of the view, s.
    """
    visible = range_picture(depth.z, farthest_m)
    if picture is None and depth.amplitude is not None:
        picture = amplitude_picture(depth.amplitude)
    pictures = (visible,) if picture is None else (visible, picture)
    return View(depth, pictures, prior, stamp_s, picture)
