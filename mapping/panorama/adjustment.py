"""Pose graph of all views: the poses that agree best with every pair and every prior, by GTSAM.

Pairs enter as factors between two poses with a robust kernel, priors without one. The result has marginal
covariances. No other file of mapping uses GTSAM.

Source: Kang 2013 (seed 004), section 4 (v), as reconstructed; Dellaert and Kaess 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3

from .pairs import Link

ANCHOR_SIGMA = 1e-4  # ours: rad, m; fixes the first view if no view has a prior
WEAK_PRIOR = np.diag([3.0**2] * 3 + [30.0**2] * 3)
"""Covariance for a view without prior, rad^2 and m^2 (ours): keeps the graph solvable without links."""
MOST_SIGMA_RAD = 0.5  # ours: a view with a larger rotation sigma is not placed
EVIDENCE = ("features", "surfaces", "alignment")  # kinds of links, the best first
CAUCHY = 2.0  # ours: scale of the robust kernel, in standard deviations


@dataclass(frozen=True)
class Prior:
    """Prior pose of a view by joints and localisation; covariance rotation first, axes of the camera."""

    pose: Pose3
    covariance: Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class Placed:
    """Estimated pose of a view.

    Args:
        T_base_camera: Its pose.
        covariance: Rotation (rad^2), then translation (m^2), axes of the camera.
        by: Its best evidence: "features", "surfaces", "alignment" of whole images, or "encoders" without a link.
        links: Number of views it is linked with.
        yaws: Covariance of its rotation about the base's vertical with that of every view, rad^2; 0 for a
            view that is not placed. The relative yaw of two views with a common encoder error is more
            certain than either: its variance is `a.yaws[a] + b.yaws[b] - 2 a.yaws[b]`.
    """

    T_base_camera: Pose3
    covariance: Float[np.ndarray, "6 6"]
    by: str
    links: int
    yaws: Float[np.ndarray, "n"] | None = None


def adjust(
    priors: Sequence[Prior | None], links: Sequence[Link], rotations_only: bool
) -> list[Placed | None]:
    """Poses of all views.

    Args:
        priors: One per view; None if unknown.
        links: Relative poses of pairs.
        rotations_only: Adjust rotations and keep the positions of the priors (or the origin).

    Returns:
        One per view; None for a view without a prior and without a chain of links to a view with one. If no
        view has a prior, the first of the largest linked set defines the base: at its origin, looking along
        its x axis.
    """
    given = list(priors)
    if given and all(prior is None for prior in given):
        straight = Pose3.from_rotation(CAMERA_IN_BODY_AXES, np.zeros(3))
        given[min(largest_set(linked_sets(links, len(given))))] = anchor(straight)
    start = _initial_poses(given, links)
    reached = [number for number, pose in enumerate(start) if pose is not None]
    if not reached:
        return [None] * len(given)
    poses, covariances, yaws = _solve(start, given, links, rotations_only)
    placed: list[Placed | None] = []
    for number, pose in enumerate(poses):
        mine = [link for link in links if number in (link.first, link.second)]
        if pose is None or np.diag(covariances[number])[:3].max() > MOST_SIGMA_RAD**2:
            placed.append(None)
            continue
        evidence = {link.by for link in mine}
        by = next((one for one in EVIDENCE if one in evidence), "encoders")
        linked = {one for link in mine for one in (link.first, link.second)} - {number}
        placed.append(Placed(pose, covariances[number], by, len(linked), yaws[number]))
    return placed


def anchor(pose: Pose3) -> Prior:
    """The prior of a view that defines the base."""
    return Prior(pose, ANCHOR_SIGMA**2 * np.eye(6))


def linked_sets(links: Sequence[Link], count: int) -> list[int]:
    """For each view the first view of the set that links connect it with."""
    first = list(range(count))
    for link in links:
        one, other = sorted((first[link.first], first[link.second]))
        first = [one if number == other else number for number in first]
    return first


def largest_set(first: Sequence[int]) -> set[int]:
    """The largest set of views in the result of `linked_sets`; of equal ones the first."""
    best = max(first, key=lambda one: (first.count(one), -one), default=-1)
    return {number for number, own in enumerate(first) if own == best}


def _initial_poses(priors: Sequence[Prior | None], links: Sequence[Link]) -> list[Pose3 | None]:
    """Initial poses: the priors, propagated along the strongest links."""
    poses: list[Pose3 | None] = [None if prior is None else prior.pose for prior in priors]
    ordered = sorted(links, key=lambda link: (-link.inliers, link.first, link.second))
    grown = True
    while grown:
        grown = False
        for link in ordered:
            one, other = poses[link.first], poses[link.second]
            if one is not None and other is None:
                poses[link.second] = one @ link.T_first_second
            elif other is not None and one is None:
                poses[link.first] = other @ link.T_first_second.inverse()
            else:
                continue
            grown = True
            break
    return poses


def _solve(
    start: Sequence[Pose3 | None],
    priors: Sequence[Prior | None],
    links: Sequence[Link],
    rotations_only: bool,
) -> tuple[list[Pose3 | None], dict[int, Float[np.ndarray, "6 6"]], Float[np.ndarray, "n n"]]:
    import gtsam

    size = 3 if rotations_only else 6

    def value(pose: Pose3) -> Any:
        rotation = gtsam.Rot3(pose.rotation)
        return rotation if rotations_only else gtsam.Pose3(rotation, pose.position)

    factor_between = gtsam.BetweenFactorRot3 if rotations_only else gtsam.BetweenFactorPose3
    factor_prior = gtsam.PriorFactorRot3 if rotations_only else gtsam.PriorFactorPose3
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY)
    robust_graph, plain_graph = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    values = gtsam.Values()
    for number, pose in enumerate(start):
        if pose is not None:
            values.insert(number, value(pose))
        prior = priors[number]
        known = prior or (None if pose is None else Prior(pose, WEAK_PRIOR))
        if known is not None:
            noise = gtsam.noiseModel.Gaussian.Covariance(known.covariance[:size, :size])
            for one in (robust_graph, plain_graph):
                one.add(factor_prior(number, value(known.pose), noise))
    for link in links:
        if start[link.first] is None or start[link.second] is None:
            continue
        noise = gtsam.noiseModel.Gaussian.Covariance(link.covariance[:size, :size])
        robust = gtsam.noiseModel.Robust.Create(kernel, noise)
        ends = (link.first, link.second, value(link.T_first_second))
        robust_graph.add(factor_between(*ends, robust))
        plain_graph.add(factor_between(*ends, noise))
    # started from the priors alone, the robust kernel would reject a good link far from them
    plain = gtsam.LevenbergMarquardtOptimizer(plain_graph, values).optimize()
    optimize = gtsam.LevenbergMarquardtOptimizer
    solutions = [optimize(robust_graph, guess).optimize() for guess in (values, plain)]
    best = min(solutions, key=robust_graph.error)
    marginals = gtsam.Marginals(robust_graph, best)
    poses: list[Pose3 | None] = []
    covariances = {}
    for number, pose in enumerate(start):
        if pose is None:
            poses.append(None)
            continue
        prior = priors[number]
        covariance = np.zeros((6, 6)) if prior is None else prior.covariance.copy()
        covariance[:size, :size] = marginals.marginalCovariance(number)
        if rotations_only:
            covariance[:3, 3:], covariance[3:, :3] = 0.0, 0.0
            poses.append(Pose3.from_rotation(best.atRot3(number).matrix(), pose.position))
        else:
            found = best.atPose3(number)
            poses.append(Pose3.from_rotation(found.rotation().matrix(), found.translation()))
        covariances[number] = covariance
    return poses, covariances, _yaws(marginals, poses)


def _yaws(marginals: Any, poses: Sequence[Pose3 | None]) -> Float[np.ndarray, "n n"]:
    """Joint covariance of all views' rotations about the base's vertical, rad^2."""
    known = [(number, pose) for number, pose in enumerate(poses) if pose is not None]
    joint = marginals.jointMarginalCovariance([number for number, _ in known])
    found = np.zeros((len(poses), len(poses)))
    for i, one in known:
        for j, other in known:
            block = np.asarray(joint.at(i, j))[:3, :3]
            found[i, j] = one.rotation[2] @ block @ other.rotation[2]
    return found
