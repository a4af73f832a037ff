"""Which movers are near the robot and in unblocked sight, by the truth."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from sim.free_space import ClearanceMap, clearance_map
from sim.scene import Scene

NEAR_M = 3.0  # reach of the depth cameras
EYE_M = 0.38  # DARwIn-OP walking
_STEP_M = 0.04


class Sightlines:
    """Lines of sight in a scene, at the height of the eye."""

    def __init__(self, scene: Scene) -> None:
        shapes = [part for _, part in scene.static_shapes if part.top_m > EYE_M]
        self._space: ClearanceMap = clearance_map(scene.extent, shapes, top_m=EYE_M)
        everything = [part for _, part in scene.static_shapes]
        self._low: ClearanceMap = clearance_map(scene.extent, everything)
        self._radii = np.array([one.radius_m for one in scene.moving_objects])

    def near(
        self, eye: tuple[float, float], movers: Float[np.ndarray, "n 2"]
    ) -> Bool[np.ndarray, "n"]:
        """Whether each mover is within `NEAR_M` and nothing, no other mover either, hides its centre."""
        found = np.zeros(len(movers), np.bool_)
        for k, place in enumerate(movers):
            away = math.dist(eye, place)
            if away > NEAR_M:
                continue
            share = np.arange(_STEP_M, away - self._radii[k], _STEP_M)[:, None] / max(away, 1e-9)
            line = np.array(eye) + share * (place - eye)
            others = np.delete(movers, k, axis=0)
            apart = np.linalg.norm(line[:, None] - others[None], axis=-1)
            covered = bool((apart < np.delete(self._radii, k)).any())
            found[k] = not covered and all(self._space.at((x, y)) > 0.0 for x, y in line.tolist())
        return found

    def on_furniture(self, place: Float[np.ndarray, "2"], within_m: float) -> bool:
        """Whether a place is that near to something that stands or to a wall."""
        return self._low.at((float(place[0]), float(place[1]))) < within_m
