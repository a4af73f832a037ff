"""Floors of real recordings: the plane that the pipeline detects, compared with the reference of each set.

Five sets with different cameras, heights and rooms: a table may be larger than the floor, people may occlude it, the
camera may be rolled. Given poses are used as for any user.

Source: ours; the reference planes and sizes are those of the data sets.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from perception.estimate import Estimate
from perception.floor.classify import FLOOR
from perception.primitives.plane import Plane

from ...config.schema import Config
from ...recordings.open import open_recording
from ...run.pipeline import Pipeline
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target, combined

FLOOR_SHARE = 0.10  # a floor with this share of the points must be detected
SAME_FLOOR_M = 0.15  # tolerance of the height; the table is 0.73 m above the floor
PERSON_TALL_M = (1.4, 2.0)  # cupboards are lower, walls higher
CABINET_M = (0.79, 0.45)  # length and width by the truth of the set


def estimates(path: Path, say: Say) -> Iterator[tuple[str, Estimate, Pipeline]]:
    """Process a recording: number of each frame, its estimate, and the pipeline."""
    recording = open_recording(path)
    pipeline = Pipeline(Config(), recording.info)
    for number, frame in enumerate(recording.frames()):
        say(f"{path.name} frame {number}")
        yield f"{number}", pipeline.cycle(frame).estimate, pipeline


def errors(planes: list[tuple[Plane, Plane]]) -> tuple[np.ndarray, np.ndarray]:
    """Angle, deg, and height error, mm, of each (detected, reference) pair."""
    angle = np.array([np.degrees(found.angle_to(known)) for found, known in planes])
    height = np.array([1e3 * (found.offset_m - known.offset_m) for found, known in planes])
    return angle, height


def cabinet(say: Say) -> tuple[dict[str, float], list[str]]:
    """tum_fr3_cabinet: floor against motion capture, and the cabinet mapped with the given poses."""
    path = real_data.folder("tum_fr3_cabinet")
    known = list(real_data.floors(path / "floor.csv").values())
    pairs, last = [], None
    for (_, estimate, pipeline), truth in zip(estimates(path, say), known, strict=True):
        last = pipeline
        pairs += [(view.floor, truth) for view in estimate.views if view.seen is not None]
    assert last is not None
    angle, height = errors(pairs)
    found = last.maps.footprints()
    largest = max((one for one in found if one.box is not None), key=lambda one: one.points).box
    assert largest is not None
    figures = {
        "tum_fr3_cabinet_deg": float(np.median(angle)),
        "tum_fr3_cabinet_mm": float(np.median(np.abs(height))),
        "tum_fr3_cabinet_found_share": len(pairs) / len(known),
        "cabinet_length_error_m": abs(largest.length_m - CABINET_M[0]),
        "cabinet_width_error_m": abs(largest.width_m - CABINET_M[1]),
        "cabinet_obstacles": float(len(found)),
    }
    row = (
        f"tum_fr3_cabinet      {len(pairs):3d}/{len(known)} floors  median {np.median(angle):.2f} deg"
        f"  {np.median(np.abs(height)):.0f} mm; cabinet {largest.length_m:.3f} x {largest.width_m:.3f} m"
    )
    return figures, [row]


def kitchen(say: Say) -> tuple[dict[str, float], list[str]]:
    """7-Scenes red kitchen, sweep: the floor and not the table, in all views with enough floor."""
    path, names = real_data.folder("sevenscenes_redkitchen"), real_data.kitchen_names("sweep")
    known = real_data.kitchen_floors("sweep")
    correct, expected, angles = 0, 0, []
    views = zip(names, known, estimates(path / "sweep", say), strict=True)
    for name, truth, (_, estimate, _) in views:
        for view in estimate.views:
            near = np.abs(truth.distance(view.points.xyz)) < 0.05
            if np.mean(near) < FLOOR_SHARE:
                continue
            expected += 1
            if view.seen is not None and abs(view.floor.offset_m - truth.offset_m) < SAME_FLOOR_M:
                correct += 1
                angles.append(np.degrees(view.floor.angle_to(truth)))
        if not estimate.views and name <= "000120":
            expected += 1
    figures = {"sevenscenes_floor_share": correct / max(expected, 1)}
    row = f"sevenscenes sweep    {correct}/{expected} floors, not the table; median {np.median(angles):.2f} deg"
    return figures, [row]


def people(say: Say) -> tuple[dict[str, float], list[str]]:
    """PCL's five people: floor against PCL's plane, and the number of people."""
    path = real_data.folder("pcl_kinect")
    (truth,) = real_data.floors(path / "floor.csv").values()
    ((_, estimate, _),) = estimates(path / "five_people.pcd", say)
    angle, height = errors([(view.floor, truth) for view in estimate.views])
    count = sum(PERSON_TALL_M[0] <= c.height_m <= PERSON_TALL_M[1] for c in estimate.clusters)
    figures = {
        "five_people_deg": float(angle[0]),
        "five_people_mm": float(abs(height[0])),
        "five_people_count": float(count),
    }
    row = f"pcl five_people      {angle[0]:.2f} deg  {height[0]:+.0f} mm; {count} obstacles"
    return figures, [row]


def living_room(say: Say) -> tuple[dict[str, float], list[str]]:
    """Redwood living room: heights by the exact poses (floor at y = 0.13 m)."""
    heights = (0.443, 0.466, 0.491, 0.516, 0.541)  # m, by the description of the set
    found = [
        view.floor.offset_m
        for _, estimate, _ in estimates(real_data.folder("redwood_livingroom"), say)
        for view in estimate.views
        if view.seen is not None
    ]
    worst = 1e3 * max(abs(a - b) for a, b in zip(found, heights, strict=True))
    return {"redwood_mm_max": worst}, [f"redwood_livingroom   5 floors, worst {worst:.0f} mm"]


def low_boxes(say: Say) -> tuple[dict[str, float], list[str]]:
    """RealSense close to a wooden floor, camera rolled: heights by a plane fitted to each frame."""
    errors_mm, shares = [], []
    for number, estimate, _ in estimates(real_data.folder("realsense_low_boxes"), say):
        for view in estimate.views:
            errors_mm.append(
                1e3 * abs(view.floor.offset_m - real_data.LOW_BOXES_HEIGHTS_M[int(number)])
            )
            shares.append(float(np.mean(view.classes == FLOOR)))
    worst = max(errors_mm)
    figures = {"realsense_mm_max": worst, "realsense_frames": float(len(errors_mm))}
    row = (
        f"realsense_low_boxes  {len(errors_mm)}/6 floors, worst {worst:.0f} mm; "
        f"floor {100 * min(shares):.0f}-{100 * max(shares):.0f} % of the points"
    )
    return figures, [row]


def run(seeds: int, say: Say) -> Outcome:
    """All five sets; independent of the seeds."""
    return combined(*(part(say) for part in (cabinet, kitchen, people, living_room, low_boxes)))


EXPERIMENT = Experiment(
    id="real-floor",
    title="Floors, obstacles and people in five real recordings",
    run=run,
    targets={
        "tum_fr3_cabinet_deg": Target("<=", 0.9),
        "tum_fr3_cabinet_mm": Target("<=", 15.0),
        "cabinet_length_error_m": Target("<=", 0.05),
        "cabinet_width_error_m": Target("<=", 0.05),
        "sevenscenes_floor_share": Target(">=", 1.0),
        "five_people_deg": Target("<=", 1.0),
        "five_people_mm": Target("<=", 35.0),
        "five_people_count": Target("==", 5.0),
        "redwood_mm_max": Target("<=", 20.0),
        "realsense_mm_max": Target("<=", 30.0),
    },
    seeds=1,
)
