"""Faults by name, when they happen, and their injection into the frames of a run."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.frame import Frame
from perception.primitives.settings import setting

from ..ranges import check_ranges
from .fault import Fault
from .motion import ClockDrift, ClockJump, Dropped, GyroBias, LostOdometry, SlippingFoot
from .pictures import Blackout, EncoderOffset, Frozen, HalfBlind, Late, Miscalibrated


@dataclass(frozen=True)
class Kind:
    """A fault that can be asked for.

    Args:
        make: Makes it from its value and a source of chance.
        value: Its usual value; None: it takes none.
        least, most: The value lies between, without the limits themselves.
    """

    make: Callable[[float, np.random.Generator], Fault]
    value: float | None = None
    least: float = 0.0
    most: float = math.inf


KINDS: dict[str, Kind] = {
    "frozen": Kind(lambda v, rng: Frozen()),
    "late": Kind(lambda v, rng: Late(v), 0.4, 0.0, 5.0),  # s
    "half-blind": Kind(lambda v, rng: HalfBlind()),
    "blackout": Kind(lambda v, rng: Blackout()),
    "miscalibrated": Kind(lambda v, rng: Miscalibrated(v), 3.0, -45.0, 45.0),  # deg
    "encoder-offset": Kind(lambda v, rng: EncoderOffset(v), 5.0, -45.0, 45.0),  # deg
    "lost-odometry": Kind(lambda v, rng: LostOdometry()),
    "slipping-foot": Kind(lambda v, rng: SlippingFoot(v), 0.4, 0.0, 0.9),  # share of each step
    "gyro-bias": Kind(lambda v, rng: GyroBias(v), 10.0, -500.0, 500.0),  # deg/s
    "clock-jump": Kind(lambda v, rng: ClockJump(v), 1.0, -1e6, 1e6),  # s
    "clock-drift": Kind(lambda v, rng: ClockDrift(v), 0.02, -0.5, 1.0),  # share
    "dropped": Kind(lambda v, rng: Dropped(v, rng), 0.2, 0.0, 1.0),  # share of the frames
}
"""Name to fault, in the order in which several are applied: cameras, motion, clock, loss."""


@dataclass(frozen=True)
class FaultConfig:
    """Which faults a simulated run has, and when."""

    inject: tuple[str, ...] = setting(
        (), "", "faults of a simulated run, NAME or NAME:VALUE, such as dropped:0.2", "ours"
    )
    begin_s: float = setting(8.0, "s", "time after the start at which the faults begin", "ours")
    last_s: float = setting(6.0, "s", "time after which they end, to see the recovery", "ours")

    def __post_init__(self) -> None:
        check_ranges("faults", self, begin_s=(0.0, 1e6), last_s=(0.0, 1e6))
        for text in self.inject:
            parsed(text)


def parsed(text: str) -> tuple[str, float]:
    """Name and value of a fault.

    Args:
        text: NAME or NAME:VALUE.

    Raises:
        ConfigError: The name is unknown, or the value is none that this fault takes.
    """
    name, colon, given = text.partition(":")
    kind = KINDS.get(name)
    if kind is None:
        near = difflib.get_close_matches(name, KINDS, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ConfigError(f"fault {name!r} is unknown; {hint}choose {', '.join(KINDS)}")
    if not colon:
        return name, kind.value or 0.0
    if kind.value is None:
        raise ConfigError(f"fault {text!r}: {name} takes no value; write {name}")
    try:
        value = float(given)
    except ValueError:
        value = math.nan
    if not kind.least < value < kind.most:
        raise ConfigError(
            f"fault {text!r}: expected a number between {kind.least:g} and {kind.most:g}, "
            f"such as {name}:{kind.value:g}"
        )
    return name, value


class FaultInjector:
    """Puts the faults of a run into its frames."""

    def __init__(self, config: FaultConfig, seed: int) -> None:
        """Begin before the first frame; the seed decides on what is random."""
        self._config = config
        order = list(KINDS)
        asked = sorted(map(parsed, config.inject), key=lambda one: order.index(one[0]))
        self._faults: list[tuple[str, Fault]] = [
            (name, KINDS[name].make(value, np.random.default_rng([seed, 35, order.index(name)])))
            for name, value in asked
        ]
        self._first_s: float | None = None
        self._touched: set[str] = set()

    def touched(self) -> list[str]:
        """Faults that have changed or lost a frame since the last call: for the evaluation."""
        found, self._touched = sorted(self._touched), set()
        return found

    def apply(self, frame: Frame) -> Frame | None:
        """The frame as the stack receives it; None if it is lost."""
        if self._first_s is None:
            self._first_s = frame.stamp_s
        since_s = frame.stamp_s - self._first_s - self._config.begin_s
        active = 0.0 <= since_s < self._config.last_s
        for name, fault in self._faults:
            after = fault.apply(frame, active)
            if after is not frame and active:
                self._touched.add(name)
            if after is None:
                return None
            frame = after
        return frame
