"""Errors of the floor plane, camera by camera, in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.plane import Plane

from ...results.tables import Table
from .consistency import consistency_metrics, whitened

NORMAL = ("nx", "ny", "nz")
UPPER = ("P00", "P01", "P02", "P11", "P12", "P22")


@dataclass(frozen=True)
class FloorErrors:
    """Errors of the floor planes of one camera, one row per frame.

    Args:
        stamps: s.
        angles_deg: Angle between the normals; NaN where no floor was seen.
        heights_mm: Estimated minus true height of the camera above the floor; NaN likewise.
        whitened: Error of normal and height, whitened by its covariance; NaN likewise.
        seen: Whether a floor was seen.
    """

    stamps: Float[np.ndarray, "n"]
    angles_deg: Float[np.ndarray, "n"]
    heights_mm: Float[np.ndarray, "n"]
    whitened: Float[np.ndarray, "n 3"]
    seen: Bool[np.ndarray, "n"]


def floor_errors(estimate: Table, truth: Table) -> dict[str, FloorErrors]:
    """Errors of every camera with a true floor, by its name in order of appearance."""
    true_planes = dict(zip(_keys(truth), _planes(truth), strict=True))
    planes, states = _planes(estimate), estimate.words("state")
    rows: dict[str, list[tuple[float, ...]]] = {}
    covariances = _covariances(estimate)
    for (stamp, camera), plane, state, P in zip(
        _keys(estimate), planes, states, covariances, strict=True
    ):
        true = true_planes.get((stamp, camera))
        if true is None:
            continue
        row = (float(stamp), *[np.nan] * 5, False)
        if state == "seen":
            angle = np.degrees(plane.angle_to(true))
            height = 1000.0 * (plane.offset_m - true.offset_m)
            units = whitened(plane.error_to(true)[None], P[None])[0].tolist()
            row = (float(stamp), float(angle), float(height), *units, True)
        rows.setdefault(camera, []).append(row)
    return {camera: _collect(np.array(table)) for camera, table in rows.items()}


def floor_metrics(estimate: Table, truth: Table | None) -> dict[str, float | bool]:
    """Figures per camera.

    Returns:
        floor_<camera>_seen_share; and with ground truth _angle_deg_median and _max, _height_mm_median and
        _max (absolute), _height_mm_bias (median, signed), and the consistency figures of the NEES.
    """
    figures: dict[str, float | bool] = {}
    cameras, states = np.array(estimate.words("camera")), np.array(estimate.words("state"))
    for camera in dict.fromkeys(estimate.words("camera")):
        seen = float(np.mean(states[cameras == camera] == "seen"))
        figures[f"floor_{camera}_seen_share"] = seen
    for camera, errors in ({} if truth is None else floor_errors(estimate, truth)).items():
        if not errors.seen.any():
            continue
        name = f"floor_{camera}"
        angles, heights = errors.angles_deg[errors.seen], errors.heights_mm[errors.seen]
        figures |= {
            f"{name}_angle_deg_median": float(np.median(angles)),
            f"{name}_angle_deg_max": float(np.max(angles)),
            f"{name}_height_mm_median": float(np.median(np.abs(heights))),
            f"{name}_height_mm_max": float(np.max(np.abs(heights))),
            f"{name}_height_mm_bias": float(np.median(heights)),
        }
        figures |= consistency_metrics(errors.whitened[errors.seen], name)
    return figures


def _keys(table: Table) -> list[tuple[str, str]]:
    """Stamp and camera of each row; stamps match as text, because both tables write floats without loss."""
    stamps = (repr(float(stamp)) for stamp in table.numbers("stamp_s"))
    return list(zip(stamps, table.words("camera"), strict=True))


def _planes(table: Table) -> list[Plane]:
    normals, heights = table.matrix(*NORMAL), table.numbers("height_m")
    return [Plane(normal, float(height)) for normal, height in zip(normals, heights, strict=True)]


def _covariances(table: Table) -> Float[np.ndarray, "n 3 3"]:
    upper = table.matrix(*UPPER)
    full = np.zeros((len(upper), 3, 3))
    rows, columns = np.triu_indices(3)
    full[:, rows, columns] = upper
    full[:, columns, rows] = upper
    return full


def _collect(rows: Float[np.ndarray, "n 7"]) -> FloorErrors:
    return FloorErrors(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3:6], rows[:, 6] > 0.5)
