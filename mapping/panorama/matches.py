"""Features of views as directions, and their matches in another view.

Encoders, or pairs found before, restrict the candidates of a feature to a window about its predicted direction. Of equal
features in rows only one may lie in the window, and then not the right one; so a feature that looks like a neighbour in
its own view is not matched.

Source: Lowe 2004 (matches); the window and the test within a view are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from perception.features.matching import SAME, MatchConfig, match
from perception.features.mdghm_sift import SiftConfig, detect
from perception.primitives.camera import Camera
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3

from .sphere import direction, look_up, warp_picture, window_of_view
from .views import View

BEARING_RAD = math.radians(0.25)  # ours: sigma of a feature's direction without parallax
GUIDE_SIGMAS = 3.0  # ours: window about a predicted direction
GATE_SIGMAS = 4.0  # ours: matches further off are outliers
USUAL_RANGE_M = 2.0  # ours: assumed range if no feature has one


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """Features of one view as directions with range.

    Args:
        bearings: Unit vectors, camera frame.
        range_m: Range along them, NaN where unknown.
        descriptors: Descriptor of each feature.
        picture: Index of the view's image that shows the feature; features match within one image kind.
        camera: Of the view; None: unknown, so are its borders.
    """

    bearings: Float[np.ndarray, "n 3"]
    range_m: Float[np.ndarray, "n"]
    descriptors: Float32[np.ndarray, "n 128"]
    picture: Int[np.ndarray, "n"]
    camera: Camera | None = None


def extract_features(view: View, config: SiftConfig) -> ViewFeatures:
    """Features of a view's images, detected on the sphere about its nominal direction."""
    camera = view.depth.camera
    nominal = nominal_rotation(view)
    sphere = window_of_view(camera, nominal, camera.fx)
    u, v = look_up(sphere, camera, nominal)
    bearings, descriptors, numbers = [], [], []
    for number, picture in enumerate(view.pictures):
        warped, shown = warp_picture(picture, u, v)
        found = detect(warped, config, shown)
        x, y = found.pixels.astype(np.float64).T
        bearings.append(direction(*sphere.angles(x, y)) @ nominal)
        descriptors.append(found.descriptors)
        numbers.append(np.full(len(found), number))
    rays = np.concatenate(bearings) if bearings else np.zeros((0, 3))
    return ViewFeatures(
        rays,
        _ranges(view, rays),
        np.concatenate(descriptors) if descriptors else np.zeros((0, 128), np.float32),
        np.concatenate(numbers).astype(np.int64) if numbers else np.zeros(0, np.int64),
        camera,
    )


def nominal_rotation(view: View) -> Float[np.ndarray, "3 3"]:
    """Camera axes in the base by the prior; straight ahead without one."""
    return CAMERA_IN_BODY_AXES if view.prior is None else view.prior.rotation


