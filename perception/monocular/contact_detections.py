"""Detections for the tracker from one monocular cycle: discs on the floor, and where the floor is visible.

Seams between planks may differ in colour from the floor. Regions that are flatter or narrower than any obstacle count
as floor.

The contact edge of an obstacle is the near side of its outline. Its two ends are the tangents from the camera and its
middle is the nearest point; together they define a disc. Edges that are too wide for a moving obstacle or cut off by
the border of the picture give no detection; the planner's objective treats them as occupied. The covariance is
dominated by the sway of the walking trunk by half a degree, which the encoders do not measure; velocities come
from tracks.

Source: ours; the edges are those of seed 000, section 3.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..obstacles.track import Detection
from ..primitives.obstacle import Obstacle
from ..primitives.pose import Pose2
from .back_projection import FARTHEST_M, floor_points, project
from .components import components
from .contact_covariance import CameraNoise
from .edges import find_edges
from .result import MonocularResult, Picture

NOISE = CameraNoise()
PITCH_RAD, YAW_RAD, ROLL_RAD, HEIGHT_M = np.sqrt(np.diag(NOISE.pose_covariance)).tolist()
EDGE_PX = NOISE.edge_px
MIN_RADIUS_M = 0.02  # ours: a robot of 37 mm, half of it hidden
MAX_RADIUS_M = 0.12  # ours: robots have up to 0.10; larger ones are parts of boxes
RAGGED_PX = 2.0  # ours: noise of an edge along its columns
BORDER_PX = 2  # ours: an edge this near to the border may continue beyond it
THIN_PX = 5  # ours: thinner regions are seams or noise; a robot of 7 cm has 8 px at 3 m
NARROW_M, FLAT_M = 0.045, 0.035  # ours: the smallest robots have 7 and 5.5 cm
GAP_PX = (3, 7)  # ours: columns beside an end of an edge that must show floor
BEARING_PX = 3  # ours: columns per bearing; an outline has gaps in narrower bins
CIRCLE = np.stack(
    [np.cos(np.arange(16) * math.pi / 8), np.sin(np.arange(16) * math.pi / 8)], axis=1
)


@dataclass(frozen=True, eq=False)
class ContactEdges:
    """Floor and contact edges of obstacles in one picture.

    Args:
        picture: With its camera pose.
        ground: 255 on the floor, regions too small for an obstacle included.
        edges: For each obstacle the lowest pixel (u, v) of each of its columns.
        points_world: For each obstacle its contact points with the floor, world frame, m; NaN beyond 6 m.
    """

    picture: Picture
    ground: UInt8[np.ndarray, "h w"]
    edges: tuple[Int[np.ndarray, "_ 2"], ...]
    points_world: tuple[Float[np.ndarray, "_ 2"], ...]

    def shows_floor(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which positions, world frame, m, are visible floor in this picture."""
        height, width = self.ground.shape
        pixels = project(places, self.picture.camera, self.picture.T_world_camera)
        inside = np.isfinite(pixels).all(axis=1)
        column, row = np.nan_to_num(np.rint(pixels)).astype(np.intp).T
        inside &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
        free = np.zeros(len(places), dtype=bool)
        free[inside] = self.ground[row[inside], column[inside]] > 0
        return free


def find_contact_edges(result: MonocularResult) -> ContactEdges:
    """Floor and contact edges from the ground image of a cycle."""
    picture = result.current
    ground = _fill_small_regions(result.ground, picture)
    edges = find_edges(ground).groups
    labels, boxes, _ = components(np.asarray(cv2.bitwise_not(ground), np.uint8), 8)
    points = tuple(_contact_points(edge, labels, boxes, picture) for edge in edges)
    return ContactEdges(picture, ground, edges, points)


def detect_discs(contacts: ContactEdges, robot: Pose2, farthest_m: float) -> list[Detection]:
    """Disc-shaped obstacles of a picture, body frame.

    Args:
        contacts: Contact edges of the picture.
        robot: Pose of the body when it was taken, world frame.
        farthest_m: Maximum distance of a detection.
    """
    found = [
        _disc(edge, points, contacts.picture, robot)
        for edge, points in zip(contacts.edges, contacts.points_world, strict=True)
        if _is_isolated(edge, contacts.ground)
    ]
    return [
        disc
        for disc in found
        if disc is not None and float(np.hypot(*disc.position)) - disc.radius_m <= farthest_m
    ]


