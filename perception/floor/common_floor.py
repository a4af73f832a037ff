"""The floor of a place: one plane that explains the floor in all views of a recording, in the axes of its poses.

Each view proposes the floor that it finds by itself. The proposal that the points of all views support best is the
floor: many points on it, none below it, every camera above it. It is then fitted in each view that shows it, and the
fits are fused, with outliers left out. Neither the axes nor the origin of the poses matter.

Errors of the sensor are the same in every view, so they do not average out: their covariance is that of a typical
view. The rest averages; if the views differ by more than they claim, it grows accordingly.

Source: ours; fusion of estimates with unknown common errors after Julier and Uhlmann 1997 (covariance intersection
with equal weights); growth by the scatter after Birge 1932.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from ..depth.points import Points
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from .choose import (
    CONFIDENCE,
    LEAST_HEIGHT_M,
    LEAST_KNOWN_SHARE,
    MOST_BELOW,
    FloorConfig,
    find,
    thinned,
)
from .levelling import UP, rotation_between
from .prior import GRAVITY_TILT_RAD, handheld_prior
from .refine import Fit, refine, turned

KEPT_POINTS = (
    5000  # ours: of a view; its floor is determined as well, and a thousand views fit in memory
)
POOLED_POINTS = 500  # ours: of a view; they decide among the proposals
POSE_M = 0.02  # ours: hand-held poses of others are good to 1-2 cm
POSE_RAD = math.radians(0.5)  # ours: and to half a degree
TRIES = 3  # ours: fuse, leave out the views that disagree, fuse again


class FloorView(NamedTuple):
    """A depth image with a pose, for the floor search.

    Args:
        points: At most some thousand, camera frame, m.
        T_world_camera: Pose in any axes.
        sensor: "tof", "stereo" or "depth", which sets the errors common to all points; None if unknown.
    """

    points: Points
    T_world_camera: Pose3
    sensor: str | None = None


@dataclass(frozen=True)
class CommonFloor:
    """The floor of a recording.

    Args:
        plane: Axes of the poses; normal up, with covariance.
        views: Numbers of the views that were fused.
    """

    plane: Plane
    views: tuple[int, ...]

    @property
    def T_level_world(self) -> Pose3:
        """The poses' axes in level ones: z up and zero on the floor; the smallest rotation, x and y kept."""
        rotation = rotation_between(self.plane.normal, UP)
        return Pose3.from_rotation(rotation, np.array([0.0, 0.0, self.plane.offset_m]))

    def height_of(self, position: Float[np.ndarray, "3"]) -> tuple[float, float]:
        """Height of a place above the floor and its standard deviation, axes of the poses, m."""
        shift = Pose3((-float(position[0]), -float(position[1]), -float(position[2])))
        here = self.plane.moved(shift)
        return here.offset_m, math.sqrt(float(here.covariance[2, 2]))


def floor_view(points: Points, T_world_camera: Pose3, sensor: str | None = None) -> FloorView:
    """A view with every k-th of its points, so that many fit in memory."""
    return FloorView(thinned(points, KEPT_POINTS), T_world_camera, sensor)


def find_common(
    views: Sequence[FloorView],
    up_world: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    config: FloorConfig | None = None,
) -> CommonFloor | None:
    """Find the floor of all views.

    Args:
        views: Of one place, in any order.
        up_world: Approximate vertical in the axes of the poses, some degrees off at most; None if unknown: then the
            cameras are held upright.
        rng: Random numbers of the searches.
        config: Settings of the floor search.

    Returns:
        None if no view shows a floor below all cameras.
    """
    config = config or FloorConfig()
    if not views:
        return None
    middle = np.mean([view.T_world_camera.position for view in views], axis=0)
    T_local_world = Pose3.from_rotation(
        np.eye(3), -middle
    )  # tilt and height are least correlated here
    local = [view._replace(T_world_camera=T_local_world @ view.T_world_camera) for view in views]
    start = _supported_best(local, _proposals(local, up_world, rng, config), config)
    if start is None:
        return None
    found = [(number, _fit_in_view(view, start, config)) for number, view in enumerate(local)]
    fits = {number: fit for number, fit in found if fit is not None}
    # a search that settles on a wall is left out before it can widen the fused covariance
    plane, used = start, [k for k, fit in fits.items() if _agrees(fit, start)]
    for _ in range(TRIES):
        if not used:
            return None
        plane = _fused([fits[k] for k in used], plane, up_world)
        used = [k for k, fit in fits.items() if _agrees(fit, plane)]
    return CommonFloor(plane.moved(T_local_world.inverse()), tuple(used))


class _WorldFit(NamedTuple):
    """The floor by one view, axes of the poses: its own covariance, and that of the sensor's common errors."""

    plane: Plane
    own: Float[np.ndarray, "3 3"]
    common: Float[np.ndarray, "3 3"]


