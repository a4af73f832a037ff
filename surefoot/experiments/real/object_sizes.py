"""Sizes of real objects from single views: a cabinet from all sides, a carton from three, and furniture.

Each view is processed on its own: the floor is detected, objects on the floor are segmented by depth, and a cuboid is
fitted to each. Poses, colour and other frames are not used.

- cabinet: 38 views of a Kinect carried around it; its true size is accurate to 2 cm.
- carton: a RealSense 0.16 to 0.57 m above the floor, once rolled by 20 deg; the true size is unknown, but must be the
  same in all views.
- furniture: a Kinect v2 in a shop; boxes annotated by people, accurate to 5 to 10 cm. Pieces touch each other, so the
  annotated rectangle in the image selects the pixels, as a detector would.

Source: ours; data sets TUM RGB-D, RealSense, SUN RGB-D.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mapping.objects import cuboid
from mapping.objects.cuboid import Cuboid
from perception.depth import points, structured_light
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane

from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Say

CABINET_M = (0.5543, 0.4455, 0.7926)  # height of the top, width, length by truth_objects.txt
CARTON_FRAMES = (0, 2, 3)  # frames that show the whole carton, by the description of the set
ROOM_M = 7.0
MARGIN_PX = 2.0  # a rectangle this close to the image border is truncated
LOST_M = 1.0  # error of a view without a cuboid


def floor_of(depth: Depth) -> Plane | None:
    """The floor in one view of a handheld camera; None if there is none."""
    cloud = points.from_depth(depth, 0.15, 4.0)
    rng = np.random.default_rng(0)
    found = choose.find(cloud, handheld_prior(None), rng, sensor="depth")
    return None if found is None else found.plane


def largest_whole(depth: Depth, floor: Plane) -> Cuboid | None:
    """The largest object that is neither truncated by the image border nor occluded; None if there is none."""
    labels = cuboid.label_objects(depth, floor)
    for number in range(1, int(labels.max(initial=0)) + 1):
        found = cuboid.fit(depth, floor, labels == number)
        if found is not None and not found.cut:
            return found
    return None


def cabinet(say: Say) -> tuple[dict[str, float], list[str]]:
    """tum_fr3_cabinet: size of the cabinet in every view that shows it completely."""
    recording = open_recording(real_data.folder("tum_fr3_cabinet"))
    errors, frames = [], 0
    for frame in recording.frames():
        frames += 1
        assert frame.depth is not None, "the recording has depth in every frame"
        depth = structured_light.depth(frame.depth)
        floor = floor_of(depth)
        found = None if floor is None else largest_whole(depth, floor)
        if found is None or not (found.seen_length and found.seen_width):
            continue
        sizes = np.array([found.height_m, found.width_m, found.length_m])
        errors.append(sizes - CABINET_M)
    off = 1e3 * np.array(errors) if errors else np.full((1, 3), 1e3 * LOST_M)
    say(f"cabinet: {len(errors)} of {frames} views")
    figures = {"cabinet_views": float(len(errors)), "cabinet_frames": float(frames)}
    row = f"cabinet      {len(errors)}/{frames} views"
    for k, name in enumerate(("height", "width", "length")):
        figures[f"cabinet_{name}_median_mm"] = float(np.median(np.abs(off[:, k])))
        figures[f"cabinet_{name}_p90_mm"] = float(np.percentile(np.abs(off[:, k]), 90))
        figures[f"cabinet_{name}_bias_mm"] = float(np.median(off[:, k]))
        row += f"  {name} {np.median(np.abs(off[:, k])):.0f} mm ({np.median(off[:, k]):+.0f})"
    return figures, [row]


def carton(say: Say) -> tuple[dict[str, float], list[str]]:
    """realsense_low_boxes: the spread of a carton's size over three frames."""
    frames = list(open_recording(real_data.folder("realsense_low_boxes")).frames())
    sizes = []
    for number in CARTON_FRAMES:
        view = frames[number].depth
        assert view is not None, "the recording has depth in every frame"
        depth = structured_light.depth(view)
        floor = floor_of(depth)
        found = None if floor is None else largest_whole(depth, floor)
        sizes.append((0.0, LOST_M * number) if found is None else (found.height_m, found.length_m))
    spread = np.ptp(np.array(sizes), axis=0)
    say("carton: three frames")
    figures = {
        "carton_spread_m": float(spread.max()),
        "carton_height_spread_m": float(spread[0]),
        "carton_length_spread_m": float(spread[1]),
    }
    shown = ", ".join(f"{length:.3f} x {height:.3f}" for height, length in sizes)
    return figures, [f"carton       {shown} m (length x height)"]


