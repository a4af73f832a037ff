"""A view: one depth image understood, and what the pipeline asks of it.

Which of its points may be part of a thing that goes on unseen, which belong to something that moves, what it
would have shown, what it looked at, and which colours its points have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..depth.points import Points
from ..depth.reach import ReachConfig
from ..primitives.frame import ColourView, Depth
from ..primitives.obstacle import Obstacle
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from . import classify

OBSTACLES = (classify.OBSTACLE, classify.HOLE)  # where no foot may go
RISING = (classify.OBSTACLE, classify.OVERHANG)  # what things are made of: legs and the body above
KNEE_M = 0.15  # height at which a track is looked for: every obstacle worth a track reaches it
BEYOND_M = 0.15  # what is measured this far behind a place shows that nothing stands there
BORDER_SHARE = 0.02  # of the image's width
HIDING_SHARE = 0.02  # of the image's width: how near in the image what hides a thing must be
NEAR_M = 0.03  # of what reaches so near to the nearest measured, the front may be missing
BESIDE_M = 0.04  # this far beside a point at the border another view must see something
CUT_M = 0.10  # nearer by this hides; this close to the end of reach a thing may go on


@dataclass(frozen=True)
class SegmentedView:
    """One depth image, understood.

    Args:
        sensor: "tof", "stereo" or "depth".
        points: In the camera frame, m.
        classes: One of `classify`'s constants for each point.
        floor: The floor in the camera frame; the kinematic one where none was seen.
        seen: Share of the points on the floor; None where no floor was seen.
        T_map_camera: The camera in the upright map frame.
        upright: (n, 3) points in the map frame, z their height over the floor, m.
    """

    sensor: str
    depth: Depth
    points: Points
    classes: Int[np.ndarray, "n"]
    floor: Plane
    seen: float | None
    T_map_camera: Pose3
    upright: Float[np.ndarray, "n 3"]


def cut_off(
    view: SegmentedView, reach: ReachConfig, others: Sequence[SegmentedView] = ()
) -> Bool[np.ndarray, "n"]:
    """Points at which a thing may go on unseen: border of what is seen, both ends of reach, edge of what hides it.

    At the border a thing does not go on unseen if another view of the frame shows what is beyond. What a pair
    sees ends on the left where its right image does.
    """
    camera, depth = view.depth.camera, view.depth
    u, z = view.points.pixels % camera.width, view.points.xyz[:, 2]
    margin = BORDER_SHARE * camera.width
    left = u < margin + camera.fx * depth.baseline_m / z
    border = left | (u > camera.width - 1 - margin)
    beyond = view.points.xyz[border]
    beyond[:, 0] += np.where(left[border], -BESIDE_M, BESIDE_M)
    border[border] = ~_shown(view.T_map_camera.apply(beyond), others)
    measured = np.where(np.isfinite(depth.z), depth.z, np.float32(np.inf))
    width = 2 * max(1, round(HIDING_SHARE * camera.width)) + 1
    nearest = cv2.erode(measured, np.ones((1, width), np.uint8)).ravel()[view.points.pixels]
    hidden = measured.ravel()[view.points.pixels] - nearest > CUT_M
    ends = (z < reach.nearest_m + NEAR_M) | (z > reach.farthest_m - CUT_M)
    return np.asarray(border | hidden | ends)


def _shown(
    places: Float[np.ndarray, "n 3"], views: Sequence[SegmentedView]
) -> Bool[np.ndarray, "n"]:
    """Whether any of the views measures something in the direction of places of the map."""
    found = np.zeros(len(places), dtype=bool)
    for view in views:
        camera = view.depth.camera
        pixels = camera.project(view.T_map_camera.inverse().apply(places))
        inside = camera.contains(pixels)
        u, v = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(int).T
        u, v = np.clip(u, 0, camera.width - 1), np.clip(v, 0, camera.height - 1)
        found |= inside & np.isfinite(view.depth.z[v, u])
    return found


def visibility(views: Sequence[SegmentedView]) -> Callable[[np.ndarray], np.ndarray]:
    """Whether something on the floor at places (n, 2) of the map would have been seen in this frame."""

    def visible(xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        seen = np.zeros(len(xy), dtype=bool)
        knee = np.column_stack([xy, np.full(len(xy), KNEE_M)])
        for view in views:
            camera_points = view.T_map_camera.inverse().apply(knee)
            pixels = view.depth.camera.project(camera_points)
            inside = view.depth.camera.contains(pixels)
            u, v = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(int).T
            u = np.clip(u, 0, view.depth.camera.width - 1)
            v = np.clip(v, 0, view.depth.camera.height - 1)
            behind = view.depth.z[v, u]  # what is measured there must lie beyond the place
            seen |= inside & (behind > camera_points[:, 2] + BEYOND_M)
        return seen

    return visible


def near_movers(
    xy: Float[np.ndarray, "n 2"], obstacles: Sequence[Obstacle]
) -> Bool[np.ndarray, "n"]:
    """Points that belong to something that probably moves."""
    near = np.zeros(len(xy), dtype=bool)
    for obstacle in obstacles:
        if obstacle.moving > MOVES:
            distance = np.linalg.norm(xy - obstacle.position, axis=1)
            near |= distance < obstacle.radius_m + MARGIN_M
    return near


def colours_of(view: SegmentedView, colour: ColourView | None) -> UInt8[np.ndarray, "n 3"] | None:
    """The colour of each point by the colour camera; grey where it does not look; None without one."""
    if colour is None:
        return None
    xyz = view.points.xyz
    if view.depth.T_body_camera is not None and colour.T_body_camera is not None:
        T_colour_depth = colour.T_body_camera.inverse() @ view.depth.T_body_camera
        xyz = T_colour_depth.apply(xyz)
    pixels = colour.camera.project(xyz)
    inside = colour.camera.contains(pixels)
    u, v = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(int).T
    colours = colour.rgb[
        np.clip(v, 0, colour.camera.height - 1), np.clip(u, 0, colour.camera.width - 1)
    ].copy()
    colours[~inside] = 128
    return colours


MOVES = 0.5  # ours: probability of moving from which the map takes a thing for a mover


MARGIN_M = 0.06  # ours: position error of a track and noise of the points
