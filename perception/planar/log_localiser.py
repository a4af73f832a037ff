"""Localisation of a log that nobody tuned: start, biases and noise come from the log, and a lost robot is lost.

No start is believed: the robot is lost until `fix` finds its pose from the sightings. Then a planar filter
follows it, with the scales and the drift of the odometry, and scale and offset of the distances, as states; sizes
and correlation times of the noise maximise the likelihood of the part of the log after the fix.

Odometry of commands tells no motion that a robot makes after them, for instance of a turn that runs on. After a few rejected
sightings in a row the pose is as unsure as if the odometry had missed the motion since. If too many of the last
sightings are rejected all the same, the filter is locked out: the robot is lost again and waits for the next fix.

A landmark whose sightings are rejected while those of the others fit is not where the map has it: somebody moved it, or the
tags of two are exchanged. These rejections lock nothing out, and its next sightings are ignored; then some are tried again.

The claim is at least as wide as the innovations: the covariance is multiplied by their NIS over its expectation, of
many sightings or of the last three, where that is above one. Stamps of odometry and sightings that disagree make the
pose unsure along its motion.

Source: ours.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..filtering.consistency import chi_square_quantile
from ..primitives.gaussian import Gaussian
from ._planar_kernels import GAIN, OFFSET
from .config import PlanarConfig
from .fix import Fix, find_fix
from .planar import Journey, PlanarFilter, PlanarPrior
from .planar_fit import fit_sizes
from .planar_log import PlanarLog

MARGIN = 2.0  # ours: on the covariance; errors common to a direction show in no innovation
WINDOW = 20  # ours: last sightings that tell whether the filter is locked out
LOCKED_OUT = 0.4  # ours: share of them that is rejected; 20 % of outliers exceed it once in a hundred windows
TOO_SURE = 4.0 * MARGIN  # ours: median NIS of them over its expectation: errors twice the claim
TRIED, MISPLACED = 8, 7
"""Ours: last sightings of a landmark, and those of them whose rejection tells that it is elsewhere; outliers of 20 % seem so
once in ten thousand sightings."""
IN_PLACE = 0.2  # ours: share of the other landmarks' last sightings that may be rejected meanwhile
LEAST_SLIP = 1e-3  # ours: m and rad; of a robot that stands
SLIP = 3  # ours: rejected sightings in a row that tell of a slip; of 20 % outliers once in a hundred sightings
IGNORED = 100  # ours: sightings of such a landmark before it is tried again
LONGEST_S = 120.0  # ours: stretch of odometry that a fix bridges
FIRST_PART, FIRST_S = 600, 120.0
"""Ours: the noise is told by so many sightings after a fix, and so many seconds, of a robot in motion. One that stands repeats
its errors, and a filter fitted to them would average them."""
MOST_FITTED = 1200  # ours: sightings of that part that are used
FIT_INTERVAL_S = 0.5  # ours: longest step of the odometry there; a longer one would cut corners
RECENT = 3  # ours: last sightings that tell of a slip
SURPRISE = 0.865  # quantile of one NIS that the median of three exceeds once in twenty triples
RECOVERY = 0.05  # ours: of the map; the filter that tells the noise goes on after an event
OUTLIER = 0.05  # ours: share of outliers that is expected
GATE = MARGIN * chi_square_quantile(0.9997, 2)  # ours: four standard deviations of the claim

Say = Callable[[str], None]


@dataclass(frozen=True)
class LocalisedLog:
    """The pose at every instant of a log.

    Args:
        stamps_s: (n,) the instants.
        means: (n, 3) x, y, yaw; of a lost robot the middle of the map.
        covariances: Of these; of a lost robot as wide as the map, heading open.
        lost: Whether the pose is unknown.
        rejected: (n,) share of the last sightings that the filter rejected; 0 while lost.
        fixes: Number of times that the pose was found.
        config: Noise after the last fix; None without one.
        ignored: (l,) sightings of each landmark that were ignored because it is elsewhere.
        delay_s: Of the motion after its odometry.
        final: Last state of the filter, entries as in the kernels; None without a fix.
    """

    stamps_s: Float[np.ndarray, "n"]
    means: Float[np.ndarray, "n 3"]
    covariances: Float[np.ndarray, "n 3 3"]
    lost: Bool[np.ndarray, "n"]
    rejected: Float[np.ndarray, "n"]
    fixes: int
    config: PlanarConfig | None
    ignored: Int[np.ndarray, "l"]
    delay_s: float
    final: Float[np.ndarray, "s"] | None


def localise(
    log: PlanarLog, guess: PlanarConfig | None = None, say: Say | None = None
) -> LocalisedLog:
    """The pose of a robot at every instant of its log.

    Args:
        log: Odometry and sightings.
        guess: Noise, which the log corrects; the defaults if None.
        say: Takes lines of progress.
    """
    return _Localiser(log.without_jumps(), guess or PlanarConfig(), say or (lambda _: None)).run()


def log_prior(log: PlanarLog) -> PlanarPrior:
    """Systematic errors of a robot that nobody calibrated.

    Odometry: scales within tenths, a drift of a degree per second. Radio ranges: scale and offset within tenths
    of the distance. A camera is calibrated, and sits near the middle of the body.
    """
    ranged = bool(np.all(np.isnan(log.seen[:, 1])))
    return PlanarPrior(
        odometry_scale_sigma=0.1,
        turn_scale_sigma=0.1,
        drift_sigma=math.radians(1.0),
        gain_sigma=0.1 if ranged else 0.02,
        offset_sigma=0.1 * float(np.median(log.seen[:, 0])) if ranged else 0.05,
    )


class _Localiser:
    """Walks through the log, lost or with a filter."""

    def __init__(self, log: PlanarLog, guess: PlanarConfig, say: Say) -> None:
        self.log, self.guess, self.say = log, guess, say
        self.prior = log_prior(log)
        self.delay_s, self.fixes = 0.0, 0
        self.config: PlanarConfig | None = None
        self.journey = log.journey()
        self.stamps = log.instants()
        self.filter: PlanarFilter | None = None
        self.places = {mark: (float(x), float(y)) for mark, (x, y) in enumerate(log.places)}
        self.nowhere = _nowhere(log)
        self.ignored = np.zeros(len(log.places), np.int64)
        self._forget()
        self.since = 0
        self.next_try_s = 0.0

    def run(self) -> LocalisedLog:
        """The whole log."""
        n = len(self.stamps)
        means, covariances = np.empty((n, 3)), np.empty((n, 3, 3))
        lost, rejected = np.zeros(n, bool), np.zeros(n)
        for i in range(n):
            if self.filter is None:
                self._seek(i)
            else:
                self._follow(i)
            pose = self.nowhere if self.filter is None else self.filter.pose
            lost[i] = self.filter is None
            claim = 1.0 if self.filter is None else MARGIN * self.inflation
            means[i], covariances[i] = pose.mean, claim * pose.covariance
            rejected[i] = self.rejected
        covariances[~lost] += self._of_clocks(means)[~lost]
        final = None if self.filter is None else self.filter.state
        return LocalisedLog(
            self.stamps, means, covariances, lost, rejected, self.fixes, self.config, self.ignored, self.delay_s, final
        )  # fmt: skip

    def _of_clocks(self, means: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Covariance by the delay between odometry and sightings: nobody knows which of their clocks is right."""
        totals = np.cumsum(self.journey.steps[:, 1:], axis=0).T
        before = self.stamps - abs(self.delay_s)
        path, turn = (total - np.interp(before, self.stamps, total) for total in totals)
        moved = np.stack([path * np.cos(means[:, 2]), path * np.sin(means[:, 2]), turn], axis=-1)
        return moved[:, :, None] * moved[:, None, :]

    def _follow(self, i: int) -> None:
        """One instant of the filter."""
        assert self.filter is not None
        self.filter.predict(*self.journey.steps[i].tolist())
        for row in range(self.journey.first_row[i], self.journey.first_row[i + 1]):
            seen, mark = self.journey.seen[row], int(self.journey.marks[row])
            if self.elsewhere.get(mark, 0) > 0:
                self.elsewhere[mark] -= 1
                self.ignored[mark] += 1
                continue
            used = self.filter.update(mark, seen)
            freedom = 1 if math.isnan(seen[1]) else 2
            usual, now = (chi_square_quantile(one, freedom) for one in (0.5, SURPRISE))
            self.marks.append((i, used, self.filter.nis / usual, self.filter.nis / now, mark))
            self._judge(mark, used)
        locked_out = False
        if self.marks and self.journey.first_row[i] < self.journey.first_row[i + 1]:
            self.rejected = float(np.mean([not one[1] for one in self.marks]))
            if len(self.marks) >= WINDOW // 2:
                usual = float(np.median([one[2] for one in self.marks]))
                now = float(np.median([one[3] for one in list(self.marks)[-RECENT:]]))
                self.inflation = max(1.0, usual, now)
            judged = [one for one in self.marks if one[1] or not self._others_fit(one[4])]
            if len(judged) >= WINDOW // 2:
                rejected = float(np.mean([not one[1] for one in judged]))
                usual = float(np.median([one[2] for one in judged]))
                locked_out = rejected > LOCKED_OUT or usual > TOO_SURE
        wide = (
            float(np.max(np.diag(self.filter.pose.covariance)[:2]))
            > self.nowhere.covariance[0, 0] / 4.0
        )
        if locked_out or wide:
            self.say(f"locked out at {self.stamps[i] - self.stamps[0]:.0f} s")
            self.filter, self.since = None, self.marks[0][0] if self.marks else i
            self.next_try_s = 0.0
            self._forget()

    def _judge(self, mark: int, used: bool) -> None:
        """Find out whether a landmark is elsewhere, by its sightings and those of the others."""
        if not self._others_fit(mark):
            return  # the filter may be wrong
        tried = self.tried.setdefault(mark, deque(maxlen=TRIED))
        tried.append(used)
        if tried.count(False) >= MISPLACED:
            self.elsewhere[mark] = IGNORED
            tried.clear()
            left = [one for one in self.marks if one[4] != mark]
            self.marks.clear()
            self.marks.extend(left)

    def _others_fit(self, mark: int) -> bool:
        """Whether the last sightings of the other landmarks fit, so that one that does not is elsewhere."""
        others = [one[1] for one in self.marks if one[4] != mark]
        return len(others) >= WINDOW // 4 and float(np.mean(others)) >= 1.0 - IN_PLACE

    def _seek(self, i: int) -> None:
        """Look for the pose from the sightings since the robot is lost."""
        now = float(self.stamps[i])
        while now - self.stamps[self.since] > LONGEST_S:
            self.since += 1
        if now < self.next_try_s or self.journey.first_row[i] == self.journey.first_row[i + 1]:
            return
        self.next_try_s = now + max(1.0, 0.2 * (now - float(self.stamps[self.since])))
        middle = (self.since + i) // 2  # what locked the filter out may be in the first half
        fix = find_fix(self.journey, self.since, i + 1, self.prior) or find_fix(
            self.journey, middle, i + 1, self.prior
        )
        if fix is None:
            return
        self.fixes += 1
        self.say(f"found at {now - self.stamps[0]:.0f} s")
        mean = fix.state.mean.copy()  # the filter counts from the offset and scale of the guess
        mean[OFFSET] -= self.guess.offset
        mean[GAIN] -= self.guess.scale - 1.0
        start = Gaussian(mean, fix.state.covariance)
        self._fit(fix, start, i + 1)
        self.filter = PlanarFilter(start, self.places, self.config, self.prior)

    def _fit(self, fix: Fix, start: Gaussian, first: int) -> None:
        """Noise by the part of the log after a fix; the delay by the first."""
        guess = self._guess(fix)
        now = self.stamps[first - 1]
        log = self.log.first_part(float(now), FIRST_PART, FIRST_S, MOST_FITTED)
        later = np.append(now, log.seen_s)
        instants = np.unique(np.append(np.arange(now, later[-1], FIT_INTERVAL_S), later))

        def part(delay_s: float) -> Journey:
            delay_s = delay_s if self.fixes == 1 else self.delay_s
            return dataclasses.replace(log.journey(delay_s, instants), start=start)

        config, delay_s = fit_sizes(part, guess, self.delay_s, self.prior)
        if self.fixes == 1:
            self.delay_s, self.journey = delay_s, self.log.journey(delay_s)
        slip_m, slip_rad = _slip(self.log)
        self.config = dataclasses.replace(
            config, recover_after=SLIP, recovery_m=slip_m, recovery_rad=slip_rad
        )

    def _guess(self, fix: Fix) -> PlanarConfig:
        """The guess with noise of sightings as large as the residuals of a fix, half by each of its two terms."""
        distances = np.abs(self.log.seen[:, 0])
        far, guess = float(np.median(distances)), self.guess
        bearing = math.hypot(guess.bearing_sigma, guess.bearing_shared)
        by_bearing = 1.0 if math.isnan(fix.sigma_rad) else fix.sigma_rad / bearing
        depth = fix.sigma_m / math.sqrt(2.0)
        return dataclasses.replace(
            guess,
            depth_near=depth,
            depth_far=depth / far**2,
            bearing_sigma=guess.bearing_sigma * by_bearing,
            bearing_shared=guess.bearing_shared * by_bearing,
            outlier=OUTLIER,
            outlier_density=1.0 / float(distances.max()),
            gate=GATE,
            recovery_m=RECOVERY * float(np.linalg.norm(np.ptp(self.log.places, axis=0))),
        )

    def _forget(self) -> None:
        """Begin to judge the filter anew."""
        self.marks: deque[tuple[int, bool, float, float, int]] = deque(maxlen=WINDOW)
        self.tried: dict[int, deque[bool]] = {}  # last sightings of each landmark: used or not
        self.elsewhere: dict[int, int] = {}  # sightings of a landmark that are still to be ignored
        self.rejected, self.inflation = 0.0, 1.0


def _slip(log: PlanarLog) -> tuple[float, float]:
    """Standard deviations, m and rad, that let the gate reach as far as the robot moves in the time of `SLIP` sightings."""
    start, end = log.stamps_s[[0, -1]]
    seconds = SLIP * float(np.median(np.diff(np.unique([start, *log.seen_s, end]))))
    at = np.linspace(start, end, 1 + math.ceil((end - start) / seconds))
    moved = np.diff([np.interp(at, log.stamps_s, total) for total in log.totals.T])
    farthest = np.maximum(np.percentile(np.abs(moved), 99.0, axis=1), LEAST_SLIP)
    path, turn = (farthest / math.sqrt(GATE)).tolist()
    return path, turn


def _nowhere(log: PlanarLog) -> Gaussian:
    """The claim of a lost robot: anywhere on the map."""
    far = float(np.median(np.abs(log.seen[:, 0])))
    size = float(np.linalg.norm(np.ptp(log.places, axis=0))) + far
    sigmas = np.array([size / 2.0, size / 2.0, math.pi / math.sqrt(3.0)])
    return Gaussian(np.append(log.places.mean(axis=0), 0.0), np.diag(sigmas**2))
