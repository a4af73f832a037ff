"""Footprints as entries of obstacles.json, and back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mapping.objects.footprints import Footprint
from mapping.objects.sides import Box


def footprint_entry(one: Footprint) -> dict[str, Any]:
    """The entry of a footprint; what is not known is null. The keys are documented in docs/outputs.md."""
    box = one.box
    return {
        "outline_m": one.outline.tolist(),
        "sides": [
            {"seen": bool(seen), "sigma_m": _number(sigma)}
            for seen, sigma in zip(one.seen, one.sigma_m, strict=True)
        ],
        "height_m": one.height_m,
        "sigma_height_m": one.sigma_height_m,
        "probability": _number(one.probability),
        "several": one.several,
        "points": one.points,
        "box": None
        if box is None
        else {
            "centre_m": box.centre.tolist(),
            "length_m": box.length_m,
            "width_m": box.width_m,
            "yaw_rad": box.yaw_rad,
            "sigma_length_m": _number(box.sigma_length_m),
            "sigma_width_m": _number(box.sigma_width_m),
            "covariance": box.covariance.tolist() if np.isfinite(box.covariance).all() else None,
        },
    }


def footprint_of(entry: dict[str, Any]) -> Footprint:
    """The footprint of an entry."""
    box = entry["box"]
    return Footprint(
        np.array(entry["outline_m"], np.float64),
        np.array([side["seen"] for side in entry["sides"]], np.bool_),
        np.array([_value(side["sigma_m"]) for side in entry["sides"]]),
        entry["height_m"],
        entry["sigma_height_m"],
        _value(entry["probability"]),
        entry["several"],
        entry["points"],
        None
        if box is None
        else Box(
            np.array(box["centre_m"], np.float64),
            box["length_m"],
            box["width_m"],
            box["yaw_rad"],
            _value(box["sigma_length_m"]),
            _value(box["sigma_width_m"]),
            np.full((2, 2), np.nan)
            if box["covariance"] is None
            else np.array(box["covariance"], np.float64),
        ),
    )


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _value(number: float | None) -> float:
    return math.nan if number is None else float(number)
