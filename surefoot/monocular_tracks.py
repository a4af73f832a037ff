"""From one monocular cycle to what the tracker takes: discs on the floor, and where it can be seen.

An obstacle's contact edge is the near half of its outline. Its two ends are the tangents from the eye and its
middle is its nearest point, which makes a disc; so wide an edge that no disc of that size moves, or one cut
off by the border of the picture, is left to the objective. A walking trunk trembles by half a degree,
which its encoders do not feel: that decides the covariance, and is why two pictures 0.2 s apart tell no
speed and a track over seconds does.

Source: ours; the edges are those of seed 000, section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.localisation.track import Detection
from perception.monocular.back_projection import project
from perception.monocular.result import MonocularResult, Picture, SeenObstacle
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2

PITCH_RAD, YAW_RAD, ROLL_RAD = (math.radians(v) for v in (0.7, 0.5, 0.7))  # walking trials
HEIGHT_M = 0.004  # walking trials: of the eye
EDGE_PX = 1.0  # ours: of a contact edge
WIDEST_M = 0.35  # ours: half of it is the greatest radius of a track of the tracker
BORDER_PX = 2  # ours: an edge this near to the border goes on beyond it
RING = np.stack([np.cos(np.arange(16) * math.pi / 8), np.sin(np.arange(16) * math.pi / 8)], axis=1)


def detections(result: MonocularResult, robot: Pose2, farthest_m: float) -> list[Detection]:
    """Every obstacle of a picture that may be a disc, body frame.

    Args:
        result: Of the cycle.
        robot: The pose that its pictures were placed by, world frame.
        farthest_m: Beyond this distance nothing is reported.
    """
    found = [_disc(seen, result.current, robot) for seen in result.obstacles]
    return [
        disc
        for disc in found
        if disc is not None and float(np.hypot(*disc.position)) - disc.radius_m <= farthest_m
    ]


def floor_seen(
    result: MonocularResult,
) -> Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]:
    """At which places, world frame, m, this picture shows bare floor."""
    picture, ground = result.current, result.ground
    height, width = ground.shape

    def seen(places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        pixels = project(places, picture.camera, picture.T_world_camera)
        inside = np.isfinite(pixels).all(axis=1)
        column, row = np.nan_to_num(np.rint(pixels), nan=-1.0).astype(np.intp).T
        inside &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
        answer = np.zeros(len(places), dtype=bool)
        answer[inside] = ground[row[inside], column[inside]] > 0
        return answer

    return seen


def without_movers(
    ground: UInt8[np.ndarray, "h w"],
    picture: Picture,
    movers: list[Obstacle],
    horizon_s: float,
) -> UInt8[np.ndarray, "h w"]:
    """I_r by tracks: the ground less what each mover covers from now to the horizon.

    Args:
        ground: I_g, 255 where floor is seen.
        picture: That it belongs to.
        movers: World frame, as of the picture.
        horizon_s: How far ahead, s.
    """
    movable = ground.copy()
    for mover in movers:
        ends = [mover.position + t * mover.velocity for t in (0.0, horizon_s)]
        outline = np.concatenate([end + mover.radius_m * RING for end in ends])
        pixels = project(outline, picture.camera, picture.T_world_camera)
        if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e5:
            continue
        hull = cv2.convexHull(np.rint(pixels).astype(np.int32))
        cv2.fillConvexPoly(movable, hull, 0)
    return movable


def _disc(seen: SeenObstacle, picture: Picture, robot: Pose2) -> Detection | None:
    """The disc that shows this edge; None where it is none, or goes on out of sight."""
    width, height = picture.camera.width, picture.camera.height
    columns, rows = seen.edge[:, 0], seen.edge[:, 1]
    if columns.min() < BORDER_PX or columns.max() > width - 1 - BORDER_PX:
        return None
    if rows.max() > height - 1 - BORDER_PX:
        return None
    points = seen.contact_world[np.isfinite(seen.contact_world).all(axis=1)]
    if len(points) < 2:
        return None
    eye = picture.T_world_camera.position
    away = points - eye[:2]
    bearings, reach = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    middle = math.atan2(np.sin(bearings).sum(), np.cos(bearings).sum())
    off = np.remainder(bearings - middle + math.pi, 2 * math.pi) - math.pi
    half = 0.5 * float(np.ptp(off)) + 0.5 / picture.camera.fx
    middle += 0.5 * float(off.max() + off.min())
    front = float(np.quantile(reach, 0.1))
    radius = front * math.sin(half) / max(1.0 - math.sin(half), 1e-6)
    if radius > WIDEST_M or half > 0.8:
        return None
    centre = eye[:2] + (front + radius) * np.array([math.cos(middle), math.sin(middle)])
    return Detection(
        robot.inverse().apply(centre),
        _covariance(picture, robot, middle, front, radius),
        radius,
    )


def _covariance(
    picture: Picture, robot: Pose2, bearing: float, front: float, radius: float
) -> Float[np.ndarray, "2 2"]:
    """Of the disc's middle, body frame, m^2: trembling trunk, edge, and how round the thing is."""
    eye_height = float(picture.T_world_camera.position[2])
    steep = (eye_height**2 + front**2) / eye_height  # m along the floor per rad of pitch
    axis = picture.T_world_camera.rotation[:2, 2]
    aside = abs(math.sin(bearing - math.atan2(axis[1], axis[0])))
    along = (
        (steep * PITCH_RAD) ** 2
        + (steep * aside * ROLL_RAD) ** 2
        + (front / eye_height * HEIGHT_M) ** 2
        + (steep * EDGE_PX / picture.camera.fy) ** 2
        + (0.3 * radius) ** 2
    )
    across = (
        (front * YAW_RAD) ** 2 + (front * EDGE_PX / picture.camera.fx) ** 2 + (0.1 * radius) ** 2
    )
    direction = bearing - robot.yaw
    c, s = math.cos(direction), math.sin(direction)
    R = np.array([[c, -s], [s, c]])
    return np.asarray(R @ np.diag([along, across]) @ R.T)
