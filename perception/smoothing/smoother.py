"""Where was I: all measurements at once, or those of the last seconds at every instant.

A filter believes of the present what the past told. A smoother also lets later measurements correct earlier
poses; its covariances, the marginals of the whole, are what the filter's are held against. `solve` and
`smooth` take a recorded run as one least-squares problem (Levenberg-Marquardt, then a gate for what has a
loss). `fixed_lag` follows a run as it goes, from the same factors.

Source: Dellaert and Kaess (2006), square root SAM; Kaess et al., iSAM2 (2012); both as in
GTSAM. The gate after robust losses is ours.
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

GATE_ROUNDS = 5  # ours: two settle who is in
IMPOSSIBLE_M = 1e4  # a marginal deviation that says: the arithmetic broke down


@dataclass(frozen=True)
class SmootherConfig:
    """How the smoothing is done; what is smoothed is said by the factors."""

    lag_s: float = 10.0  # spec of the benchmark: 10 s at 10 Hz; longer hardly helps a walker
    relinearise: float = (
        0.001  # ours: m and rad; then means lie within 1 % of a deviation of the batch
    )
    iterations: int = 100  # ours: batch; ten do for a walk, bad closures take more
    outliers: str = "gate"  # "losses": each factor's own; "gate": then in or out
    gate_probability: float = 0.999  # as the filter's: true measurements kept

    def __post_init__(self) -> None:
        for name in ("lag_s", "relinearise"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"smoother: {name}={getattr(self, name)} must be positive")
        if self.iterations < 1:
            raise ConfigError(f"smoother: iterations={self.iterations} must be at least 1")
        if self.outliers not in ("losses", "gate"):
            raise ConfigError(f"smoother: outliers={self.outliers!r} must be 'losses' or 'gate'")
        if not 0.0 < self.gate_probability < 1.0:
            raise ConfigError(
                f"smoother: gate_probability={self.gate_probability} must lie between 0 and 1"
            )


@dataclass(frozen=True)
class Solution:
    """What a batch of factors says.

    Args:
        poses: By number: Gaussians over (x, y, yaw), or placements in space; world frame.
        landmarks: By number: Gaussians over (x, y), world frame, m.
        systematics: By name: Gaussians over (ahead, left, turn) at the end of the run.
        error: Half the sum of squares (robust: of losses) at the solution.
        rejected: Factors of which the gate left something out; sightings of unknown landmarks and of the floor
            keep their loss instead.
    """

    poses: dict[int, Gaussian | Placement]
    landmarks: dict[int, Gaussian] = field(default_factory=dict)
    systematics: dict[str, Gaussian] = field(default_factory=dict)
    error: float = 0.0
    rejected: list[Factor] = field(default_factory=list)


def smooth(
    factors: Sequence[Factor],
    start: Gaussian,
    systematics: Sequence[Systematic] = (),
    config: SmootherConfig | None = None,
) -> list[Gaussian]:
    """The poses of a run on the floor, from all that was measured.

    Args:
        factors: In any order; poses are numbered, gaps are allowed.
        start: Of the pose with the lowest number, over (x, y, yaw), world frame.
        systematics: Errors that effects of the factors refer to.
        config: The defaults if None.

    Returns:
        In order of their numbers, over (x, y, yaw), m and rad, world frame.

    Raises:
        InputError: A pose is connected with nothing, or the factors do not determine it.
    """
    poses = solve(factors, start, systematics, config).poses
    return [pose for pose in poses.values() if isinstance(pose, Gaussian)]


def smooth_in_space(
    factors: Sequence[Factor], start: Placement, config: SmootherConfig | None = None
) -> list[Placement]:
    """The same in space: odometry steps, floors, closures."""
    poses = solve(factors, start, (), config).poses
    return [pose for pose in poses.values() if isinstance(pose, Placement)]


def solve(
    factors: Sequence[Factor],
    start: Gaussian | Placement | None,
    systematics: Sequence[Systematic] = (),
    config: SmootherConfig | None = None,
) -> Solution:
    """Everything that the factors determine, with marginal covariances.

    Args:
        factors: In any order.
        start: Of the pose with the lowest number; None if poses were seen from outside.
        systematics: Errors that effects of the factors refer to.
        config: The defaults if None.

    Raises:
        InputError: There are no factors, a pose is connected with nothing, or is not determined.
    """
    import gtsam

    from . import graph as native

    config = config or SmootherConfig()
    numbers = sorted({number for factor in factors for number in poses_of(factor)})
    if not numbers:
        raise InputError("smoother: no factors were given; expected at least one motion")
    factors = [*([] if start is None else [PoseSeen(numbers[0], start)]), *factors]
    one_kind(factors)
    guesses = native.first_guesses(factors, {})
    stiff = bool(systematics) or any(isinstance(factor, FloorSeen) for factor in factors)
    try:
        draft = _draft_by_stages(_stages(factors), systematics, config, stiff)
    except (InputError, RuntimeError):  # not lived through in order of the numbers
        draft = _Draft(native.Graph(systematics))
        draft.add(factors, guesses, {})
    built, values, graph = draft.built, draft.values, draft.graph
    rejected: list[int] = []
    try:
        values = _optimised(built, values, config, stiff)
        if config.outliers == "gate":
            built, values, rejected = _gated(built, values, draft.doubted, config, stiff)
        marginals = gtsam.ISAM2(
            incremental(config, stiff)
        )  # gtsam.Marginals cannot be told to use QR
        marginals.update(built, values)
        poses = {}
        for number in numbers:
            covariance = marginals.marginalCovariance(native.pose_key(number))
            poses[number] = native.belief(_at(values, number, guesses[number]), covariance)
        landmarks = {
            number: Gaussian(values.atPoint2(key), marginals.marginalCovariance(key))
            for number, key in sorted(graph.landmark_keys.items())
        }
        errors = {
            name: Gaussian(values.atPoint3(key), marginals.marginalCovariance(key))
            for name, key in graph.systematic_keys.items()
        }
    except RuntimeError as error:
        raise undetermined(error) from error
    for number, pose in poses.items():
        check_possible(number, pose)
    return Solution(
        poses, landmarks, errors, float(built.error(values)), [draft.owners[i] for i in rejected]
    )


class _Draft:
    """A graph under construction, with first values of its variables."""

    def __init__(self, graph: Graph) -> None:
        import gtsam

        self.graph = graph
        self.built = gtsam.NonlinearFactorGraph()
        self.values = gtsam.Values()
        self.owners: list[Factor] = []
        self.doubted: list[int] = []

    def add(
        self,
        factors: Sequence[Factor],
        guesses: Mapping[int, Pose2 | Pose3],
        known: Mapping[int, Pose2 | Pose3],
    ) -> tuple[Any, Any]:
        """Our factors as native ones; those and the values that came with them."""
        for number, pose in known.items():
            self.graph.recall_pose(number, pose)
        for number in sorted(set(guesses) - set(known)):
            self.graph.add_pose(number, guesses[number])
        count = len(self.owners)
        for factor in factors:
            self.graph.add(factor)
            self.owners += [factor] * (count + self.graph.factors.size() - len(self.owners))
        self.doubted += [count + i for i in self.graph.doubted]
        native, values, _ = self.graph.take()
        self.built.push_back(native)
        self.values.insert(values)
        return native, values


def _draft_by_stages(
    stages: Sequence[Sequence[Factor]],
    systematics: Sequence[Systematic],
    config: SmootherConfig,
    stiff: bool,
) -> _Draft:
    """Live through the run once: dead reckoning to the end would lead the optimiser astray.

    Closures, of which some may be wrong, come in at the end.
    """
    import gtsam

    from . import graph as native

    draft = _Draft(native.Graph(systematics))
    rough = replace(config, relinearise=0.1)  # the optimiser does the rest
    engine = gtsam.ISAM2(incremental(rough, stiff))
    poses: dict[int, Pose2 | Pose3] = {}
    *stages, closures = stages
    for factors in stages:
        told = {number for factor in factors for number in poses_of(factor)}
        known = {}
        for number in told & set(poses):
            key = native.pose_key(number)
            planar = isinstance(poses[number], Pose2)
            mean = (
                engine.calculateEstimatePose2(key) if planar else engine.calculateEstimatePose3(key)
            )
            known[number] = native.from_native(mean)
        guesses = native.first_guesses(factors, known)
        engine.update(*draft.add(factors, guesses, known))
        poses.update(guesses)
    draft.values = engine.calculateEstimate()
    known = {n: native.from_native(_at(draft.values, n, poses[n])) for n in sorted(poses)}
    draft.add(closures, known, known)
    return draft


def _stages(factors: Sequence[Factor]) -> list[list[Factor]]:
    """What each pose in turn brought that was not known before; the closures last."""
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


def incremental(config: SmootherConfig, stiff: bool) -> Any:
    """Parameters of iSAM2; stiff graphs (systematic errors, floors) are too much for Cholesky's method."""
    import gtsam

    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR" if stiff else "CHOLESKY")
    parameters.setRelinearizeThreshold(config.relinearise)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters


