"""Difficulty of a scene: parameters interpolated between easy (0), usual (0.5) and hard (1).

A harder scene has more objects, more and faster moving ones, and narrower passages. Source: ours.
"""

from __future__ import annotations

from perception.primitives.errors import ConfigError

USUAL = 0.5

Span = tuple[float, float]


def check(difficulty: float) -> None:
    """Check a difficulty.

    Raises:
        ConfigError: It lies outside [0, 1].
    """
    if not 0.0 <= difficulty <= 1.0:
        raise ConfigError(f"difficulty={difficulty} must lie in [0, 1]; 0.5 is the usual scene")


def interpolated(difficulty: float, easy: float, usual: float, hard: float) -> float:
    """A parameter at a difficulty; exactly the three given values at 0, 0.5 and 1."""
    share = 2.0 * (difficulty - USUAL)
    end = hard if share > 0.0 else easy
    return end if abs(share) == 1.0 else usual + abs(share) * (end - usual)


def interpolated_count(difficulty: float, easy: int, usual: int, hard: int) -> int:
    """The same for an integer."""
    return round(interpolated(difficulty, float(easy), float(usual), float(hard)))


def interpolated_span(difficulty: float, easy: Span, usual: Span, hard: Span) -> Span:
    """The same for both ends of a range."""
    low, high = (interpolated(difficulty, *ends) for ends in zip(easy, usual, hard, strict=True))
    return low, high
