"""Batch smoothing: the poses of a whole run by nonlinear least squares.

Unlike a filter, a smoother lets later measurements correct earlier poses; its marginal covariances are the
reference for the filter's. `solve` and `smooth` optimise all factors at once (Levenberg-Marquardt, then a gate
for factors with a robust loss). `fixed_lag` does so incrementally, with the same factors.

Source: Dellaert and Kaess (2006), square root SAM; Kaess et al., iSAM2 (2012); both as in GTSAM. The gate after
robust losses is ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..filtering.consistency import chi_square_quantile
from ..primitives.errors import ConfigError, InputError
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2, Pose3
from .factors import (
    Factor,
    FloorSeen,
    LoopClosure,
    Motion,
    Placement,
    PoseSeen,
    Systematic,
    poses_of,
)

if TYPE_CHECKING:
    from .graph import Graph

GATE_ROUNDS = 5  # ours: two usually decide which factors are outliers
GATE_PROBABILITY = 0.999  # as the filter's: share of correct measurements inside the gate
ITERATIONS = 100  # ours: ten suffice for a walk, false closures take more
IMPOSSIBLE_M = 1e4  # a marginal standard deviation that reveals a numerical breakdown


@dataclass(frozen=True)
class SmootherConfig:
    """Parameters of batch and fixed-lag smoothing."""

    lag_s: float = 10.0  # spec of the benchmark: 10 s at 10 Hz; longer hardly helps a walk
    relinearise: float = 0.001  # ours: m and rad; means lie within 1 % of a deviation of the batch
    outliers: str = "gate"  # "losses": each factor's robust loss; "gate": then used or rejected

    def __post_init__(self) -> None:
        for name in ("lag_s", "relinearise"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"smoother: {name}={getattr(self, name)} must be positive")
        if self.outliers not in ("losses", "gate"):
            raise ConfigError(f"smoother: outliers={self.outliers!r} must be 'losses' or 'gate'")


@dataclass(frozen=True)
class Solution:
    """The estimate by a batch of factors.

    Args:
        poses: By number: Gaussians over (x, y, yaw), or placements in space; world frame.
        landmarks: By number: Gaussians over (x, y), world frame, m.
        error: Half the sum of squares (robust: of losses) at the solution.
        rejected: Factors with a part outside the gate; sightings of unknown landmarks and of the floor keep their
            loss instead.
    """

    poses: dict[int, Gaussian | Placement]
    landmarks: dict[int, Gaussian] = field(default_factory=dict)
    error: float = 0.0
    rejected: list[Factor] = field(default_factory=list)


def smooth(
    factors: Sequence[Factor],
    start: Gaussian,
    systematics: Sequence[Systematic] = (),
    config: SmootherConfig | None = None,
) -> list[Gaussian]:
    """The poses of a run on the floor.

    Args:
        factors: In any order; poses are numbered, gaps are allowed.
        start: Of the pose with the lowest number, over (x, y, yaw), world frame.
        systematics: Errors that effects of the factors refer to.
        config: The defaults if None.

    Returns:
        In order of their numbers, over (x, y, yaw), m and rad, world frame.

    Raises:
        InputError: A pose is not connected, or the factors do not determine it.
    """
    poses = solve(factors, start, systematics, config).poses
    return [pose for pose in poses.values() if isinstance(pose, Gaussian)]


def solve(
    factors: Sequence[Factor],
    start: Gaussian | Placement | None,
    systematics: Sequence[Systematic] = (),
    config: SmootherConfig | None = None,
) -> Solution:
    """Estimate everything that the factors determine, with marginal covariances.

    Args:
        factors: In any order.
        start: Of the pose with the lowest number; None if a `PoseSeen` anchors the poses.
        systematics: Errors that effects of the factors refer to.
        config: The defaults if None.

    Raises:
        InputError: There are no factors, or a pose is not connected or not determined.
    """
    import gtsam

    from . import graph as native

    config = config or SmootherConfig()
    numbers = sorted({number for factor in factors for number in poses_of(factor)})
    if not numbers:
        raise InputError("smoother: there are no factors; give at least one motion")
    factors = [*([] if start is None else [PoseSeen(numbers[0], start)]), *factors]
    check_dimension(factors)
    guesses = native.first_guesses(factors, {})
    stiff = bool(systematics) or any(isinstance(factor, FloorSeen) for factor in factors)
    try:
        draft = _incremental_draft(_stages(factors), systematics, config, stiff)
    except (InputError, RuntimeError):  # not connected in the order of their numbers
        draft = _Draft(native.Graph(systematics))
        draft.add(factors, guesses, {})
    built, values, graph = draft.built, draft.values, draft.graph
    rejected: list[int] = []
    try:
        values = _optimised(built, values, stiff)
        if config.outliers == "gate":
            built, values, rejected = _gated(built, values, draft.robust, stiff)
        marginals = gtsam.ISAM2(isam2_parameters(config, stiff))  # gtsam.Marginals has no QR
        marginals.update(built, values)
        poses = {}
        for number in numbers:
            covariance = marginals.marginalCovariance(native.pose_key(number))
            poses[number] = native.marginal(_at(values, number, guesses[number]), covariance)
        landmarks = {
            number: Gaussian(values.atPoint2(key), marginals.marginalCovariance(key))
            for number, key in sorted(graph.landmark_keys.items())
        }
    except RuntimeError as error:
        raise underdetermined(error) from error
    for number, pose in poses.items():
        check_marginal(number, pose)
    return Solution(
        poses, landmarks, float(built.error(values)), [draft.owners[i] for i in rejected]
    )


class _Draft:
    """A GTSAM graph under construction, with initial values of its variables."""

    def __init__(self, graph: Graph) -> None:
        import gtsam

        self.graph = graph
        self.built = gtsam.NonlinearFactorGraph()
        self.values = gtsam.Values()
        self.owners: list[Factor] = []
        self.robust: list[int] = []

    def add(
        self,
        factors: Sequence[Factor],
        guesses: Mapping[int, Pose2 | Pose3],
        known: Mapping[int, Pose2 | Pose3],
    ) -> tuple[Any, Any]:
        """Add our factors; returns the GTSAM factors and their initial values."""
        for number, pose in known.items():
            self.graph.recall_pose(number, pose)
        for number in sorted(set(guesses) - set(known)):
            self.graph.add_pose(number, guesses[number])
        count = len(self.owners)
        for factor in factors:
            self.graph.add(factor)
            self.owners += [factor] * (count + self.graph.factors.size() - len(self.owners))
        self.robust += [count + i for i in self.graph.robust]
        native, values, _ = self.graph.take()
        self.built.push_back(native)
        self.values.insert(values)
        return native, values


def _incremental_draft(
    stages: Sequence[Sequence[Factor]],
    systematics: Sequence[Systematic],
    config: SmootherConfig,
    stiff: bool,
) -> _Draft:
    """Initial values by one incremental pass: from dead reckoning alone the optimiser may diverge.

    Loop closures, some of which may be false, are added last.
    """
    import gtsam

    from . import graph as native

    draft = _Draft(native.Graph(systematics))
    rough = replace(config, relinearise=0.1)  # the optimiser does the rest
    isam2 = gtsam.ISAM2(isam2_parameters(rough, stiff))
    poses: dict[int, Pose2 | Pose3] = {}
    *stages, closures = stages
    for factors in stages:
        mentioned = {number for factor in factors for number in poses_of(factor)}
        known = {}
        for number in mentioned & set(poses):
            key = native.pose_key(number)
            planar = isinstance(poses[number], Pose2)
            mean = (
                isam2.calculateEstimatePose2(key) if planar else isam2.calculateEstimatePose3(key)
            )
            known[number] = native.from_native(mean)
        guesses = native.first_guesses(factors, known)
        isam2.update(*draft.add(factors, guesses, known))
        poses.update(guesses)
    draft.values = isam2.calculateEstimate()
    known = {n: native.from_native(_at(draft.values, n, poses[n])) for n in sorted(poses)}
    draft.add(closures, known, known)
    return draft


def _stages(factors: Sequence[Factor]) -> list[list[Factor]]:
    """The factors in the order of their latest pose; loop closures last."""
    stages: dict[int, list[Factor]] = {}
    for factor in factors:
        if not isinstance(factor, LoopClosure):
            stages.setdefault(max(poses_of(factor)), []).append(factor)
    closures: list[Factor] = [one for one in factors if isinstance(one, LoopClosure)]
    return [*(stages[number] for number in sorted(stages)), closures]


def _at(values: Any, number: int, kind: Pose2 | Pose3) -> Any:
    """GTSAM's pose of that number."""
    from .graph import pose_key

    key = pose_key(number)
    return values.atPose2(key) if isinstance(kind, Pose2) else values.atPose3(key)