def _parameters(config: SmootherConfig, stiff: bool) -> Any:
    import gtsam

    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(config.iterations)
    if stiff:
        parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-7)
    parameters.setAbsoluteErrorTol(1e-7)
    return parameters


def _optimised(built: Any, values: Any, config: SmootherConfig, stiff: bool) -> Any:
    import gtsam

    return gtsam.LevenbergMarquardtOptimizer(built, values, _parameters(config, stiff)).optimize()


def _gated(
    built: Any, values: Any, doubted: Sequence[int], config: SmootherConfig, stiff: bool
) -> tuple[Any, Any, list[int]]:
    """The graph with every doubted factor in, by its square, or out; where it then lies; and which are out.

    Begins where the losses led.
    """
    import gtsam

    rejected: list[int] | None = None
    kept = built
    for _ in range(GATE_ROUNDS):
        outside = [i for i in doubted if _outside(built.at(i), values, config.gate_probability)]
        if outside == rejected or not doubted:
            break
        rejected = outside
        kept = gtsam.NonlinearFactorGraph()
        plain, out = set(doubted), set(outside)
        for i in range(built.size()):
            factor = built.at(i)
            if i not in plain:
                kept.add(factor)
            elif i not in out:
                kept.add(factor.cloneWithNewNoiseModel(factor.noiseModel().noise()))
        values = _optimised(kept, values, config, stiff)
    return kept, values, rejected or []