def subtract_moving_obstacles(
    ground: UInt8[np.ndarray, "h w"],
    picture: Picture,
    obstacles: list[Obstacle],
    horizon_s: float,
) -> UInt8[np.ndarray, "h w"]:
    """I_r from tracks: the ground without what moving obstacles cover from now to the horizon.

    Args:
        ground: I_g, 255 on the floor.
        picture: The picture of that ground image.
        obstacles: Moving obstacles at the time of the picture, world frame.
        horizon_s: Duration of the prediction, s.
    """
    movable = ground.copy()
    for one in obstacles:
        ends = [one.position + t * one.velocity for t in (0.0, horizon_s)]
        outline = np.concatenate([end + one.radius_m * CIRCLE for end in ends])
        pixels = project(outline, picture.camera, picture.T_world_camera)
        if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e5:
            continue
        hull = cv2.convexHull(np.rint(pixels).astype(np.int32))
        cv2.fillConvexPoly(movable, hull, 0)
    return movable


def _fill_small_regions(
    ground: UInt8[np.ndarray, "h w"], picture: Picture
) -> UInt8[np.ndarray, "h w"]:
    """The ground image with regions filled that are too thin, too narrow or too flat for an obstacle."""
    filled = cv2.morphologyEx(ground, cv2.MORPH_CLOSE, np.ones((THIN_PX, THIN_PX), np.uint8))
    height, width = filled.shape
    labels, boxes, _ = components(np.asarray(cv2.bitwise_not(filled), np.uint8), 8)
    left, top, wide, high = (boxes[:, k] for k in range(4))
    feet = np.stack([left + wide / 2.0, (top + high).astype(np.float64)], axis=1)
    foot_points = floor_points(feet, picture.camera, picture.T_world_camera, math.inf)
    camera_position = picture.T_world_camera.position
    ray = np.sqrt(((foot_points - camera_position[:2]) ** 2).sum(axis=1) + camera_position[2] ** 2)
    with np.errstate(invalid="ignore"):
        small = (wide * ray / picture.camera.fx < NARROW_M) | (
            high * ray / picture.camera.fy < FLAT_M
        )
    border = (left == 0) | (top == 0) | (left + wide == width) | (top + high == height)
    small &= ~border
    small[0] = False
    if small.any():
        filled[small[labels]] = 255
    return np.asarray(filled, np.uint8)