def isam2_parameters(config: SmootherConfig, stiff: bool) -> Any:
    """Parameters of iSAM2; stiff graphs (systematic errors, floors) need QR instead of Cholesky."""
    import gtsam

    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR" if stiff else "CHOLESKY")
    parameters.setRelinearizeThreshold(config.relinearise)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters


def _parameters(stiff: bool) -> Any:
    import gtsam

    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(ITERATIONS)
    if stiff:
        parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-7)
    parameters.setAbsoluteErrorTol(1e-7)
    return parameters


def _optimised(built: Any, values: Any, stiff: bool) -> Any:
    import gtsam

    return gtsam.LevenbergMarquardtOptimizer(built, values, _parameters(stiff)).optimize()


def _gated(
    built: Any, values: Any, robust: Sequence[int], stiff: bool
) -> tuple[Any, Any, list[int]]:
    """Every robust factor either used with a quadratic loss or rejected: graph, values, rejected factors.

    Starts from the optimum of the robust losses.
    """
    import gtsam

    rejected: list[int] | None = None
    kept = built
    for _ in range(GATE_ROUNDS):
        outside = [i for i in robust if _outside(built.at(i), values)]
        if outside == rejected or not robust:
            break
        rejected = outside
        kept = gtsam.NonlinearFactorGraph()
        plain, out = set(robust), set(outside)
        for i in range(built.size()):
            factor = built.at(i)
            if i not in plain:
                kept.add(factor)
            elif i not in out:
                kept.add(factor.cloneWithNewNoiseModel(factor.noiseModel().noise()))
        values = _optimised(kept, values, stiff)
    return kept, values, rejected or []


