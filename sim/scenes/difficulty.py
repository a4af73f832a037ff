"""How a scene's measures follow its difficulty: easy at 0, usual at 0.5, hard at 1, straight lines between.

More static_objects, more and faster moving_objects, narrower ways. At 0.5 a scene is to the bit what it is without difficulty.
Source: ours.
"""

from __future__ import annotations

from perception.primitives.errors import ConfigError

USUAL = 0.5

Span = tuple[float, float]


def check(difficulty: float) -> None:
    """Refuse what is no difficulty.

    Raises:
        ConfigError: It lies outside [0, 1].
    """
    if not 0.0 <= difficulty <= 1.0:
        raise ConfigError(f"difficulty={difficulty} must lie in [0, 1]; 0.5 is the scene as usual")


def interpolated(difficulty: float, easy: float, usual: float, hard: float) -> float:
    """The measure at a difficulty; at 0, 0.5 and 1 exactly the three given."""
    share = 2.0 * (difficulty - USUAL)
    end = hard if share > 0.0 else easy
    return end if abs(share) == 1.0 else usual + abs(share) * (end - usual)


def interpolated_count(difficulty: float, easy: int, usual: int, hard: int) -> int:
    """The same for a number of static_objects."""
    return round(interpolated(difficulty, float(easy), float(usual), float(hard)))


def interpolated_span(difficulty: float, easy: Span, usual: Span, hard: Span) -> Span:
    """The same for both ends of what is drawn between."""
    low, high = (interpolated(difficulty, *ends) for ends in zip(easy, usual, hard, strict=True))
    return low, high
