"""Straight vertical faces of obstacles on the floor plane, and which of them belong to one thing.

Faces are found one after the other, the one with most columns first: all directions and offsets are tried, and the best
is refined by least squares. A face is visible from its own side, so its normal points to where the sensor stood.

Two faces that meet belong to one thing if their corner is convex: an object sticks out towards the sensor, and where
two objects touch, or two walls of a room meet, the corner is concave.

Source: faces are ours (a Hough transform over columns); convexity after Stein, Schoeler, Papon and Woergoetter 2014
(locally convex connected patches).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from .columns import CELL_M, Columns, on_border

DIRECTIONS = 120  # ours: normals tried, every 3 deg
BAND_M = 0.03  # ours: columns this close to a line are on it: smear of a face over frames
TAKEN_M = 0.05  # ours: columns this close to a face are not on another one
LEAST_M = 0.10  # ours: shorter faces are not told from clutter
LEAST_FILL = 0.6  # ours: share of a face's length that must hold columns
OBLIQUE = 0.17  # ours: cosine of the flattest view of a face, 80 deg
MOST_FACES = 40  # ours: of one connected part
MEET_M = 0.12  # ours: faces whose ends are this close may meet at a corner
CONVEX_M = 0.05  # ours: a face may stick out of the plane of another by the smear of both
TWICE_M = 0.12  # ours: a face this close before or behind a stronger one is the same, displaced by the pose
STEP_M = 0.06  # ours: tops that differ by more are those of two things, if their colours differ too
STRIP_M = 0.05  # ours: along a face, to compare its top from place to place
TOP_DEPTH_M = 0.20  # ours: behind a face, where its top is looked for
COLOUR = 30.0  # ours: least difference of two colours (RGB, of 255) that is not a matter of light


@dataclass(frozen=True, eq=False)
class Face:
    """A straight vertical face, seen from above.

    Args:
        normal: Unit vector towards the side from which it was seen.
        offset_m: normal . p of its points.
        span: First and last place along its tangent (normal turned left), m.
        columns: Indices of its columns.
        top_m: Height of its upper edge; NaN if no top was seen behind it.
        colour: Mean colour, RGB; NaN without a camera.
    """

    normal: Float[np.ndarray, "2"]
    offset_m: float
    span: tuple[float, float]
    columns: Int[np.ndarray, "n"]
    top_m: float
    colour: Float[np.ndarray, "3"]

    @property
    def length_m(self) -> float:
        """Between its ends."""
        return self.span[1] - self.span[0]

    @property
    def tangent(self) -> Float[np.ndarray, "2"]:
        """Unit vector along it."""
        return np.array([-self.normal[1], self.normal[0]])

    @property
    def ends(self) -> Float[np.ndarray, "2 2"]:
        """Both ends, m."""
        return np.asarray(self.offset_m * self.normal + np.array(self.span)[:, None] * self.tangent)


def find(columns: Columns, gap_m: float) -> list[Face]:
    """Faces of one connected part, those with most columns first.

    Args:
        columns: Of the part.
        gap_m: Wider gaps along a line separate two faces.
    """
    towards, left = columns.to_sensor, columns.upright.copy()
    if not np.isfinite(towards).all():  # its border, as if seen from outside all around
        away = columns.xy - columns.xy.mean(axis=0)
        towards = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        left &= on_border(columns.xy, gap_m)
    upright = left.copy()
    strength = np.sqrt(columns.count.astype(np.float64))
    faces: list[Face] = []
    while left.sum() * CELL_M >= LEAST_M and len(faces) < MOST_FACES:
        candidate = _strongest(columns.xy, towards, strength, left)
        if candidate is None:
            break
        refined = _refined(columns, towards, (upright, left), candidate, gap_m)
        if refined is None:
            off = np.abs(columns.xy @ candidate[0] - candidate[1])
            line = left & (off <= CELL_M / 2)
            left &= ~line if line.any() else off > 2.0 * CELL_M  # not on a face
            continue
        run, normal, offset = refined
        along = columns.xy @ np.array([-normal[1], normal[0]])
        span = float(along[run].min()), float(along[run].max())
        off = columns.xy @ normal - offset
        inside = (along > span[0] - BAND_M) & (along < span[1] + BAND_M)
        taken = inside & (np.abs(off) <= TAKEN_M)
        left &= ~taken
        left[run] = False  # a fit may have moved away from its columns
        if not any(_same(face, normal, columns.xy[run]) for face in faces):
            faces += _split_by_top(columns, run, normal, offset)
    return faces


def _strongest(
    xy: Float[np.ndarray, "n 2"],
    towards: Float[np.ndarray, "n 2"],
    strength: Float[np.ndarray, "n"],
    left: Bool[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "2"], float] | None:
    """Normal and offset of the line with the strongest columns that were seen from its front."""
    places, directions, weights = xy[left], towards[left], strength[left]
    best, chosen = 0.0, None
    for k in range(DIRECTIONS):
        angle = 2.0 * math.pi * k / DIRECTIONS
        normal = np.array([math.cos(angle), math.sin(angle)])
        front = directions @ normal > OBLIQUE
        if not front.any():
            continue
        offset = places[front] @ normal
        first = float(offset.min())
        bin_of = np.floor((offset - first) / CELL_M).astype(np.int64)
        tally = np.convolve(np.bincount(bin_of, weights[front]), np.ones(3), "same")
        top = int(np.argmax(tally))
        if tally[top] > best * (1.0 + 1e-9):
            best, chosen = float(tally[top]), (normal, first + (top + 0.5) * CELL_M)
    return chosen


def _refined(
    columns: Columns,
    towards: Float[np.ndarray, "n 2"],
    usable: tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]],
    candidate: tuple[Float[np.ndarray, "2"], float],
    gap_m: float,
) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "2"], float] | None:
    """The densest run of columns along a line, and the line through it; None unless it is long and straight.

    Usable are upright columns; those that are left are on no face yet.
    """
    (upright, left), (normal, offset) = usable, candidate
    for band in (2.0 * BAND_M, 1.5 * BAND_M, BAND_M):
        reach = np.where(left, band, BAND_M)  # at a corner it may share the columns of another face
        near = upright & (np.abs(columns.xy @ normal - offset) <= reach)
        near &= towards @ normal > OBLIQUE
        if not (near & left).any():
            return None
        run = _longest_run(columns, np.flatnonzero(near), left, normal, gap_m)
        if left[run].sum() * CELL_M < LEAST_M / 2:
            return None
        weight = columns.weight[run]
        middle = np.average(columns.xy[run], axis=0, weights=weight)
        spread = columns.xy[run] - middle
        moment = (spread * weight[:, None]).T @ spread
        values, vectors = np.linalg.eigh(moment)
        if values[1] < 4.0 * values[0]:  # no direction
            return None
        turned = vectors[:, 0]
        normal = turned if turned @ normal > 0.0 else -turned
        offset = float(normal @ middle)
    along = columns.xy[run] @ np.array([-normal[1], normal[0]])
    length = float(along.max() - along.min())
    strips = np.unique(np.floor(along / CELL_M)).size
    straight = length >= LEAST_M and strips * CELL_M >= LEAST_FILL * length
    return (run, normal, offset) if straight else None


def _longest_run(
    columns: Columns,
    chosen: Int[np.ndarray, "k"],
    left: Bool[np.ndarray, "n"],
    normal: Float[np.ndarray, "2"],
    gap_m: float,
) -> Int[np.ndarray, "m"]:
    """The columns between two gaps along a line with the most voxels that are on no face yet."""
    along = columns.xy[chosen] @ np.array([-normal[1], normal[0]])
    order = np.argsort(along, kind="stable")
    cuts = np.flatnonzero(np.diff(along[order]) > gap_m) + 1
    strength = np.where(left, np.sqrt(columns.count), 0.0)
    return max(
        np.split(chosen[order], cuts), key=lambda run: (float(strength[run].sum()), len(run))
    )


def _same(face: Face, normal: Float[np.ndarray, "2"], places: Float[np.ndarray, "k 2"]) -> bool:
    """Whether a line is a stronger face once more, displaced by an error of the pose."""
    if face.normal @ normal < math.cos(math.radians(15.0)):
        return False
    along = places @ face.tangent
    beside = (along > face.span[0] - BAND_M) & (along < face.span[1] + BAND_M)
    if beside.mean() < 0.5:
        return False
    return bool(np.abs(np.median(places[beside] @ face.normal) - face.offset_m) < TWICE_M)


def _split_by_top(
    columns: Columns,
    run: Int[np.ndarray, "k"],
    normal: Float[np.ndarray, "2"],
    offset: float,
) -> list[Face]:
    """A face, cut where the height of the top behind its upper edge changes.

    The upper edge of a face may be that of the picture. Only a flat top behind it shows that the object ends there.
    """
    along = columns.xy @ np.array([-normal[1], normal[0]])
    order = run[np.argsort(along[run], kind="stable")]
    first = float(along[order[0]])
    strip = np.floor((along[order] - first) / STRIP_M).astype(np.int64)
    depth = offset - columns.xy @ normal
    flat = ~columns.upright & (depth > 0.0) & (depth <= TOP_DEPTH_M)
    flat_strip = np.floor((along - first) / STRIP_M).astype(np.int64)
    strips = int(strip[-1]) + 1
    tops = np.full(strips, np.nan)
    for k in range(strips):
        upper = columns.top[order[strip == k]]
        level = columns.top[flat & (flat_strip == k)]
        if len(upper) and len(level) and abs(upper.max() - np.median(level)) < STEP_M / 2:
            tops[k] = np.median(level)
    starts = [0]
    for k in range(2, strips - 1):
        before, after = tops[starts[-1] : k], tops[k : k + 2]
        if k - starts[-1] < 2 or np.isnan(before).all() or np.isnan(after).any():
            continue
        if (np.abs(after - np.nanmedian(before)) > STEP_M).all():
            starts.append(k)
    pieces = []
    for begin, end in zip(starts, [*starts[1:], strips], strict=True):
        own = order[(strip >= begin) & (strip < end)]
        colour = np.average(columns.colour[own], axis=0, weights=columns.weight[own])
        known = tops[begin:end][np.isfinite(tops[begin:end])]
        top = float(np.median(known)) if 2 * len(known) >= end - begin else math.nan
        span = float(along[own].min()), float(along[own].max())
        pieces.append(Face(normal, offset, span, own, top, colour))
    return pieces


def differ(a: Face, b: Face) -> tuple[bool, bool]:
    """Whether two faces differ in the height of their upper edges, and whether they differ in colour."""
    higher = abs(a.top_m - b.top_m) > STEP_M
    apart = float(np.linalg.norm(a.colour - b.colour))
    return higher, bool(apart > COLOUR)  # no colour is no difference


def group(faces: list[Face]) -> list[list[int]]:
    """Indices of the faces of each thing: faces that meet at convex corners, and not in height and colour both."""
    thing = list(range(len(faces)))
    pairs = sorted(
        (distance, i, j)
        for i in range(len(faces))
        for j in range(i)
        if (distance := _gap(faces[i], faces[j])) <= MEET_M
    )
    for _, i, j in pairs:
        if thing[i] == thing[j] or all(differ(faces[i], faces[j])):
            continue
        ours = [k for k in range(len(faces)) if thing[k] == thing[i]]
        theirs = [k for k in range(len(faces)) if thing[k] == thing[j]]
        if all(_convex(faces[a], faces[b]) for a in ours for b in theirs):
            name = min(thing[i], thing[j])
            for k in ours + theirs:
                thing[k] = name
    return [[k for k in range(len(faces)) if thing[k] == name] for name in sorted(set(thing))]


def _convex(a: Face, b: Face) -> bool:
    """Whether each face lies behind the plane of the other, but for the smear."""
    return bool(
        (b.ends @ a.normal - a.offset_m <= CONVEX_M).all()
        and (a.ends @ b.normal - b.offset_m <= CONVEX_M).all()
    )


def _gap(a: Face, b: Face) -> float:
    """Least distance of an end of one face from the other, m."""
    return min(_to_face(end, other) for one, other in ((a, b), (b, a)) for end in one.ends)


def _to_face(place: Float[np.ndarray, "2"], face: Face) -> float:
    along = float(np.clip(place @ face.tangent, *face.span))
    return float(np.linalg.norm(place - face.offset_m * face.normal - along * face.tangent))
