"""Surfaces of the ground in a file: GeoJSON (RFC 7946) with coordinates in m in the body frame.

Every surface is a Polygon whose corners have x, y and height. Its properties are those of `Surface`; the names of `Border`
say what is beyond the side from each corner to the next.

Source: Butler et al. 2016, RFC 7946; coordinates are not geographic, as in its section 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives import safe_input
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose2

from ..ground.surface import Border, Surface

NAME = "ground.json"


def entries(surfaces: Sequence[Surface], body: Pose2) -> dict[str, Any]:
    """The content of the file.

    Args:
        surfaces: Body frame.
        body: Where the robot stands, world frame.
    """
    features = []
    for one in surfaces:
        z, _ = one.height_at(one.outline)
        ring = np.column_stack([one.outline, z]).tolist()
        properties = {
            "origin_m": one.origin.tolist(),
            "height": one.height.tolist(),
            "covariance": one.covariance.tolist(),
            "borders": [Border(int(kind)).name.lower() for kind in one.borders],
            "sigma_m": one.sigma_m.tolist(),
            "shared_m": one.shared_m,
            "views": one.views,
        }
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return {
        "type": "FeatureCollection",
        "frame": "body",
        "T_world_body": body.vector.tolist(),
        "features": features,
    }


def load(path: str | Path) -> tuple[tuple[Surface, ...], Pose2]:
    """Surfaces of a file, and where the robot stood.

    Raises:
        RecordingError: The file cannot be read, or is no file of surfaces.
    """
    try:
        content = safe_input.json(safe_input.text(path))
        found = tuple(_surface(feature) for feature in content["features"])
        x, y, yaw = (float(value) for value in content["T_world_body"])
    except (safe_input.UnreadableError, ValueError, KeyError, TypeError, IndexError) as error:
        raise RecordingError(
            f"{path}: no file of ground surfaces ({error}); expected GeoJSON as `process` writes it"
        ) from error
    return found, Pose2(x, y, yaw)


def _surface(feature: dict[str, Any]) -> Surface:
    """A feature of the file.

    Raises:
        ValueError, KeyError, TypeError, IndexError: It is none.
    """
    own = feature["properties"]
    ring = np.array(feature["geometry"]["coordinates"][0], np.float64)[:-1]
    count = len(ring)
    shapes = {"origin_m": (2,), "height": (3,), "covariance": (3, 3), "sigma_m": (count,)}
    arrays = {name: np.array(own[name], np.float64) for name in shapes}
    for name, shape in shapes.items():
        if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} must be {shape} finite numbers")
    borders = np.array([Border[name.upper()] for name in own["borders"]], int)
    if len(borders) != count or count < 3 or not np.isfinite(ring).all():
        raise ValueError(f"{count} corners and {len(borders)} borders")
    return Surface(
        arrays["origin_m"],
        arrays["height"],
        arrays["covariance"],
        ring[:, :2],
        borders,
        arrays["sigma_m"],
        float(own["shared_m"]),
        int(own["views"]),
    )
