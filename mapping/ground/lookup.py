"""Which region of an image sees a place, and the pose of its camera, corrected.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from perception.terrain.region import Region

NEAREST_M = 0.05  # ours: in front of the camera


def corrected(T: Pose3, error: Float[np.ndarray, "6"]) -> Pose3:
    """A camera pose moved by an error, as in `measured`."""
    angle = float(np.linalg.norm(error[3:]))
    axis = error[3:] / angle if angle > 0.0 else np.zeros(3)
    turn = Pose3((0.0, 0.0, 0.0), (*(math.sin(angle / 2) * axis).tolist(), math.cos(angle / 2)))
    return Pose3.from_rotation(turn.rotation @ T.rotation, T.position + error[:3])


def labels_of(regions: Sequence[Region], camera: Camera) -> Int[np.ndarray, "h w"]:
    """Region of every pixel, -1 if none."""
    labels = np.full(camera.height * camera.width, -1, np.int16)
    for number, one in enumerate(regions):
        if len(one.pixels) and not 0 <= int(one.pixels.max()) < len(labels):
            raise InputError(
                f"ground: region {number} has pixels beyond {camera.width} x {camera.height}; give the camera "
                "of its image"
            )
        labels[one.pixels] = number
    return labels.reshape(camera.height, camera.width)


def looked_up(
    labels: Int[np.ndarray, "h w"],
    points: Float[np.ndarray, "n 2"],
    z: Float[np.ndarray, "n"],
    T: Pose3,
    camera: Camera,
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Region of the pixel that sees each place, -1 if none does; and the places in the camera frame."""
    seen = (np.column_stack([points, z]) - T.position) @ T.rotation
    found = np.full(len(points), -1, labels.dtype)
    ahead = np.flatnonzero(seen[:, 2] > NEAREST_M)
    if len(ahead):
        inside, column, row = camera.nearest_pixels(seen[ahead])
        found[ahead[inside]] = labels[row[inside], column[inside]]
    return found, seen