def _outside(factor: Any, values: Any, probability: float) -> bool:
    """Whether a factor with a loss fits so badly that it means something else."""
    noise = factor.noiseModel().noise()
    squared = noise.squaredMahalanobisDistance(factor.unwhitenedError(values))
    return bool(squared > chi_square_quantile(probability, noise.dim()))


def one_kind(factors: Iterable[Factor]) -> None:
    """Refuse a mixture of factors on the floor and in space."""
    if len({_in_space(factor) for factor in factors}) > 1:
        raise InputError("smoother: factors on the floor and in space are mixed; give one kind")


def _in_space(factor: Factor) -> bool:
    if isinstance(factor, (Motion, LoopClosure)):
        return isinstance(factor.motion, Pose3)
    if isinstance(factor, PoseSeen):
        return isinstance(factor.place, Placement)
    return isinstance(factor, FloorSeen)


def check_possible(number: int, pose: Gaussian | Placement) -> None:
    """Refuse a marginal that says nothing."""
    variances = np.diag(pose.covariance)
    if not np.all((variances > 0.0) & (variances < IMPOSSIBLE_M**2)):
        raise InputError(
            f"pose {number} is not determined: variances {variances}; give the motions that lead to it "
            "or where it was seen from outside"
        )


def undetermined(error: RuntimeError) -> InputError:
    """What GTSAM says of a singular system, for who gave the factors."""
    return InputError(
        "smoother: the factors do not determine every pose "
        f"({str(error).strip().splitlines()[0]}); give a start or more measurements"
    )
