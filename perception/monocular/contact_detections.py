"""From one monocular cycle to what the tracker takes: discs on the floor, and where it can be seen.

Seams between planks have not always the colours of the floor. What is flatter or narrower than anything that
could be run into is floor all the same (`Sight`).

An obstacle's contact edge is the near half of its outline. Its two ends are the tangents from the eye and its
middle is its nearest point, which makes a disc; so wide an edge that no disc of that size moves, or one cut
off by the border of the picture, is left to the objective. A walking trunk trembles by half a degree,
which its encoders do not feel: that decides the covariance, and is why two pictures 0.2 s apart tell no
speed and a track over seconds does.

Source: ours; the edges are those of seed 000, section 3.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt16

from ..obstacles.track import Detection
from ..primitives.obstacle import Obstacle
from ..primitives.pose import Pose2
from .back_projection import FARTHEST_M, floor_points, project
from .components import components
from .deviations import DeviationConfig
from .edges import find_edges
from .result import MonocularResult, Picture

DEVIATIONS = DeviationConfig()
PITCH_RAD, YAW_RAD, ROLL_RAD, HEIGHT_M = np.sqrt(np.diag(DEVIATIONS.eye_covariance)).tolist()
EDGE_PX = DEVIATIONS.edge_px
LEAST_M = 0.02  # ours: radius; a robot of 37 mm, half of it hidden
WIDEST_M = 0.12  # ours: radius; robots that move have up to 0.10, and part of a box is none of them
ROUND_PX = 2.0  # ours: ragged edges
BORDER_PX = 2  # ours: an edge this near to the border goes on beyond it
THIN_PX = 5  # ours: seams and noise; a robot of 7 cm has 8 px at 3 m
NARROW_M, FLAT_M = 0.045, 0.035  # ours: the smallest robots to be met have 7 and 5.5 cm
GAP_PX = (3, 7)  # ours: columns of floor that must show beside an end of an edge
DIRECTION_PX = 3  # ours: so many columns are one direction; an outline leaves gaps in fewer
RING = np.stack([np.cos(np.arange(16) * math.pi / 8), np.sin(np.arange(16) * math.pi / 8)], axis=1)


@dataclass(frozen=True, eq=False)
class FloorContacts:
    """What one picture shows, seams and specks taken for the floor they are.

    Args:
        picture: And where it was taken.
        ground: 255 where floor is seen.
        edges: Of each obstacle the lowest pixel (u, v) of each of its columns.
        contacts: Where each touches the floor, world frame, m; NaN beyond 6 m.
    """

    picture: Picture
    ground: UInt8[np.ndarray, "h w"]
    edges: tuple[Int[np.ndarray, "_ 2"], ...]
    contacts: tuple[Float[np.ndarray, "_ 2"], ...]

    def shows_floor(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """At which places, world frame, m, this picture shows bare floor."""
        height, width = self.ground.shape
        pixels = project(places, self.picture.camera, self.picture.T_world_camera)
        inside = np.isfinite(pixels).all(axis=1)
        column, row = np.nan_to_num(np.rint(pixels), nan=-1.0).astype(np.intp).T
        inside &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
        answer = np.zeros(len(places), dtype=bool)
        answer[inside] = self.ground[row[inside], column[inside]] > 0
        return answer


def floor_contacts(result: MonocularResult) -> FloorContacts:
    """Take a cycle's picture in."""
    picture = result.current
    ground = _without_specks(result.ground, picture)
    edges = find_edges(ground).groups
    labels, boxes, _ = components(np.asarray(cv2.bitwise_not(ground), np.uint8), 8)
    contacts = tuple(_contact(edge, labels, boxes, picture) for edge in edges)
    return FloorContacts(picture, ground, edges, contacts)


def detections(seen: FloorContacts, robot: Pose2, farthest_m: float) -> list[Detection]:
    """Every obstacle of a picture that may be a disc, body frame.

    Args:
        seen: The picture.
        robot: The pose that it was placed by, world frame.
        farthest_m: Beyond this distance nothing is reported.
    """
    found = [
        _disc(edge, contact, seen.picture, robot)
        for edge, contact in zip(seen.edges, seen.contacts, strict=True)
        if _alone(edge, seen.ground)
    ]
    return [
        disc
        for disc in found
        if disc is not None and float(np.hypot(*disc.position)) - disc.radius_m <= farthest_m
    ]


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