def _contact_points(
    edge: Int[np.ndarray, "m 2"],
    labels: Int[np.ndarray, "h w"],
    boxes: Int[np.ndarray, "k 5"],
    picture: Picture,
) -> Float[np.ndarray, "n 2"]:
    """Contact points of the obstacle above an edge with the floor, world frame, m; NaN beyond 6 m.

    Away from the axis of a camera that is tilted down, vertical sides appear inclined outwards, and the lowest pixel
    of a column may lie on such a side, high above the floor. Projected onto the floor, all vertical lines point away
    from the camera. The contact points are therefore the nearest points of the projected outline in each bearing.
    """
    camera, pose = picture.camera, picture.T_world_camera
    projected_edge = floor_points(edge.astype(np.float64), camera, pose, FARTHEST_M)
    label = int(labels[edge[0, 1], edge[0, 0]])
    left, top, wide, high = (int(value) for value in boxes[label, :4])
    beyond = max(edge[0, 0] - left, left + wide - 1 - edge[-1, 0])
    complete = beyond <= BEARING_PX and top > 0
    if label == 0 or not complete:  # cut off, or connected to what is behind: use the columns
        return projected_edge
    mask = (labels[top : top + high, left : left + wide] == label).astype(np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = np.concatenate([part[:, 0] for part in outlines]) + np.array([left, top])
    hidden = floor_points(outline.astype(np.float64), camera, pose, FARTHEST_M)
    if not np.isfinite(hidden).all():
        return projected_edge
    away = hidden - pose.position[:2]
    _, off, ranges = _polar(away)
    share = (off - off.min()) / max(float(np.ptp(off)), 1e-9)
    bins = max(wide // BEARING_PX, 2)
    bearing_bins = np.minimum((share * bins).astype(np.intp), bins - 1)
    order = np.lexsort((ranges, bearing_bins))
    _, first = np.unique(bearing_bins[order], return_index=True)
    nearest = order[first]
    ends = [int(np.argmin(off)), int(np.argmax(off))]
    # the tangents touch at about the range of their neighbours
    neighbours = (ranges[nearest[[0, -1]]] / ranges[ends])[:, None]
    tangents = pose.position[:2] + neighbours * away[ends]
    return np.concatenate([tangents[:1], hidden[nearest], tangents[1:]])


def _polar(
    away: Float[np.ndarray, "n 2"],
) -> tuple[float, Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Mean bearing of points relative to the camera, their bearings relative to it, rad, and their ranges, m."""
    bearings, ranges = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    mean = math.atan2(np.sin(bearings).sum(), np.cos(bearings).sum())
    return mean, np.remainder(bearings - mean + math.pi, 2 * math.pi) - math.pi, ranges


def _is_isolated(edge: Int[np.ndarray, "m 2"], ground: UInt8[np.ndarray, "h w"]) -> bool:
    """Whether floor is visible beside both ends of an edge and a little above: no occlusion, no neighbour."""
    height, width = ground.shape
    for end, side in ((0, -1), (-1, 1)):
        u, v = (int(value) for value in edge[end])
        columns = np.clip(u + side * np.arange(GAP_PX[0], GAP_PX[1]), 0, width - 1)
        rows = np.clip(v - np.arange(0, GAP_PX[1]), 0, height - 1)
        if not ground[np.ix_(rows, columns)].all():
            return False
    return True


def _disc(
    edge: Int[np.ndarray, "m 2"], contact: Float[np.ndarray, "n 2"], picture: Picture, robot: Pose2
) -> Detection | None:
    """The disc with this contact edge, body frame; None if the edge is not that of a disc or is cut off."""
    width, height = picture.camera.width, picture.camera.height
    columns, rows = edge[:, 0], edge[:, 1]
    if columns.min() < BORDER_PX or columns.max() > width - 1 - BORDER_PX:
        return None
    if rows.max() > height - 1 - BORDER_PX:
        return None
    points = contact[np.isfinite(contact).all(axis=1)]
    if len(points) < 2:
        return None
    camera_position = picture.T_world_camera.position
    bearing, off, ranges = _polar(points - camera_position[:2])
    half = 0.5 * float(np.ptp(off)) + 0.5 / picture.camera.fx
    bearing += 0.5 * float(off.max() + off.min())
    front = float(np.quantile(ranges, 0.1))
    radius = front * math.sin(half) / max(1.0 - math.sin(half), 1e-6)
    if not MIN_RADIUS_M < radius < MAX_RADIUS_M or half > 0.8:
        return None
    if not _is_round(ranges[np.argsort(off)], radius, front, picture):
        return None
    centre = camera_position[:2] + (front + radius) * np.array(
        [math.cos(bearing), math.sin(bearing)]
    )
    return Detection(
        robot.inverse().apply(centre),
        _covariance(picture, robot, bearing, front, radius),
        radius,
    )


def _is_round(
    ranges: Float[np.ndarray, "n"], radius: float, front: float, picture: Picture
) -> bool:
    """Whether both ends of an edge have about the same range and the edge is no deeper than that of a disc.

    This rejects parts of a wall that are visible between two objects.
    """
    camera_height = float(picture.T_world_camera.position[2])
    tolerance = RAGGED_PX * (camera_height**2 + front**2) / camera_height / picture.camera.fy
    part = max(1, len(ranges) // 6)
    first, last = float(np.median(ranges[:part])), float(np.median(ranges[-part:]))
    depth = float(np.quantile(ranges, 0.9)) - front
    return abs(first - last) <= 0.7 * radius + tolerance and depth <= 1.3 * radius + tolerance


def _covariance(
    picture: Picture, robot: Pose2, bearing: float, front: float, radius: float
) -> Float[np.ndarray, "2 2"]:
    """Covariance of a disc's centre, body frame, m^2: sway of the trunk, edge pixels, and deviation from a disc."""
    camera_height = float(picture.T_world_camera.position[2])
    per_rad = (camera_height**2 + front**2) / camera_height  # m along the floor per rad of pitch
    axis = picture.T_world_camera.rotation[:2, 2]
    lateral = abs(math.sin(bearing - math.atan2(axis[1], axis[0])))
    along = (
        (per_rad * PITCH_RAD) ** 2
        + (per_rad * lateral * ROLL_RAD) ** 2
        + (front / camera_height * HEIGHT_M) ** 2
        + (per_rad * EDGE_PX / picture.camera.fy) ** 2
        + (0.3 * radius) ** 2
    )
    across = (
        (front * YAW_RAD) ** 2 + (front * EDGE_PX / picture.camera.fx) ** 2 + (0.1 * radius) ** 2
    )
    angle = bearing - robot.yaw
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s], [s, c]])
    return np.asarray(R @ np.diag([along, across]) @ R.T)
