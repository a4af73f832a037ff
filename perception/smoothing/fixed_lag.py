"""Fixed-lag smoothing: the poses of the last seconds, updated during the run.

iSAM2 keeps the factorised problem and recomputes only what new measurements affect. Poses older than the lag
are marginalised: they no longer change, and their information on the others is kept.

Source: Kaess et al., "iSAM2: incremental smoothing and mapping using the Bayes tree" (2012), as in GTSAM.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..primitives.errors import InputError
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2, Pose3
from .factors import Factor, Placement, PoseSeen, Systematic, poses_of
from .smoother import (
    SmootherConfig,
    check_dimension,
    check_marginal,
    isam2_parameters,
    underdetermined,
)

if TYPE_CHECKING:
    from .graph import Graph


class FixedLagSmoother:
    """Incremental smoother over a window of time.

    Poses that leave the window are marginalised. With an infinite lag none does (iSAM2).
    """

    def __init__(
        self,
        start: Gaussian | Placement,
        systematics: Sequence[Systematic] = (),
        config: SmootherConfig | None = None,
    ) -> None:
        """Begin at pose 0.

        Args:
            start: Of pose 0, over (x, y, yaw) or in space, world frame; its stamp is that of the first update.
            systematics: Errors that effects of the factors refer to.
            config: The defaults if None.
        """
        import gtsam

        from .graph import Graph

        self.config = config or SmootherConfig()
        self._graph: Graph = Graph(systematics)
        self._planar = isinstance(start, Gaussian)
        self._anchor = PoseSeen(0, start)
        self._begun = False
        self._stamps: dict[int, float] = {}
        self._means: dict[int, Any] = {}  # cached since the last update
        self._broken = False
        parameters = isam2_parameters(self.config, bool(systematics) or not self._planar)
        self._unbounded = math.isinf(self.config.lag_s)
        self._isam2: Any = (
            gtsam.ISAM2(parameters)
            if self._unbounded
            else gtsam.IncrementalFixedLagSmoother(self.config.lag_s, parameters)
        )

    @property
    def window(self) -> dict[int, float]:
        """Stamps, s, of the poses in the window, by number, oldest first."""
        return dict(self._stamps)

    def update(self, stamp_s: float, factors: Sequence[Factor]) -> None:
        """Add the measurements of an instant.

        Args:
            stamp_s: Of the instant, not before that of the previous update; new poses get it.
            factors: Between new poses and those in the window.

        Raises:
            InputError: Time goes back, a factor refers to a pose that left the window or is not connected, or the
                factors do not determine a pose.
        """
        from .graph import first_guesses

        if self._broken:
            raise InputError("smoother: an earlier update failed; create a new smoother")
        newest = next(reversed(self._stamps.values()), stamp_s)
        if not (math.isfinite(stamp_s) and stamp_s >= newest):
            raise InputError(
                f"smoother: stamp_s={stamp_s} lies before {newest}; give updates in order of time"
            )
        if not self._begun:
            factors = [self._anchor, *factors]
        check_dimension([self._anchor, *factors])
        mentioned = {number for factor in factors for number in poses_of(factor)}
        known = {number: self.mean(number) for number in mentioned if number in self._stamps}
        guesses = first_guesses(factors, known)
        self._begun = True
        for number, pose in known.items():
            self._graph.recall_pose(number, pose)
        for number in sorted(mentioned - set(known)):
            self._graph.add_pose(number, guesses[number])
        for factor in factors:
            self._graph.add(factor)
        self._advance(stamp_s)
        for number in sorted(mentioned - set(known)):
            self._stamps[number] = stamp_s
        self._drop_old(stamp_s)

    def pose(self, number: int) -> Gaussian | Placement:
        """The current estimate of a pose in the window, with its marginal covariance.

        Raises:
            InputError: It is not in the window.
        """
        from .graph import marginal, pose_key

        native = self._native(number)
        try:
            covariance = self._isam2.marginalCovariance(pose_key(number))
        except RuntimeError as error:
            raise underdetermined(error) from error
        estimate = marginal(native, covariance)
        check_marginal(number, estimate)
        return estimate

    def mean(self, number: int) -> Pose2 | Pose3:
        """The same without the covariance, which takes most of the time."""
        from .graph import from_native

        return from_native(self._native(number))

    def _native(self, number: int) -> Any:
        from .graph import pose_key

        if number not in self._stamps:
            raise InputError(
                f"pose {number} is not in the window of the last {self.config.lag_s} s"
            )
        if number not in self._means:
            key, isam2 = pose_key(number), self._isam2
            self._means[number] = (
                isam2.calculateEstimatePose2(key)
                if self._planar
                else isam2.calculateEstimatePose3(key)
            )
        return self._means[number]

    def _advance(self, stamp_s: float) -> None:
        """Update iSAM2 with the new factors."""
        factors, values, passing = self._graph.take()
        self._means.clear()
        try:
            if self._unbounded:
                self._isam2.update(factors, values)
            else:
                stamped = dict.fromkeys([*passing, *self._graph.lasting], stamp_s)
                self._isam2.update(factors, values, stamped)
        except RuntimeError as error:
            self._broken = True
            raise underdetermined(error) from error

    def _drop_old(self, stamp_s: float) -> None:
        while self._stamps:
            number, stamp = next(iter(self._stamps.items()))
            if not stamp < stamp_s - self.config.lag_s:
                break
            del self._stamps[number]


def smooth_fixed_lag(
    frames: Sequence[tuple[float, Sequence[Factor]]],
    start: Gaussian,
    systematics: Sequence[Systematic] = (),
    config: SmootherConfig | None = None,
) -> list[Gaussian]:
    """A whole run with a fixed lag: every pose as estimated when it left the window.

    Args:
        frames: (stamp in s, factors of that instant) in order of time; pose 0 belongs to the first.
        start: Of pose 0, over (x, y, yaw), world frame.
        systematics: Errors that effects of the factors refer to.
        config: The lag; the defaults if None.

    Returns:
        In order of the poses' numbers, each from the measurements up to `lag_s` after it.
    """
    smoother = FixedLagSmoother(start, systematics, config)
    settled: dict[int, Gaussian | Placement] = {}
    for stamp, factors in frames:
        for number, then in smoother.window.items():
            if then >= stamp - smoother.config.lag_s:
                break
            settled[number] = smoother.pose(number)
        smoother.update(stamp, factors)
    settled.update({number: smoother.pose(number) for number in smoother.window})
    return [pose for _, pose in sorted(settled.items()) if isinstance(pose, Gaussian)]
