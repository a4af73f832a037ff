"""The floor: the plane the robot stands on, how sure we are of it, and what rises from it.

Read in this order: `prior` (where it should be), `sample` (a few points, and what makes a plane a floor),
`ransac` and `hough` (two ways to think of a plane), `refine` (the fit to all points and its covariance),
`choose` (find, which joins them), then `classify` (floor, obstacle, hole, overhang).

Source: seed 003, sections 3 and 5.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .choose import Floor, FloorConfig, find

__all__ = ["Floor", "FloorConfig", "find"]


def __getattr__(name: str) -> Any:
    """Floor, FloorConfig and find on demand: the package itself imports nothing."""
    if name in __all__:
        from . import choose

        return getattr(choose, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