class Piece(NamedTuple):
    """An annotated box: rectangle in the image (x, y, w, h), distance, and size (height, two sides), m."""

    name: str
    rectangle: tuple[float, float, float, float]
    distance_m: float
    height_m: float
    sides_m: tuple[float, float]

    @property
    def is_whole(self) -> bool:
        """Whether the image border does not truncate it."""
        x, y, w, h = self.rectangle
        return (
            x > 1.0 + MARGIN_PX
            and y > 1.0 + MARGIN_PX
            and x + w < real_data.KINECT2.width - MARGIN_PX
            and y + h <= real_data.KINECT2.height
        )

    def is_behind(self, other: Piece) -> bool:
        """Whether another piece is nearer and covers more than a fifth of this rectangle."""
        x, y, w, h = self.rectangle
        a, b, c, d = other.rectangle
        across = min(x + w, a + c) - max(x, a)
        down = min(y + h, b + d) - max(y, b)
        share = max(across, 0.0) * max(down, 0.0) / (w * h)
        return other.distance_m < self.distance_m and share > 0.2


def pieces(path: Path) -> list[Piece]:
    """The annotated boxes of one view."""
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        name, *words = line.split()
        v = [float(word) for word in words]
        sides = sorted((2.0 * v[7], 2.0 * v[8]))
        distance = float(np.hypot(v[4], v[5]))
        rectangle = (v[0], v[1], v[2], v[3])
        found.append(Piece(name, rectangle, distance, 2.0 * v[9], (sides[0], sides[1])))
    return found


def furniture(say: Say) -> tuple[dict[str, float], list[str]]:
    """sunrgbd_kinect2: sizes of the pieces that are neither truncated nor occluded."""
    folder = real_data.folder("sunrgbd_kinect2")
    errors, rows = [], []
    for name, floor in real_data.floors(folder / "floor.csv").items():
        depth = structured_light.depth(real_data.kinect2_view(name))
        labels = cuboid.label_objects(depth, floor, ROOM_M)
        annotated = pieces(folder / f"{name}.boxes.txt")
        for piece in annotated:
            if not piece.is_whole or any(piece.is_behind(other) for other in annotated):
                continue
            x, y, w, h = (round(v) for v in piece.rectangle)
            inside = np.zeros(labels.shape, bool)
            inside[y : y + h, x : x + w] = True
            shown = labels[inside & (labels > 0)]
            if shown.size == 0:
                continue
            most = int(np.bincount(shown).argmax())
            found = cuboid.fit(depth, floor, inside & (labels == most))
            if found is None or found.cut:
                continue
            off = {"height": found.height_m - piece.height_m}
            off["length"] = found.length_m - piece.sides_m[1]
            if found.width_m > cuboid.THIN_M:
                off["width"] = found.width_m - piece.sides_m[0]
            errors += [abs(value) for value in off.values()]
            listed = "  ".join(f"{side} {100 * value:+.0f} cm" for side, value in off.items())
            rows.append(f"furniture    {name} {piece.name}: {listed}")
    say(f"furniture: {len(rows)} pieces")
    found_errors = np.array(errors or [LOST_M])
    figures = {
        "furniture_error_m": float(np.median(found_errors)),
        "furniture_worst_m": float(found_errors.max()),
        "furniture_pieces": float(len(rows)),
    }
    return figures, rows
