"""Where am I, with the last seconds still open: a smoother that goes along with the run.

iSAM2 keeps the factorised problem and redoes, at every instant, only what the new measurements touch. What is
older than the lag is marginalised: its poses are no longer changed, what they told of the rest stays.

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
from .smoother import SmootherConfig, check_possible, incremental, one_kind, undetermined

if TYPE_CHECKING:
    from .graph import Graph


class FixedLagSmoother:
    """The poses of the last seconds, from all that was measured up to now; `update` advances it.

    What leaves the window is marginalised: it goes on to speak through what it has told of the rest. With an
    infinite lag nothing leaves, and every update costs what it changes (iSAM2).
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
        self._asked: dict[int, Any] = {}  # poses that were asked for since the last update
        self._broken = False
        parameters = incremental(self.config, bool(systematics) or not self._planar)
        self._endless = math.isinf(self.config.lag_s)
        self._engine: Any = (
            gtsam.ISAM2(parameters)
            if self._endless
            else gtsam.IncrementalFixedLagSmoother(self.config.lag_s, parameters)
        )

    @property
    def window(self) -> dict[int, float]:
        """Stamps, s, of the poses that can be asked for, by number, oldest first."""
        return dict(self._stamps)

    def update(self, stamp_s: float, factors: Sequence[Factor]) -> None:
        """Take in what was measured at an instant.

        Args:
            stamp_s: Of the instant, not before that of the update before; new poses get it.
            factors: May speak of new poses and of those in the window.

        Raises:
            InputError: Time goes back, a factor speaks of a pose that was forgotten or that nothing leads to, or
                the factors do not determine a pose.
        """
        from .graph import first_guesses

        if self._broken:
            raise InputError("smoother: an update failed before; begin a new smoother")
        newest = next(reversed(self._stamps.values()), stamp_s)
        if not (math.isfinite(stamp_s) and stamp_s >= newest):
            raise InputError(
                f"smoother: stamp_s={stamp_s} lies before {newest}; give them in order"
            )
        if not self._begun:
            factors = [self._anchor, *factors]
        one_kind([self._anchor, *factors])
        told = {number for factor in factors for number in poses_of(factor)}
        known = {number: self.mean(number) for number in told if number in self._stamps}
        guesses = first_guesses(factors, known)
        self._begun = True
        for number, pose in known.items():
            self._graph.recall_pose(number, pose)
        for number in sorted(told - set(known)):
            self._graph.add_pose(number, guesses[number])
        for factor in factors:
            self._graph.add(factor)
        self._advance(stamp_s)
        for number in sorted(told - set(known)):
            self._stamps[number] = stamp_s
        self._forget(stamp_s)

    def pose(self, number: int) -> Gaussian | Placement:
        """What is now believed of a pose in the window, with its marginal covariance.

        Raises:
            InputError: It is not in the window.
        """
        from .graph import belief, pose_key

        native = self._native(number)
        try:
            covariance = self._engine.marginalCovariance(pose_key(number))
        except RuntimeError as error:
            raise undetermined(error) from error
        believed = belief(native, covariance)
        check_possible(number, believed)
        return believed

    def mean(self, number: int) -> Pose2 | Pose3:
        """The same without the covariance, which costs most of the time."""
        from .graph import from_native

        return from_native(self._native(number))

    def systematic(self, name: str) -> Gaussian:
        """What is now believed of a systematic error, over (ahead, left, turn) per unit."""
        keys = self._graph.systematic_keys
        if name not in keys:
            raise InputError(f"systematic error {name!r} is in no factor yet; known: {list(keys)}")
        mean = self._engine.calculateEstimatePoint3(keys[name])
        return Gaussian(mean, self._engine.marginalCovariance(keys[name]))

    def _native(self, number: int) -> Any:
        from .graph import pose_key

        if number not in self._stamps:
            raise InputError(
                f"pose {number} is not in the window of the last {self.config.lag_s} s"
            )
        if number not in self._asked:
            key, engine = pose_key(number), self._engine
            self._asked[number] = (
                engine.calculateEstimatePose2(key)
                if self._planar
                else engine.calculateEstimatePose3(key)
            )
        return self._asked[number]

    def _advance(self, stamp_s: float) -> None:
        """Hand what is new to the engine."""
        factors, values, passing = self._graph.take()
        self._asked.clear()
        try:
            if self._endless:
                self._engine.update(factors, values)
            else:
                stamped = dict.fromkeys([*passing, *self._graph.lasting], stamp_s)
                self._engine.update(factors, values, stamped)
        except RuntimeError as error:
            self._broken = True
            raise undetermined(error) from error

    def _forget(self, stamp_s: float) -> None:
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
    """A whole run with a fixed lag: every pose as believed when it left the window.

    Args:
        frames: (stamp in s, factors of that instant) in order of time; pose 0 belongs to the first.
        start: Of pose 0, over (x, y, yaw), world frame.
        systematics: Errors that effects of the factors refer to.
        config: The lag; the defaults if None.

    Returns:
        In order of the poses' numbers, each from what was measured until `lag_s` after it.
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
