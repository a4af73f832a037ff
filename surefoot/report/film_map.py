"""The map of the moving picture, and what is drawn on it: view, route, steps, tracks, feet, pose. Colours are BGR."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from mapping.ground.surface import Border
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING
from perception.primitives.robot_model import RobotModel

from ..results.moment import DRAWN, UNKNOWN, Layers, Moment

WIDTH_PX, TALLEST_PX = 620, 800
MARGIN_M = 0.6  # round everything that is drawn
CONE_M = 1.2  # length of the view cone
FINE = 4  # fractional bits of drawn coordinates
PAPER, INK, MUTED = (229, 227, 225), (45, 45, 45), (150, 150, 150)
BLUE, GREEN, RED, ORANGE = (200, 110, 40), (70, 150, 50), (50, 60, 210), (40, 150, 240)


class Ground:
    """The map of everything seen so far, and where it stands in the picture."""

    def __init__(self, moments: Sequence[Moment]) -> None:
        grids = [one.grid for one in moments if one.grid is not None]
        self._cell_m = grids[0].cell_m if grids else 0.05
        low, high = _extent(moments)
        self._low = np.floor(low / self._cell_m) * self._cell_m
        size = np.ceil((high - self._low) / self._cell_m).astype(int)
        self._picture = np.full((size[1], size[0], 3), PAPER, np.uint8)
        wide, tall = (size * self._cell_m).tolist()
        self.scale = min(WIDTH_PX / wide, TALLEST_PX / tall)  # pixels a metre
        self.width, self.height = (max(round(one * self.scale), 1) for one in (wide, tall))

    def add(self, grid: Layers) -> None:
        """Enter the known cells: free is white, paler the longer it was not seen, occupied dark."""
        column, row = np.rint((grid.origin - self._low) / self._cell_m).astype(int)
        rows, columns = grid.probability.shape
        top, left = max(row, 0), max(column, 0)
        bottom = min(row + rows, self._picture.shape[0])
        right = min(column + columns, self._picture.shape[1])
        if bottom <= top or right <= left:
            return
        part = np.s_[top - row : bottom - row, left - column : right - column]
        known = grid.probability[part] != UNKNOWN
        p = grid.probability[part] / 254.0
        fresh = grid.confidence[part] / 255.0
        grey = (1.0 - p) * (242.0 + 13.0 * fresh) + p * 62.0
        there = self._picture[top:bottom, left:right]
        there[known] = np.rint(grey[known])[:, None].astype(np.uint8)

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """The map with the world's y up."""
        size = (self.width, self.height)
        return np.ascontiguousarray(
            cv2.resize(self._picture[::-1], size, interpolation=cv2.INTER_AREA)
        )

    def pixels(self, xy: Float[np.ndarray, "*n 2"]) -> np.ndarray:
        """Places of the world, m, in fine pixels of the picture."""
        u = (xy[..., 0] - self._low[0]) * self.scale
        v = self.height - (xy[..., 1] - self._low[1]) * self.scale
        return np.rint(np.stack([u, v], axis=-1) * 2**FINE).astype(np.int32)