def _ranges(view: View, bearings: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Range at directions, from the nearest pixel."""
    if len(bearings) == 0:
        return np.zeros(0)
    camera, z = view.depth.camera, view.depth.z
    pixels = np.nan_to_num(camera.project(bearings), nan=0.0)
    u = np.clip(np.rint(pixels[:, 0]).astype(int), 0, camera.width - 1)
    v = np.clip(np.rint(pixels[:, 1]).astype(int), 0, camera.height - 1)
    return z[v, u].astype(np.float64) / bearings[:, 2]


@dataclass(frozen=True)
class Guide:
    """What is known of the relative pose of two views: by encoders, and by pairs found before.

    Args:
        T_second_first: Their relative pose.
        sigma_rad: Its standard deviation of rotation, about the less certain axis.
        sigma_m: Its standard deviation of position.
    """

    T_second_first: Pose3
    sigma_rad: float
    sigma_m: float

    @property
    def window_rad(self) -> float:
        """Radius about a predicted direction within which the true one lies."""
        return GUIDE_SIGMAS * math.hypot(self.sigma_rad, BEARING_RAD)

    @property
    def offset(self) -> Float[np.ndarray, "3"]:
        """Position of the first camera relative to the second, first's axes, m: the second sees p at p + offset."""
        return np.asarray(self.T_second_first.rotation.T @ self.T_second_first.position)


def match_features(
    first: ViewFeatures, second: ViewFeatures, guide: Guide | None = None
) -> Int[np.ndarray, "k 2"]:
    """Match the features of two views, image by image.

    Args:
        first, second: Their features.
        guide: It restricts the candidates to features near their predicted direction, with far fewer outliers.
            None: unknown.
    """
    near = None if guide is None else _candidates(first, second, guide)
    found = []
    for number in np.unique(first.picture):
        a, b = np.flatnonzero(first.picture == number), np.flatnonzero(second.picture == number)
        allowed = None if near is None else near[np.ix_(a, b)]
        pairs = match(first.descriptors[a], second.descriptors[b], None, allowed)
        if guide is not None:
            pairs = pairs[_unique(pairs, (first, a), (second, b), guide.window_rad)]
        found.append(np.column_stack([a[pairs[:, 0]], b[pairs[:, 1]]]))
    return np.concatenate(found) if found else np.zeros((0, 2), np.int64)


def _unique(
    pairs: Int[np.ndarray, "k 2"],
    first: tuple[ViewFeatures, Int[np.ndarray, "_"]],
    second: tuple[ViewFeatures, Int[np.ndarray, "_"]],
    window_rad: float,
) -> Bool[np.ndarray, "k"]:
    """Whether the features of each match look like no other one of their own views.

    Of equal features in rows only one may lie in the window, and then not the right one. Two features within twice the
    window may be taken for each other.

    Args:
        pairs: Matches, as indices into the chosen features.
        first, second: Features of each view, and which are chosen.
        window_rad: Radius about a predicted direction.
    """
    chosen = [view.descriptors[index] for view, index in (first, second)]
    apart = 2.0 - 2.0 * (chosen[0][pairs[:, 0]] * chosen[1][pairs[:, 1]]).sum(axis=1)
    kept = np.ones(len(pairs), dtype=np.bool_)
    for (view, index), words, own in zip((first, second), chosen, pairs.T, strict=True):
        rays = view.bearings[index]
        between = rays[own] @ rays.T
        near = (between > math.cos(2.0 * window_rad)) & (
            between < math.cos(GATE_SIGMAS * BEARING_RAD)
        )
        twin = np.where(near, words[own] @ words.T, -np.inf).max(axis=1, initial=-np.inf)
        kept &= apart < MatchConfig().ratio ** 2 * (2.0 - 2.0 * twin) - SAME
    return kept


def range_or_usual(range_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Ranges with the median in place of unknown ones."""
    usual = float(np.nanmedian(range_m)) if np.isfinite(range_m).any() else USUAL_RANGE_M
    return np.where(np.isfinite(range_m), range_m, usual)


def _candidates(first: ViewFeatures, second: ViewFeatures, guide: Guide) -> Bool[np.ndarray, "n m"]:
    """Whether each feature of the second view is close to the predicted direction of each of the first."""
    there = _predicted(first, guide.T_second_first)
    back = _predicted(second, guide.T_second_first.inverse())
    near = there @ second.bearings.T > math.cos(guide.window_rad)
    return np.asarray(near & _shows(second, there)[:, None] & _shows(first, back))


def _predicted(features: ViewFeatures, motion: Pose3) -> Float[np.ndarray, "n 3"]:
    """Directions of features in another view."""
    there = motion.apply(features.bearings * range_or_usual(features.range_m)[:, None])
    return np.asarray(there / np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-9))


def _shows(features: ViewFeatures, directions: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether a view shows directions. A feature beyond its border would match one that only looks the same."""
    if features.camera is None:
        return np.ones(len(directions), dtype=np.bool_)
    return np.asarray(features.camera.contains(features.camera.project(directions)))
