"""Drawings of a moment for viewers: robot, floor, tracks, plan and footprints as Foxglove's SceneUpdate.

What a later moment does not have is deleted, so that nothing stands in a viewer that is over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp

from mapping.ground.surface import Border
from mapping.objects.footprints import Footprint
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING
from perception.primitives.robot_model import RobotModel

from ..foxglove import MAP, frame_id, timestamp
from .moment import DRAWN, Moment, SurfaceSeen

ROBOT, TRACKS, ROUTE, STEPS = "/estimate/robot", "/estimate/tracks", "/plan/route", "/plan/steps"
FLOOR, STATIC = "/estimate/floor", "/estimate/footprints_drawn"
SURFACES = "/estimate/surfaces"
THIN_M, FOOT_M = 0.01, 0.02  # heights of what lies on the floor, and of a foot
FLOOR_M = 1.0  # side of the square that shows the floor
BLUE, GREY, GREEN = (0.20, 0.45, 0.85), (0.5, 0.5, 0.5), (0.2, 0.65, 0.3)
RED, ORANGE = (0.85, 0.25, 0.2), (0.95, 0.6, 0.1)
BORDERS = {Border.UNSEEN: GREY, Border.DROP: RED, Border.RISE: (0.1, 0.1, 0.1)}


def drawings(
    moment: Moment, robot: RobotModel | None, drawn: set[int]
) -> Iterator[tuple[str, SceneUpdate | PosesInFrame]]:
    """Topics and drawings of one moment.

    Args:
        moment: The moment.
        robot: Sizes of the body; None draws only where it is.
        drawn: Tracks that are drawn; updated.
    """
    stamp = timestamp(moment.stamp_s)
    if moment.pose is not None:
        yield ROBOT, _robot(moment, moment.pose, robot, stamp)
    if any(name in moment.cameras for name in moment.floor):
        yield FLOOR, _floors(moment, stamp)
    if moment.surfaces is not None:
        yield SURFACES, _surfaces(moment.surfaces, stamp)
    if moment.tracks or drawn:
        yield TRACKS, _tracks(moment, drawn, stamp)
    if moment.why:
        yield ROUTE, _route(moment, stamp)
        yield STEPS, _steps(moment, stamp)


def draw_footprints(footprints: Sequence[Footprint], stamp_s: float) -> SceneUpdate:
    """Outlines of static obstacles, at the floor and at their tops."""
    update, stamp = SceneUpdate(), timestamp(stamp_s)
    for number, one in enumerate(footprints):
        entity = _entity(update, f"footprint {number}", stamp)
        for height_m in (THIN_M, one.height_m):
            _line(entity, one.outline, ORANGE, 0.015, height_m, closed=True)
    return update


def _robot(
    moment: Moment, pose: Gaussian, robot: RobotModel | None, stamp: Timestamp
) -> SceneUpdate:
    update = SceneUpdate()
    entity = _entity(update, "robot", stamp)
    x, y, yaw = pose.mean.tolist()
    body_m, *soles_m = [0.0] * 3 if moment.heights_m is None else moment.heights_m.tolist()
    _ellipse(entity, pose.marginal(0, 1), body_m + THIN_M, (*BLUE, 0.5))
    if robot is None:
        return update
    cube = entity.cubes.add(color=_colour(BLUE, 0.35))
    cube.pose.CopyFrom(_pose(x, y, body_m + robot.height_m / 2, yaw))
    cube.size.x, cube.size.y, cube.size.z = robot.depth_m, robot.width_m, robot.height_m
    feet = [] if moment.feet is None else moment.feet.tolist()
    for (foot_x, foot_y, foot_yaw, lifted), sole_m in zip(feet, soles_m, strict=False):
        cube = entity.cubes.add(color=_colour(BLUE, 0.4 if lifted else 0.95))
        raised_m = FOOT_M * lifted if moment.heights_m is None else 0.0
        cube.pose.CopyFrom(_pose(foot_x, foot_y, sole_m + FOOT_M / 2 + raised_m, foot_yaw))
        cube.size.x, cube.size.y, cube.size.z = *robot.foot_m, FOOT_M
    return update


def _floors(moment: Moment, stamp: Timestamp) -> SceneUpdate:
    """A square below each camera, in its frame, as thick as the 95 % interval of the height; grey if only expected."""
    update = SceneUpdate()
    for sensor, floor in moment.floor.items():
        if sensor not in moment.cameras:
            continue
        entity = update.entities.add(timestamp=stamp, frame_id=frame_id(sensor), id=sensor)
        square = entity.cubes.add(color=_colour(GREEN if floor.share else GREY, 0.3))
        nx, ny, nz = floor.normal.tolist()
        place = square.pose.position
        place.x, place.y, place.z = (-floor.height_m * one for one in (nx, ny, nz))
        turn = square.pose.orientation  # the shortest from the z axis to the normal
        length = math.sqrt(2.0 * (1.0 + nz)) if nz > -1.0 else 0.0
        turn.x, turn.y, turn.w = (-ny / length, nx / length, length / 2) if length else (1.0, 0, 0)
        square.size.x = square.size.y = FLOOR_M
        square.size.z = 2.0 * 1.96 * math.sqrt(floor.covariance[2, 2])
    return update


def _surfaces(surfaces: Sequence[SurfaceSeen], stamp: Timestamp) -> SceneUpdate:
    """The outline of every surface: red where it drops, black where something rises, grey where nothing was seen beyond."""
    update = SceneUpdate()
    entity = _entity(update, "surfaces", stamp)
    for one in surfaces:
        after = np.roll(one.corners, -1, axis=0)
        for a, b, border in zip(one.corners, after, one.borders, strict=True):
            line = entity.lines.add(
                thickness=0.015, color=_colour(BORDERS[Border(int(border))], 1.0)
            )
            line.type = LinePrimitive.LINE_STRIP
            line.pose.orientation.w = 1.0
            for x, y, z in (a.tolist(), b.tolist()):
                line.points.add(x=x, y=y, z=z + THIN_M)
    return update


def _tracks(moment: Moment, drawn: set[int], stamp: Timestamp) -> SceneUpdate:
    """A cylinder with ellipse, number and predictions for each; deletions of those that ended."""
    update = SceneUpdate()
    for gone in sorted(drawn - {one.track for one in moment.tracks}):
        update.deletions.add(timestamp=stamp, id=f"track {gone}")
    drawn.clear()
    drawn.update(one.track for one in moment.tracks)
    predictions = moment.predictions or ((),) * len(moment.tracks)
    for one, ahead in zip(moment.tracks, predictions, strict=True):
        entity = _entity(update, f"track {one.track}", stamp)
        colour = RED if one.moving >= MOVING else GREY
        x, y = one.position.tolist()
        body = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0, color=_colour(colour, 0.45))
        body.pose.CopyFrom(_pose(x, y, one.height_m / 2))
        body.size.x = body.size.y = 2.0 * one.radius_m
        body.size.z = max(one.height_m, THIN_M)
        _ellipse(entity, one.state.marginal(0, 1), one.height_m, (*colour, 0.7))
        text = entity.texts.add(font_size=0.08, billboard=True, color=_colour(colour, 1.0))
        text.text = f"{one.track}: moves {one.moving:.0%}"
        text.pose.CopyFrom(_pose(x, y, one.height_m + 0.1))
        for each in (one for one in ahead if one.weight >= DRAWN):
            share = 0.35 * min(each.weight, 1.0)
            _ellipse(entity, Gaussian(each.mean, each.covariance), THIN_M, (*colour, share))
    return update


def _route(moment: Moment, stamp: Timestamp) -> SceneUpdate:
    update = SceneUpdate()
    entity = _entity(update, "route", stamp)
    if len(moment.route):
        _line(entity, moment.route, GREEN, 0.02, THIN_M)
    if moment.goal is not None:
        x, y = moment.goal.tolist()
        goal = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0, color=_colour(GREEN, 0.8))
        goal.pose.CopyFrom(_pose(x, y, THIN_M / 2))
        goal.size.x = goal.size.y = 0.2
        goal.size.z = THIN_M
    return update


def _steps(moment: Moment, stamp: Timestamp) -> PosesInFrame:
    steps = [_pose(x, y, THIN_M, yaw) for x, y, yaw in moment.steps.tolist()]
    return PosesInFrame(timestamp=stamp, frame_id=MAP, poses=steps)


def _entity(update: SceneUpdate, name: str, stamp: Timestamp) -> SceneEntity:
    return update.entities.add(timestamp=stamp, frame_id=MAP, id=name)


def _ellipse(
    entity: SceneEntity,
    gaussian: Gaussian,
    height_m: float,
    colour: tuple[float, float, float, float],
) -> None:
    """The 95 % ellipse as a flat sphere; none where the covariance is not finite."""
    if not np.isfinite(gaussian.covariance).all():
        return
    long_m, short_m, direction = gaussian.ellipse()
    sphere = entity.spheres.add(color=Color(r=colour[0], g=colour[1], b=colour[2], a=colour[3]))
    x, y = gaussian.mean.tolist()
    sphere.pose.CopyFrom(_pose(x, y, height_m, direction))
    sphere.size.x, sphere.size.y, sphere.size.z = 2.0 * long_m, 2.0 * short_m, THIN_M


def _line(
    entity: SceneEntity,
    points: np.ndarray,
    colour: tuple[float, float, float],
    thickness_m: float,
    height_m: float,
    closed: bool = False,
) -> None:
    line = entity.lines.add(thickness=thickness_m, color=_colour(colour, 1.0))
    line.type = LinePrimitive.LINE_LOOP if closed else LinePrimitive.LINE_STRIP
    line.pose.orientation.w = 1.0
    for x, y in points.tolist():
        line.points.add(x=x, y=y, z=height_m)


def _pose(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def _colour(colour: tuple[float, float, float], alpha: float) -> Color:
    r, g, b = colour
    return Color(r=r, g=g, b=b, a=alpha)