def _extent(moments: Sequence[Moment]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest x and y of what is drawn: poses, routes, goals, and known cells near them."""
    points = [np.array([one.pose.mean[:2] for one in moments if one.pose is not None])]
    points += [one.route for one in moments] + [
        one.goal[None] for one in moments if one.goal is not None
    ]
    points += [one.corners[:, :2] for each in moments for one in each.surfaces or ()]
    near = np.concatenate(points)
    low, high = near.min(axis=0) - MARGIN_M, near.max(axis=0) + MARGIN_M
    for grid in (one.grid for one in moments[:: max(1, len(moments) // 30)]):
        if grid is not None:
            row, column = np.nonzero(grid.probability != UNKNOWN)
            cells = grid.origin + np.stack([column, row], axis=1) * grid.cell_m
            low, high = np.minimum(low, cells.min(axis=0)), np.maximum(high, cells.max(axis=0))
    return low, high


def draw_surfaces(
    picture: np.ndarray, ground: Ground, moment: Moment, span_m: tuple[float, float]
) -> None:
    """Surfaces of ground with several levels, the higher the brighter; red sides drop, black ones rise."""
    surfaces = sorted(moment.surfaces or (), key=lambda one: float(one.corners[:, 2].max()))
    low, high = span_m
    for one in surfaces:
        level = (float(one.corners[:, 2].mean()) - low) / max(high - low, 0.02)
        shade = np.array([[round(255 * min(max(0.15 + 0.75 * level, 0.0), 1.0))]], np.uint8)
        tint = cv2.applyColorMap(shade, cv2.COLORMAP_VIRIDIS)[0, 0]
        ring = ground.pixels(one.corners[:, :2])
        cv2.fillPoly(
            picture,
            [ring],
            np.rint(0.55 * tint + 0.45 * np.array(PAPER)).tolist(),
            cv2.LINE_AA,
            FINE,
        )
        for a, b, border in zip(ring, np.roll(ring, -1, axis=0), one.borders.tolist(), strict=True):
            colour, wide = {Border.DROP: (RED, 2), Border.RISE: (INK, 2)}.get(border, (MUTED, 1))
            cv2.line(picture, a.tolist(), b.tolist(), colour, wide, cv2.LINE_AA, FINE)


def draw_intention(
    picture: np.ndarray, ground: Ground, moment: Moment, robot: RobotModel | None
) -> None:
    """View cone, route, goal and next steps."""
    sensor = moment.colour_sensor if moment.colour_sensor in moment.cameras else moment.depth_sensor
    if sensor in moment.cameras and sensor in moment.lenses:
        camera, lens = moment.cameras[sensor], moment.lenses[sensor]
        u = np.array([-0.5, lens.width - 0.5])
        rays = np.stack([(u - lens.cx) / lens.fx, np.zeros(2), np.ones(2)], axis=1)
        flat = (rays @ camera.rotation.T)[:, :2]
        flat *= CONE_M / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
        corners = camera.position[:2] + np.concatenate([np.zeros((1, 2)), flat])
        faint = picture.copy()
        cv2.fillPoly(faint, [ground.pixels(corners)], ORANGE, cv2.LINE_AA, FINE)
        cv2.addWeighted(faint, 0.28, picture, 0.72, 0.0, picture)
    if len(moment.route) > 1:
        _polyline(picture, ground, moment.route, GREEN, 2)
    if moment.goal is not None:
        centre = ground.pixels(moment.goal)
        cv2.circle(picture, centre.tolist(), round(7 * 2**FINE), GREEN, 2, cv2.LINE_AA, FINE)
        cv2.circle(picture, centre.tolist(), round(2 * 2**FINE), GREEN, -1, cv2.LINE_AA, FINE)
    if robot is not None:
        for x, y, yaw in moment.steps.tolist():
            _foot(picture, ground, (x, y, yaw), robot.foot_m, GREEN, 1)


def draw_tracks(picture: np.ndarray, ground: Ground, moment: Moment) -> None:
    """Discs of the tracks; of moving ones the ellipse and where they will be."""
    predictions = moment.predictions or ((),) * len(moment.tracks)
    for one, ahead in zip(moment.tracks, predictions, strict=True):
        moves = one.moving >= MOVING
        centre = ground.pixels(one.position).tolist()
        radius = round(one.radius_m * ground.scale * 2**FINE)
        cv2.circle(
            picture, centre, radius, RED if moves else MUTED, 2 if moves else 1, cv2.LINE_AA, FINE
        )
        if moves:
            _ellipse(picture, ground, one.state.marginal(0, 1), RED, 1)
        for each in ahead:
            if moves and each.weight >= DRAWN:
                _ellipse(picture, ground, Gaussian(each.mean, each.covariance), ORANGE, 1)


def draw_robot(
    picture: np.ndarray,
    ground: Ground,
    moment: Moment,
    path: np.ndarray,
    robot: RobotModel | None,
) -> None:
    """The way so far, feet, body with its heading, and the ellipse of its place."""
    assert moment.pose is not None
    _polyline(picture, ground, path, BLUE, 2)
    x, y, yaw = moment.pose.mean.tolist()
    if robot is not None and moment.feet is not None:
        for foot_x, foot_y, foot_yaw, lifted in moment.feet.tolist():
            _foot(
                picture, ground, (foot_x, foot_y, foot_yaw), robot.foot_m, BLUE, 1 if lifted else -1
            )
    nose = np.array([[x, y], [x + 0.2 * math.cos(yaw), y + 0.2 * math.sin(yaw)]])
    _polyline(picture, ground, nose, INK, 2)
    cv2.circle(picture, ground.pixels(nose[0]).tolist(), 4 * 2**FINE, INK, -1, cv2.LINE_AA, FINE)
    _ellipse(picture, ground, moment.pose.marginal(0, 1), INK, 1)


def _foot(
    picture: np.ndarray,
    ground: Ground,
    pose: tuple[float, float, float],
    size_m: tuple[float, float],
    colour: tuple[int, int, int],
    thickness: int,
) -> None:
    """A rectangle on the floor; filled for a negative thickness."""
    x, y, yaw = pose
    along, across = size_m[0] / 2, size_m[1] / 2
    corners = np.array([[along, across], [-along, across], [-along, -across], [along, -across]])
    c, s = math.cos(yaw), math.sin(yaw)
    places = [ground.pixels(corners @ np.array([[c, s], [-s, c]]) + [x, y])]
    if thickness < 0:
        cv2.fillPoly(picture, places, colour, cv2.LINE_AA, FINE)
    else:
        cv2.polylines(picture, places, True, colour, thickness, cv2.LINE_AA, FINE)


def _ellipse(
    picture: np.ndarray,
    ground: Ground,
    gaussian: Gaussian,
    colour: tuple[int, int, int],
    thickness: int,
) -> None:
    """The 95 % ellipse."""
    if not np.isfinite(gaussian.covariance).all():
        return
    long_m, short_m, direction = gaussian.ellipse()
    turn = np.linspace(0.0, 2.0 * math.pi, 33)[:-1]
    c, s = math.cos(direction), math.sin(direction)
    points = np.stack([long_m * np.cos(turn), short_m * np.sin(turn)], axis=1)
    _polyline(
        picture,
        ground,
        gaussian.mean + points @ np.array([[c, s], [-s, c]]),
        colour,
        thickness,
        True,
    )


def _polyline(
    picture: np.ndarray,
    ground: Ground,
    points: np.ndarray,
    colour: tuple[int, int, int],
    thickness: int,
    closed: bool = False,
) -> None:
    cv2.polylines(picture, [ground.pixels(points)], closed, colour, thickness, cv2.LINE_AA, FINE)