def _without_specks(ground: UInt8[np.ndarray, "h w"], picture: Picture) -> UInt8[np.ndarray, "h w"]:
    """The ground with everything filled that is too thin, too narrow or too flat to be an obstacle."""
    filled = cv2.morphologyEx(ground, cv2.MORPH_CLOSE, np.ones((THIN_PX, THIN_PX), np.uint8))
    height, width = filled.shape
    labels, boxes, _ = components(np.asarray(cv2.bitwise_not(filled), np.uint8), 8)
    left, top, wide, high = (boxes[:, k] for k in range(4))
    feet = np.stack([left + wide / 2.0, (top + high).astype(np.float64)], axis=1)
    reach = floor_points(feet, picture.camera, picture.T_world_camera, math.inf)
    eye = picture.T_world_camera.position
    ray = np.sqrt(((reach - eye[:2]) ** 2).sum(axis=1) + eye[2] ** 2)
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


def _contact(
    edge: Int[np.ndarray, "m 2"],
    labels: UInt16[np.ndarray, "h w"],
    boxes: Int[np.ndarray, "k 5"],
    picture: Picture,
) -> Float[np.ndarray, "n 2"]:
    """Where the thing over an edge touches the floor, world frame, m; NaN beyond 6 m.

    Beside the axis of a bowed camera upright sides lean outward, and the lowest pixel of a column may lie on one
    of them, high above the floor. On the floor they all point at the eye: whatever the camera's attitude, a
    thing touches the floor where what it hides begins, seen in each direction from the eye's foot.
    """
    camera, pose = picture.camera, picture.T_world_camera
    along = floor_points(edge.astype(np.float64), camera, pose, FARTHEST_M)
    label = int(labels[edge[0, 1], edge[0, 0]])
    left, top, wide, high = (int(value) for value in boxes[label, :4])
    beyond = max(edge[0, 0] - left, left + wide - 1 - edge[-1, 0])
    whole = beyond <= DIRECTION_PX and top > 0
    if label == 0 or not whole:  # with what stands behind it, or in part: its columns must do
        return along
    mask = (labels[top : top + high, left : left + wide] == label).astype(np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = np.concatenate([part[:, 0] for part in outlines]) + np.array([left, top])
    hidden = floor_points(outline.astype(np.float64), camera, pose, FARTHEST_M)
    if not np.isfinite(hidden).all():
        return along
    away = hidden - pose.position[:2]
    bearings, reach = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    ahead = math.atan2(np.sin(bearings).sum(), np.cos(bearings).sum())
    off = np.remainder(bearings - ahead + math.pi, 2 * math.pi) - math.pi
    share = (off - off.min()) / max(float(np.ptp(off)), 1e-9)
    several = max(wide // DIRECTION_PX, 2)
    directions = np.minimum((share * several).astype(np.intp), several - 1)
    order = np.lexsort((reach, directions))
    _, first = np.unique(directions[order], return_index=True)
    nearest = order[first]
    ends = [
        int(np.argmin(off)),
        int(np.argmax(off)),
    ]  # tangents; they touch as far off as what is beside
    beside = (reach[nearest[[0, -1]]] / reach[ends])[:, None]
    tangents = pose.position[:2] + beside * away[ends]
    return np.concatenate([tangents[:1], hidden[nearest], tangents[1:]])


def _alone(edge: Int[np.ndarray, "m 2"], ground: UInt8[np.ndarray, "h w"]) -> bool:
    """Whether floor shows beside both ends of an edge, and a little above: nothing hides or touches it."""
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
    """The disc that shows this edge; None where it is none, or goes on out of sight."""
    width, height = picture.camera.width, picture.camera.height
    columns, rows = edge[:, 0], edge[:, 1]
    if columns.min() < BORDER_PX or columns.max() > width - 1 - BORDER_PX:
        return None
    if rows.max() > height - 1 - BORDER_PX:
        return None
    points = contact[np.isfinite(contact).all(axis=1)]
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
    if not LEAST_M < radius < WIDEST_M or half > 0.8:
        return None
    if not _round(reach[np.argsort(off)], radius, front, picture):
        return None
    centre = eye[:2] + (front + radius) * np.array([math.cos(middle), math.sin(middle)])
    return Detection(
        robot.inverse().apply(centre),
        _covariance(picture, robot, middle, front, radius),
        radius,
    )


def _round(reach: Float[np.ndarray, "n"], radius: float, front: float, picture: Picture) -> bool:
    """Whether both ends of an edge are about as far as each other, and not deeper than a disc's.

    A piece of wall that shows between two things is neither.
    """
    eye_height = float(picture.T_world_camera.position[2])
    grain = ROUND_PX * (eye_height**2 + front**2) / eye_height / picture.camera.fy
    part = max(1, len(reach) // 6)
    first, last = float(np.median(reach[:part])), float(np.median(reach[-part:]))
    deep = float(np.quantile(reach, 0.9)) - front
    return abs(first - last) <= 0.7 * radius + grain and deep <= 1.3 * radius + grain


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
