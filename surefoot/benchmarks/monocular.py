"""The monocular cycle against a chain of OpenCV calls, on the same pair of 720x720 images.

Both use the same colour range, thresholds and corner settings, and both mask the floor before they track corners.
The peer works at full resolution with one library call after the other. The hardest peer is the same chain on images of
half the size, as ours works in parts. No time includes learning the colours.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from perception.monocular import flow
from perception.monocular.adaptation import FloorColourModel
from perception.monocular.back_projection import camera_pose, floor_points
from perception.monocular.colour_range import ColourRange
from perception.monocular.cycle import MonocularConfig
from perception.monocular.edges import REACH_PX, find_edges
from perception.monocular.ground import ground_image, horizon_rows
from perception.monocular.obstacles import floor_flows
from perception.monocular.result import Picture
from perception.primitives.camera import Camera

from .benchmark import Benchmark, Comparison, race

CONFIG = MonocularConfig()
Found = tuple[np.ndarray, float]
"""Pixel (u, v) where an obstacle touches the floor, and its smallest speed on the floor, m/s."""

ROBOTS = ((0.9, -0.25, 0.0), (1.2, 0.2, 0.06), (1.6, -0.1, -0.06))  # x, y, m; speed along y, m/s
SIDE_M, HEIGHT_M, STEP_M, STEP_S = 0.09, 0.08, 0.0123, 0.2
NEAR_M = 0.08  # ours: half a front face plus the pixel error; boxes are 0.5 m apart
ALLOWED_MPS = 0.03  # ours: half the speed of a robot, which separates static from moving


def scene(rng: np.random.Generator) -> tuple[Picture, Picture]:
    """Two images of a textured floor and wall with three textured boxes, two of which move."""
    camera = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)
    grain = cv2.resize(rng.normal(0.0, 1.0, (500, 500)).astype(np.float32), (2000, 2000))
    fronts = rng.integers(0, 255, (len(ROBOTS), 12, 12)).astype(np.uint8)
    first, second = (_drawn(camera, k * STEP_M, k * STEP_S, grain, fronts, rng) for k in range(2))
    return first, second


def _drawn(
    camera: Camera,
    ahead_m: float,
    stamp_s: float,
    grain: np.ndarray,
    fronts: np.ndarray,
    rng: np.random.Generator,
) -> Picture:
    pose = camera_pose(np.array([ahead_m, 0.0, 0.42]), 0.0, math.radians(30.0), 0.0)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    points = floor_points(np.stack([u, v], axis=-1), camera, pose, 4.0)
    known = np.isfinite(points[..., 0])
    cells = np.nan_to_num(points * 200.0 + 1000.0).astype(np.int64) % 2000
    tone = 1.0 + 0.04 * grain[cells[..., 0], cells[..., 1]]
    image = np.where(
        known[..., None], tone[..., None] * np.array([190.0, 150.0, 105.0]), [120.0, 140.0, 165.0]
    ).astype(np.float32)
    for (x, y, speed), front in zip(ROBOTS[::-1], fronts, strict=True):
        left = y + speed * stamp_s + SIDE_M / 2
        corners = np.array(
            [[x, left - k * SIDE_M, z] for k, z in ((0, HEIGHT_M), (1, HEIGHT_M), (1, 0), (0, 0))]
        )
        pixels = camera.project(pose.inverse().apply(corners)).astype(np.float32)
        source = np.array([[0, 0], [12, 0], [12, 12], [0, 12]], np.float32)
        warp = cv2.getPerspectiveTransform(source, pixels)
        panel = cv2.warpPerspective(front, warp, (720, 720), flags=cv2.INTER_LINEAR)
        inside = cv2.fillConvexPoly(
            np.zeros((720, 720), np.uint8), np.rint(pixels).astype(np.int32), 1
        )
        image[inside > 0] = panel[inside > 0, None] * np.array([0.3, 0.4, 0.9], np.float32)
    noisy = image + rng.normal(0.0, 2.0, image.shape)
    return Picture(np.clip(noisy, 0, 255).astype(np.uint8), camera, pose, stamp_s)


def ours(
    previous: Picture, current: Picture, colours: ColourRange, core: ColourRange
) -> list[Found]:
    """Every obstacle with flow, left to right; its pixel is the middle of its edge."""
    ground = ground_image(current, colours, CONFIG.least_floor_px, core)
    edges = find_edges(ground)
    before = ground_image(previous, colours, CONFIG.least_floor_px, core)
    begin, end, doubt = flow.track_corners(previous, current, before, ground)
    groups = edges.group_beside(end, float(flow.BAND_PX))
    flows = floor_flows(begin, end, doubt, previous, current, groups, CONFIG.farthest_m)
    speed = np.hypot(*flows.velocity_world.T)
    return [
        (edge[len(edge) // 2], float(np.nanmin(speed[flows.obstacle == k])))
        for k, edge in enumerate(edges.groups)
        if np.isfinite(speed[flows.obstacle == k]).any()
    ]


def plain(previous: Picture, current: Picture, colours: ColourRange) -> list[Found]:
    """The same with OpenCV and NumPy, one call after the other; the pixel is below the corner."""
    ground, before = _plain_ground(current, colours), _plain_ground(previous, colours)
    edges = np.zeros_like(ground)
    edges[:-1] = np.where((ground[:-1] == 0) & (ground[1:] > 0), 255, 0)
    _, groups = cv2.connectedComponents(cv2.dilate(edges, np.ones((REACH_PX, REACH_PX), np.uint8)))
    band = cv2.dilate(before, np.ones((flow.BAND_PX + 1, 1), np.uint8), anchor=(0, 0))
    band[before > 0] = 0
    grey = [cv2.cvtColor(p.rgb, cv2.COLOR_RGB2GRAY) for p in (previous, current)]
    tone = int(cv2.mean(grey[0], before)[0])
    grey[0][before > 0] = tone
    grey[1][ground > 0] = tone
    begin = cv2.goodFeaturesToTrack(
        grey[0], flow.MAX_CORNERS, flow.QUALITY, flow.MIN_DISTANCE_PX, mask=band
    )
    if begin is None:
        return []
    window, levels = (flow.WINDOW_PX, flow.WINDOW_PX), flow.LEVELS - 1
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        grey[0], grey[1], begin, begin.copy(), winSize=window, maxLevel=levels
    )
    back, returned, _ = cv2.calcOpticalFlowPyrLK(
        grey[1], grey[0], end, end.copy(), winSize=window, maxLevel=levels
    )
    good = (found[:, 0] > 0) & (returned[:, 0] > 0)
    good &= np.linalg.norm((back - begin)[:, 0], axis=1) <= flow.MAX_RETURN_PX
    before_m = floor_points(begin[good, 0].astype(float), previous.camera, previous.T_world_camera)
    after_m = floor_points(end[good, 0].astype(float), current.camera, current.T_world_camera)
    speed = np.hypot(*(after_m - before_m).T) / (current.stamp_s - previous.stamp_s)
    slowest: dict[int, Found] = {}
    for (u, v), value in zip(np.rint(end[good, 0]).astype(int), speed, strict=True):
        rows = np.flatnonzero(edges[max(v - 1, 0) : v + flow.BAND_PX + 1, u])
        if len(rows) and np.isfinite(value):
            foot = np.array([u, max(v - 1, 0) + rows[0]])
            group = int(groups[foot[1], foot[0]])
            if group not in slowest or value < slowest[group][1]:
                slowest[group] = (foot, float(value))
    return sorted(slowest.values(), key=lambda found: int(found[0][0]))


def _plain_ground(picture: Picture, colours: ColourRange) -> np.ndarray:
    hsv = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2HSV)
    low, high = colours.hue_deg - colours.hue_half_deg, colours.hue_deg + colours.hue_half_deg
    mask = cv2.inRange(
        hsv,
        np.array([max(low / 2, 0), max(colours.saturation[0], 0), max(colours.value[0], 0)]),
        np.array([high / 2, min(colours.saturation[1], 255), min(colours.value[1], 255)]),
    )
    mask[: max(int(min(horizon_rows(picture.camera, picture.T_world_camera))), 0)] = 0
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    touches = boxes[:, cv2.CC_STAT_TOP] + boxes[:, cv2.CC_STAT_HEIGHT] >= len(mask)
    keep = touches | (boxes[:, cv2.CC_STAT_AREA] >= CONFIG.least_floor_px)
    keep[0] = False
    return np.asarray(np.where(keep[labels], 255, 0), dtype=np.uint8)


def run() -> Comparison:
    """One pair; accuracy is the error of the smallest speed of each box.

    Accuracy has a bound, too: the allowed error divided by the largest error of ours.
    """
    previous, current = scene(np.random.default_rng(5))
    memory = FloorColourModel()
    colours = memory.learn(current.rgb)
    core = memory.core
    assert colours is not None
    assert core is not None
    candidates: dict[str, Callable[[], list[Found]]] = {
        "ours": lambda: ours(previous, current, colours, core),
        "plain_opencv": lambda: plain(previous, current, colours),
        "half_opencv": lambda: plain(halved(previous), halved(current), colours),
    }
    times = race(candidates, rounds=25)
    accuracy: dict[str, float] = {}
    worst: dict[str, float] = {}
    for name, candidate in candidates.items():
        found = candidate()
        accuracy[f"{name}_obstacles_with_flow"] = float(len(found))
        errors = speed_errors(found, halved(current) if name == "half_opencv" else current)
        worst[name] = max(abs(error) for error in errors.values())
        for left, error in errors.items():
            accuracy[f"{name}_least_speed_error_at_{left:+.2f}_mps"] = error
    return Comparison(
        {f"{name}_ms": value for name, value in times.items()},
        {
            "ratio_opencv": times["plain_opencv"] / times["ours"],
            "ratio_opencv_half": times["half_opencv"] / times["ours"],
            "ratio_allowed_error": ALLOWED_MPS / max(worst["ours"], 1e-9),
        },
        accuracy,
        {"OpenCV at half size": times["half_opencv"] / times["ours"]},
    )


def halved(picture: Picture) -> Picture:
    """The image at half its size, with its camera."""
    c = picture.camera
    camera = Camera(
        c.width // 2, c.height // 2, c.fx / 2, c.fy / 2, (c.cx - 0.5) / 2, (c.cy - 0.5) / 2
    )
    half = cv2.resize(picture.rgb, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return Picture(half, camera, picture.T_world_camera, picture.stamp_s)


def speed_errors(found: list[Found], current: Picture) -> dict[float, float]:
    """Error of the smallest speed of every box, m/s, by its initial y; infinite for a box that was not found.

    An obstacle belongs to the box whose front is near its contact with the floor; of several, the nearest counts.
    """
    errors = {}
    for ahead, left, speed in ROBOTS:
        front = np.array([ahead, left + speed * current.stamp_s])
        near = []
        for pixel, value in found:
            place = floor_points(pixel.astype(float), current.camera, current.T_world_camera)
            off = float(np.hypot(*(place - front)))
            if off < NEAR_M:
                near.append((off, value))
        errors[left] = min(near)[1] - abs(speed) if near else math.inf
    return errors


BENCHMARK = Benchmark(
    "monocular",
    "Ground, edges, corners, flow and smallest flow at 720x720, against OpenCV",
    run,
    {"ratio_opencv": 2.5, "ratio_allowed_error": 1.0},
    {},
)