def _outside(factor: Any, values: Any) -> bool:
    """Whether the residual of a robust factor is outside the gate."""
    noise = factor.noiseModel().noise()
    squared = noise.squaredMahalanobisDistance(factor.unwhitenedError(values))
    return bool(squared > chi_square_quantile(GATE_PROBABILITY, noise.dim()))


def check_dimension(factors: Iterable[Factor]) -> None:
    """Refuse a mixture of factors on the floor and in space."""
    if len({_in_space(factor) for factor in factors}) > 1:
        raise InputError(
            "smoother: factors on the floor and in space are mixed; give factors of one kind"
        )


def _in_space(factor: Factor) -> bool:
    if isinstance(factor, (Motion, LoopClosure)):
        return isinstance(factor.motion, Pose3)
    if isinstance(factor, PoseSeen):
        return isinstance(factor.place, Placement)
    return isinstance(factor, FloorSeen)


def check_marginal(number: int, pose: Gaussian | Placement) -> None:
    """Refuse a marginal of an undetermined pose."""
    variances = np.diag(pose.covariance)
    if not np.all((variances > 0.0) & (variances < IMPOSSIBLE_M**2)):
        raise InputError(
            f"pose {number} is not determined: variances {variances}; give the motions that lead to it "
            "or a measured pose"
        )


def underdetermined(error: RuntimeError) -> InputError:
    """The error of a singular system, from GTSAM's message."""
    return InputError(
        "smoother: the factors do not determine every pose "
        f"({str(error).strip().splitlines()[0]}); give a start or more measurements"
    )
