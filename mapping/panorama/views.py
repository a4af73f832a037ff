"""What a panorama is made of: views, each with a depth image, a picture to find features in, and a prior.

The base frame is the one in which the panorama's angles are told: the body frame while standing, the
world frame for views taken while walking, the first view's own camera frame where nobody knows better.
The prior is where the joints (and the localiser) say the camera was; without one the views alone must do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from perception.features.pictures import range_picture
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3


@dataclass(frozen=True)
class View:
    """One view of the surroundings.

    Args:
        depth: With its sigma; its `T_body_camera` is not used, the prior is.
        pictures: Grey pictures of the same pixels: range made visible, amplitude, colour as grey.
        prior: T_base_camera by encoders and localiser; None without either.
        stamp_s: When it was taken, s.
    """

    depth: Depth
    pictures: tuple[UInt8[np.ndarray, "h w"], ...]
    prior: Pose3 | None = None
    stamp_s: float = 0.0

    def __post_init__(self) -> None:
        for picture in self.pictures:
            if picture.shape != self.depth.z.shape:
                raise InputError(
                    f"view: picture of {picture.shape} px beside depth of {self.depth.z.shape}; "
                    "give pictures of the same pixels"
                )


YAWS_DEG = (-60.0, -30.0, 0.0, 30.0, 60.0)
PITCHES_DEG = (-17.0, 0.0, 17.0)
PLANS = ("nine", "fifteen", "three_by_three")


def head_directions(plan: str = "nine") -> list[tuple[float, float]]:
    """(pan, tilt) of the head for each view, rad, left and down positive as `head_rotation` has them.

    Args:
        plan: "nine": all yaws level, and two up and two down between them; "fifteen": all yaws at all
            pitches; "three_by_three": yaws of -30, 0, 30 deg at all pitches.

    Source: seed 004, section 4 (key yaw -60 to 60 by 30 deg, key pitch -17, 0, 17 deg; nine views).
    """
    if plan == "nine":
        wanted = [(yaw, 0.0) for yaw in YAWS_DEG]
        wanted += [(yaw, pitch) for pitch in (-17.0, 17.0) for yaw in (-30.0, 30.0)]
    elif plan == "fifteen":
        wanted = [(yaw, pitch) for pitch in PITCHES_DEG for yaw in YAWS_DEG]
    elif plan == "three_by_three":
        wanted = [(yaw, pitch) for pitch in PITCHES_DEG for yaw in YAWS_DEG[1:4]]
    else:
        raise ConfigError(f"panorama: plan={plan!r} is unknown; use one of {', '.join(PLANS)}")
    return [(-math.radians(yaw), -math.radians(pitch)) for yaw, pitch in wanted]


@dataclass(frozen=True)
class PriorConfig:
    """How far the prior may be trusted; deviations, rad and m."""

    pan_deg: float = 0.5  # spec of 004: encoders off by 0.5 deg
    tilt_deg: float = 0.5  # spec of 004
    rest_deg: float = 0.1  # ours: roll, and what gears give in any direction
    position_m: float = 0.005  # ours: neck and lever arm, while standing

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"prior: {name}={getattr(self, name)} must be positive")


def prior_covariance(prior: Pose3, config: PriorConfig) -> Float[np.ndarray, "6 6"]:
    """Of a prior pose: rotation (rad^2), then translation (m^2), both in the camera's axes.

    An error of the pan joint turns about the base's vertical, one of the tilt joint about the camera's x.
    """
    upright = prior.rotation.T[:, 2]
    sideways = np.array([1.0, 0.0, 0.0])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = (
        math.radians(config.pan_deg) ** 2 * np.outer(upright, upright)
        + math.radians(config.tilt_deg) ** 2 * np.outer(sideways, sideways)
        + math.radians(config.rest_deg) ** 2 * np.eye(3)
    )
    covariance[3:, 3:] = config.position_m**2 * np.eye(3)
    return covariance


def view_of_depth(
    depth: Depth,
    farthest_m: float,
    picture: UInt8[np.ndarray, "h w"] | None = None,
    prior: Pose3 | None = None,
    stamp_s: float = 0.0,
) -> View:
    """A view whose pictures are its range made visible and, where there is one, another.

    Args:
        depth: As from any sensor.
        farthest_m: Range that is white in the picture, m.
        picture: Amplitude or colour as grey, of the same pixels.
        prior: T_base_camera.
        stamp_s: When it was taken.
    """
    visible = range_picture(depth.z, farthest_m)
    pictures = (visible,) if picture is None else (visible, picture)
    return View(depth, pictures, prior, stamp_s)
