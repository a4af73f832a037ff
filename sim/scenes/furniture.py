"""Furniture made of boxes and cylinders, and the furnishing of a room."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..scene import Extent, Place, StaticObject
from ..shapes import Box, Cylinder, Shape, Solid, distance, outline

Parts = tuple[Shape, ...]

PASSAGE_M = 0.66  # ours: between pieces, for a body of 28 cm radius
LEAST_PIECES = 9  # ours


@dataclass(frozen=True)
class Model:
    """A kind of furniture.

    Args:
        name: Such as "sofa".
        footprint: Depth (along its own x, its front is +x) and width, m.
        build: Makes its parts about the origin; draws colours.
        wall: Whether its back is at a wall.
        albedo: Infrared reflectance.
    """

    name: str
    footprint: tuple[float, float]
    build: Callable[[np.random.Generator], Parts]
    wall: bool
    albedo: float = 0.6


@dataclass(frozen=True)
class Piece:
    """A placed piece of furniture."""

    model: Model
    static_object: StaticObject


def _colour(rng: np.random.Generator, *names: str) -> str:
    return names[int(rng.integers(len(names)))]


def _sofa(rng: np.random.Generator) -> Parts:
    cloth = "fabric/" + _colour(rng, "teal", "rust", "navy", "mustard", "slate")
    return (
        Box((0.10, 0.0, 0.21), (0.65, 1.40, 0.42), 0.0, cloth),
        Box((-0.325, 0.0, 0.40), (0.20, 1.80, 0.80), 0.0, cloth),
        Box((0.10, 0.80, 0.29), (0.65, 0.20, 0.58), 0.0, cloth),
        Box((0.10, -0.80, 0.29), (0.65, 0.20, 0.58), 0.0, cloth),
    )


def _armchair(rng: np.random.Generator) -> Parts:
    cloth = "fabric/" + _colour(rng, "mustard", "plum", "teal", "rust")
    return (
        Box((0.08, 0.0, 0.20), (0.54, 0.44, 0.40), 0.0, cloth),
        Box((-0.27, 0.0, 0.39), (0.16, 0.70, 0.78), 0.0, cloth),
        Box((0.08, 0.285, 0.28), (0.54, 0.13, 0.56), 0.0, cloth),
        Box((0.08, -0.285, 0.28), (0.54, 0.13, 0.56), 0.0, cloth),
    )


def _cupboard(rng: np.random.Generator) -> Parts:
    wood = _colour(rng, "walnut", "pine", "oak")
    return (Box((0.0, 0.0, 0.90), (0.45, 1.00, 1.80), 0.0, f"wood/{wood}", f"drawers/{wood}"),)


def _bookshelf(rng: np.random.Generator) -> Parts:
    wood = _colour(rng, "walnut", "pine", "oak")
    return (Box((0.0, 0.0, 0.95), (0.32, 0.90, 1.90), 0.0, f"wood/{wood}", f"books/{wood}"),)


def _sideboard(rng: np.random.Generator) -> Parts:
    wood = _colour(rng, "walnut", "oak", "cream")
    vase = "plaster/" + _colour(rng, "clay", "teal", "sky")
    return (
        Box((0.0, 0.0, 0.36), (0.42, 1.30, 0.72), 0.0, f"wood/{wood}", f"drawers/{wood}"),
        Cylinder((0.0, 0.35, 0.85), 0.07, 0.26, vase),
    )


def _kitchen(rng: np.random.Generator) -> Parts:
    front = _colour(rng, "sage", "cream", "sky")
    return (
        Box((0.0, 0.0, 0.43), (0.58, 1.50, 0.86), 0.0, f"wood/{front}", f"drawers/{front}"),
        Box((0.0, 0.0, 0.88), (0.62, 1.54, 0.04), 0.0, "wood/walnut"),
    )


def _coffee_table(rng: np.random.Generator) -> Parts:
    wood = _colour(rng, "oak", "walnut", "pine")
    return (
        Box((0.0, 0.0, 0.17), (0.44, 0.74, 0.34), 0.0, f"drawers/{wood}"),
        Box((0.0, 0.0, 0.36), (0.50, 0.80, 0.04), 0.0, f"wood/{wood}"),
    )


def _pouf(rng: np.random.Generator) -> Parts:
    cloth = _colour(rng, "rust", "plum", "mustard", "navy")
    return (Cylinder((0.0, 0.0, 0.19), 0.24, 0.38, f"fabric/{cloth}"),)


def _chair(rng: np.random.Generator) -> Parts:
    wood = "wood/" + _colour(rng, "pine", "oak", "red", "walnut")
    return (
        Box((0.0, 0.0, 0.215), (0.38, 0.38, 0.43), 0.0, wood),
        Box((-0.17, 0.0, 0.64), (0.04, 0.38, 0.42), 0.0, wood),
    )


def _plant(rng: np.random.Generator) -> Parts:
    pot = "plaster/" + _colour(rng, "clay", "slate", "white")
    return (
        Cylinder((0.0, 0.0, 0.17), 0.17, 0.34, pot),
        Cylinder((0.0, 0.0, 0.50), 0.05, 0.32, "wood/walnut"),
        Cylinder((0.0, 0.0, 0.80), 0.24, 0.30, "leaves/leaf"),
        Cylinder((0.0, 0.0, 1.03), 0.16, 0.18, "leaves/leaf"),
    )


def _cartons(rng: np.random.Generator) -> Parts:
    twist = float(rng.uniform(-0.3, 0.3))
    return (
        Box((0.0, 0.0, 0.16), (0.32, 0.42, 0.32), 0.0, "cardboard/kraft"),
        Box((0.0, 0.02, 0.42), (0.26, 0.32, 0.20), twist, "cardboard/kraft"),
    )


def _bin(rng: np.random.Generator) -> Parts:
    paint = _colour(rng, "red", "navy", "lime", "grey")
    return (
        Cylinder((0.0, 0.0, 0.18), 0.14, 0.36, f"stripes/{paint}"),
        Cylinder((0.0, 0.0, 0.38), 0.15, 0.04, "plaster/slate"),
    )


CATALOGUE: tuple[Model, ...] = (
    Model("sofa", (0.85, 1.80), _sofa, True, 0.55),
    Model("cupboard", (0.45, 1.00), _cupboard, True, 0.5),
    Model("kitchen", (0.62, 1.54), _kitchen, True, 0.65),
    Model("bookshelf", (0.32, 0.90), _bookshelf, True, 0.45),
    Model("sideboard", (0.42, 1.30), _sideboard, True, 0.55),
    Model("armchair", (0.70, 0.70), _armchair, False, 0.5),
    Model("coffee table", (0.50, 0.80), _coffee_table, False, 0.5),
    Model("plant", (0.34, 0.34), _plant, False, 0.6),
    Model("pouf", (0.48, 0.48), _pouf, False, 0.45),
    Model("cartons", (0.32, 0.42), _cartons, False, 0.65),
    Model("chair", (0.38, 0.38), _chair, False, 0.5),
    Model("chair", (0.38, 0.38), _chair, False, 0.5),
    Model("bin", (0.30, 0.30), _bin, False, 0.4),
    Model("plant", (0.34, 0.34), _plant, False, 0.6),
)


def model_of(kind: str) -> Model:
    """The first model of a kind."""
    return next(model for model in CATALOGUE if model.name == kind)


def furnish(
    extent: Extent,
    partition: StaticObject,
    models: tuple[Model, ...],
    rng: np.random.Generator,
    passage_m: float = PASSAGE_M,
    least: int = LEAST_PIECES,
) -> list[Piece] | None:
    """Furnish a room piece by piece; pieces that do not fit are left out.

    Pieces with their back to a wall stand 2 cm from it; the others keep a passage to everything or stand close to a
    wall.

    Args:
        extent: Of the room, m.
        partition: Shapes already in the room.
        models: Wanted pieces in order.
        rng: Source of places and colours.
        passage_m: Kept free between pieces.
        least: Least number of pieces.

    Returns:
        The pieces, or None if fewer than the least number fitted.
    """
    placed: list[Piece] = []
    taken: list[Shape] = list(partition.parts)
    rims = np.concatenate([_rim(part) for part in taken])
    for model in models:
        for _ in range(40):
            piece = _draw(model, extent, rng)
            if _fits(piece, extent, taken, rims, passage_m):
                placed.append(piece)
                taken += piece.static_object.parts
                rims = np.concatenate([rims, *(_rim(part) for part in piece.static_object.parts)])
                break
    return placed if len(placed) >= least else None


def _draw(model: Model, extent: Extent, rng: np.random.Generator) -> Piece:
    x0, y0, x1, y1 = extent
    depth, width = model.footprint
    if model.wall:
        side = int(rng.integers(4))
        yaw = (0.0, math.pi / 2, math.pi, -math.pi / 2)[side]
        inset = depth / 2 + 0.02
        along_x = float(rng.uniform(x0 + width / 2 + 0.05, x1 - width / 2 - 0.05))
        along_y = float(rng.uniform(y0 + width / 2 + 0.05, y1 - width / 2 - 0.05))
        place = (
            (x0 + inset, along_y),
            (along_x, y0 + inset),
            (x1 - inset, along_y),
            (along_x, y1 - inset),
        )[side]
    else:
        yaw = float(rng.uniform(-math.pi, math.pi))
        reach = max(depth, width) / 2 + 0.05
        place = (
            float(rng.uniform(x0 + reach, x1 - reach)),
            float(rng.uniform(y0 + reach, y1 - reach)),
        )
    return Piece(model, place_piece(model, place, yaw, rng))


def place_piece(
    model: Model, place: Place, yaw_rad: float, rng: np.random.Generator
) -> StaticObject:
    """A piece of furniture centred at a place with that yaw; draws its colours."""
    parts = tuple(_moved(part, place, yaw_rad) for part in model.build(rng))
    return StaticObject(model.name, parts, model.albedo)


def _fits(
    piece: Piece, extent: Extent, taken: list[Shape], rims: np.ndarray, passage_m: float
) -> bool:
    x0, y0, x1, y1 = extent
    corners = np.concatenate([outline(part) for part in piece.static_object.parts])
    if corners[:, 0].min() < x0 or corners[:, 0].max() > x1:
        return False
    if corners[:, 1].min() < y0 or corners[:, 1].max() > y1:
        return False
    passage = passage_m if not piece.model.wall else 0.06
    gap = min(_gap(part, rims) for part in piece.static_object.parts)
    if gap < passage:
        return False
    own = np.concatenate([_rim(part) for part in piece.static_object.parts])
    for shape in taken:
        gap = min(gap, _gap(shape, own))
        if gap < passage:
            return False
    if piece.model.wall:
        return gap >= passage and (gap >= passage_m or gap < 0.30)
    to_wall = min(
        corners[:, 0].min() - x0,
        x1 - corners[:, 0].max(),
        corners[:, 1].min() - y0,
        y1 - corners[:, 1].max(),
    )
    return bool(gap >= passage_m and (to_wall >= passage_m or to_wall < 0.15))


def _gap(shape: Shape, points: np.ndarray) -> float:
    return float(distance(shape, points).min())


def _rim(shape: Shape) -> np.ndarray:
    """Points along the outline: the corners of a cylinder, else sixteen per side."""
    corners = outline(shape)
    if isinstance(shape, Cylinder):
        return corners
    share = np.arange(16)[:, None, None] / 16
    return (corners + share * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)


def _moved(part: Shape, place: Place, yaw: float) -> Shape:
    c, s = math.cos(yaw), math.sin(yaw)
    assert not isinstance(part, Solid)  # the catalogue is made of boxes and cylinders
    x, y, z = part.centre
    centre = (place[0] + c * x - s * y, place[1] + s * x + c * y, z)
    if isinstance(part, Box):
        return Box(centre, part.size, part.yaw_rad + yaw, part.material, part.front)
    return Cylinder(centre, part.radius, part.height, part.material)
