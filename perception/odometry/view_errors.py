"""Errors of poses that depend on the view: nearly equal for nearly equal views, independent for different ones.

Lens and depth distortion displace a pose by an amount that depends on what the camera sees in which part of its
image. Two images taken from almost the same place share this error, so it cancels between them; two images that
see different scenes do not. The error is modelled as a Gaussian process over camera poses. Between two images its
deviation grows with the power 3/4 of their difference, and then levels off: on three recordings (tum_fr3_cabinet, both
of 7-Scenes) 0.06 deg at 0.3 deg, 0.2 at 1.4, 0.3 at 2.6, 0.5 at 8. Its size follows from the sensor's distortion: a
camera without bend has no view error.

Source: ours; the covariance function is the gamma-exponential of Rasmussen and Williams 2006, eq. (4.18), gamma 1.5.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from .pose_uncertainty import PoseUncertainty, error_transport, rigid_alignment
from .pyramid import Pyramid

VIEW_TURN_RAD = math.radians(10.0)  # ours: three recordings, images .3 to 8 deg apart
VIEW_SHIFT_M = 0.35  # ours: moves what is 2 m away by the same angle
GAMMA = 1.5  # ours: likewise; 1 is rough, 2 smooth
# Ours: the published bend of an RGB-D camera, 1.4 % at 2 m, turns a pose by 0.5 deg and shifts it by 5 mm
# (three recordings with ground truth)
TURN_PER_BEND = 0.62  # rad
SHIFT_PER_BEND = 0.18  # of the distance
BLOCK = 256  # images correlated with all others at a time; bounds the memory
MOST_IMAGES = 4000  # ours: sums over longer trajectories take every k-th image


class ViewErrorSize:
    """How large the view error of a camera is: the mean over its images."""

    def __init__(self) -> None:
        self._sum = np.zeros(2)
        self._images = 0

    def add(self, image: Pyramid) -> None:
        """Take one more image; one without depth is left out."""
        z = image.levels[-1].z
        seen = z > 0.0
        if not seen.any():
            return
        self._sum += np.square(
            [SHIFT_PER_BEND * float(np.median(z[seen])) * image.bend, TURN_PER_BEND * image.bend]
        )
        self._images += 1

    @property
    def covariance(self) -> Float[np.ndarray, "6 6"]:
        """Of one image's view error, (x, y, z, rotation vector), any axes, m and rad; zero without an image."""
        return np.diag(np.repeat(self._sum / max(self._images, 1), 3))


def view_correlation(
    positions: Float[np.ndarray, "n 3"],
    rotations: Float[np.ndarray, "n 3 3"],
    other_positions: Float[np.ndarray, "m 3"],
    other_rotations: Float[np.ndarray, "m 3 3"],
) -> Float[np.ndarray, "n m"]:
    """Correlation of the view errors of two sets of camera poses, in [0, 1].

    Args:
        positions, other_positions: Of the cameras, common axes, m.
        rotations, other_rotations: From camera to common axes.

    Source: Rasmussen and Williams 2006, eq. (4.18), with |R - R'|^2 = 4 (1 - cos angle) for rotations.
    """
    here = _embedded(positions, rotations)
    there = _embedded(other_positions, other_rotations)
    squares = np.sum(here**2, axis=1)[:, None] + np.sum(there**2, axis=1) - 2.0 * here @ there.T
    return np.asarray(np.exp(-(np.maximum(squares, 0.0) ** (0.5 * GAMMA))))


def _embedded(
    positions: Float[np.ndarray, "n 3"], rotations: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n 12"]:
    """Poses as vectors whose distance is the difference of the views, in units of the process' length."""
    turns = rotations.reshape(-1, 9) / (math.sqrt(2.0) * VIEW_TURN_RAD)
    return np.hstack([positions / VIEW_SHIFT_M, turns])


def view_error_covariances(
    positions: Float[np.ndarray, "n 3"],
    rotations: Float[np.ndarray, "n 3 3"],
    own: Float[np.ndarray, "6 6"],
) -> PoseUncertainty:
    """Covariances that view errors alone give to a trajectory.

    Args:
        positions, rotations: T_world_camera of every image.
        own: Covariance of one image's view error, (x, y, z, rotation vector), world axes, m and rad.

    Returns:
        Relative to the first image, and after the rigid alignment of the whole trajectory.
    """
    count = len(positions)
    moves, best = rigid_alignment(positions)
    every = -(-count // MOST_IMAGES)
    used = slice(0, None, every)
    weights = np.full(len(positions[used]), float(every))
    weights[-1] = count - every * (len(weights) - 1)
    shares = (best[used] * weights[:, None, None]).reshape(-1, 36)
    with_common = np.empty((count, 6, 6))
    for begin in range(0, count, BLOCK):
        rows = slice(begin, begin + BLOCK)
        alike = view_correlation(positions[rows], rotations[rows], positions[used], rotations[used])
        summed = (alike @ shares).reshape(-1, 6, 6)
        with_common[rows] = own @ summed.transpose(0, 2, 1)
    common = np.einsum("nij,njk->ik", shares.reshape(-1, 6, 6), with_common[used])
    crossed = with_common @ moves.transpose(0, 2, 1)
    aligned = own - crossed - crossed.transpose(0, 2, 1) + moves @ common @ moves.transpose(0, 2, 1)
    alike = view_correlation(positions, rotations, positions[:1], rotations[:1])[:, 0]
    alike[0] = 1.0  # without rounding
    from_start = np.array(
        [since_start(own, p - positions[0], a) for p, a in zip(positions, alike, strict=True)]
    )
    return PoseUncertainty(from_start, (aligned + aligned.transpose(0, 2, 1)) / 2.0)


def since_start(
    own: Float[np.ndarray, "6 6"], arm: Float[np.ndarray, "3"], alike: float
) -> Float[np.ndarray, "6 6"]:
    """Covariance of the view error of a pose relative to that of the first image.

    Args:
        own: Covariance of one image's view error, world axes.
        arm: From the first camera to this one, world axes, m.
        alike: Correlation of the two views.
    """
    lever = error_transport(arm)
    crossed = alike * own @ lever.T
    found = own - crossed - crossed.T + lever @ own @ lever.T
    return np.asarray((found + found.T) / 2.0)