def _proposals(
    views: Sequence[FloorView],
    up_world: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    config: FloorConfig,
) -> list[Plane]:
    """The floor that each view finds by itself."""
    found = []
    for view in views:
        T = view.T_world_camera
        up_camera = None if up_world is None else T.rotation.T @ up_world
        floor = find(view.points, handheld_prior(up_camera), rng, config, view.sensor)
        if floor is not None:
            found.append(floor.plane.moved(T))
    return found


def _supported_best(
    views: Sequence[FloorView], planes: Sequence[Plane], config: FloorConfig
) -> Plane | None:
    """The plane with the most points on it, less those below it; None if none has more on than below.

    One point below outweighs 1 / `MOST_BELOW` on it, as in the test of a single view.
    """
    xyz, drop, sigma = [], [], []
    for view in views:
        thin = thinned(view.points, POOLED_POINTS)
        T = view.T_world_camera
        xyz.append(T.apply(thin.xyz))
        drop.append(thin.xyz / thin.xyz[:, 2:] @ T.rotation.T)  # ray of unit depth
        sigma.append(thin.sigma)
    points, rays, noise = np.concatenate(xyz), np.concatenate(drop), np.concatenate(sigma)
    cameras = np.array([view.T_world_camera.position for view in views])
    best, best_score = None, 0.0
    for plane in planes:
        if plane.distance(cameras).min() < LEAST_HEIGHT_M:
            continue
        distance = plane.distance(points)
        tau = (
            config.sample.base_m
            + POSE_M
            + config.sample.sigmas * noise * np.abs(rays @ plane.normal)
        )
        on = np.maximum(1.0 - (distance / tau) ** 2, 0.0).sum()
        score = float(on - np.count_nonzero(distance < -2.0 * tau) / MOST_BELOW)
        if score > best_score:
            best, best_score = plane, score
    return best


def _fit_in_view(view: FloorView, start: Plane, config: FloorConfig) -> _WorldFit | None:
    """The plane fitted to the points of a view near the start; None if the view does not show it."""
    T = view.T_world_camera
    expected = start.moved(T.inverse())
    distortion = config.distortion.of(view.sensor)
    fit: Fit | None = refine(
        view.points, expected, config.sample, config.refine, distortion, settle=True
    )
    if fit is None or fit.share < LEAST_KNOWN_SHARE:
        return None
    whole, own = fit.plane.moved(T), fit.among_points.moved(T)
    posed = np.diag([POSE_RAD**2, POSE_RAD**2, POSE_M**2])
    return _WorldFit(whole, own.covariance + posed, whole.covariance - own.covariance)


def _fused(fits: Sequence[_WorldFit], about: Plane, up_world: np.ndarray | None) -> Plane:
    """Weighted mean of the fits, and of the gravity direction if there is one, about a nearby plane.

    The common errors e_i of the views may be correlated in any way. Then (sum A_i e_i)(sum A_i e_i)^T is at most
    sum A_i C_i A_i^T / p_i for any positive p_i that sum to 1; p_i is the share of the view in the information.
    """
    own = [turned(fit.own, fit.plane.tangents, about.tangents) for fit in fits]
    common = [turned(fit.common, fit.plane.tangents, about.tangents) for fit in fits]
    weights = [np.linalg.inv(P + C) for P, C in zip(own, common, strict=True)]
    errors = [about.error_to(fit.plane) for fit in fits]
    information = np.sum(weights, axis=0)
    pull = np.sum([W @ e for W, e in zip(weights, errors, strict=True)], axis=0)
    gravity = np.zeros((3, 3))
    if up_world is not None:
        gravity[0, 0] = gravity[1, 1] = GRAVITY_TILT_RAD**-2
        up = up_world / np.linalg.norm(up_world)
        pull = pull + gravity @ about.error_to(Plane(up, about.offset_m))
    inverse = np.linalg.inv(information + gravity)
    mean = inverse @ pull
    scatter = sum(float((e - mean) @ W @ (e - mean)) for e, W in zip(errors, weights, strict=True))
    growth = max(1.0, scatter / (3.0 * max(len(fits) - 1, 1)))
    unlike = growth * np.sum([W @ P @ W for W, P in zip(weights, own, strict=True)], axis=0)
    shares = np.array([np.trace(inverse @ W) for W in weights])
    shares /= shares.sum()
    alike = np.sum([W @ C @ W / p for W, C, p in zip(weights, common, shares, strict=True)], axis=0)
    normal = about.normal + mean[:2] @ about.tangents
    plane = Plane(normal / np.linalg.norm(normal), about.offset_m + float(mean[2]))
    covariance = inverse @ (unlike + alike + gravity) @ inverse
    covariance = turned(covariance, about.tangents, plane.tangents)
    return Plane(plane.normal, plane.offset_m, covariance)


def _agrees(fit: _WorldFit, plane: Plane) -> bool:
    """Whether a view's fit lies within its covariance, and that of the fused plane, of the fused plane."""
    error = plane.error_to(fit.plane)
    covariance = turned(fit.own + fit.common, fit.plane.tangents, plane.tangents) + plane.covariance
    return float(error @ np.linalg.solve(covariance, error)) <= 2.0 * float(
        gammaincinv(1.5, CONFIDENCE)
    )
