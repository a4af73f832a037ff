"""The pose of the colour camera of a frame over the floor z = 0, for every kind of recording.

On a walking body the pose follows from the joint angles and the estimated pose of the body. A camera whose depth
is registered to its colour has the pose of that depth image, levelled and raised by the floor in it. A colour
camera without depth has its given pose, if the recording states which way is up and how high the floor is.
"""

from __future__ import annotations

import numpy as np

from perception.depth.sources import registered
from perception.estimate import Estimate
from perception.floor.levelling import UP, level, rotation_between
from perception.floor.segmented_view import SegmentedView
from perception.primitives.frame import ColourView, Frame
from perception.primitives.pose import Pose3

from ..recordings.recording import FrameError, RecordingInfo


def T_floor_colour(frame: Frame, estimate: Estimate, info: RecordingInfo) -> Pose3:
    """The colour camera in an upright frame whose floor is z = 0.

    Args:
        frame: A frame with a colour picture.
        estimate: The pipeline's estimate of this frame.
        info: The recording.

    Raises:
        FrameError: The pose of the colour camera is unknown.
    """
    colour = frame.colour
    if colour is None:
        raise FrameError("it has no colour picture")
    live = frame.T_world_camera is None and estimate.pose is not None
    if live and colour.T_body_camera is not None:
        return estimate.pose2.lifted() @ colour.T_body_camera
    for view in estimate.views:
        T_depth_colour = _relative_pose(view, frame, colour)
        if T_depth_colour is not None:
            return level(view.T_map_camera, view.floor) @ T_depth_colour
    if frame.T_world_camera is None:
        raise FrameError("no floor is seen in it, and it has no pose")
    if info.gravity_up_world is None or info.floor_height_world_m is None:
        raise FrameError(
            "no floor is seen in depth, and the recording does not state which way is up and how high the "
            "floor is (up and floor_height of [world] in recording.toml)"
        )
    upright = rotation_between(np.array(info.gravity_up_world), UP)
    sunk = np.array([0.0, 0.0, -info.floor_height_world_m])
    return Pose3.from_rotation(upright, sunk) @ frame.T_world_camera


def _relative_pose(view: SegmentedView, frame: Frame, colour: ColourView) -> Pose3 | None:
    """The colour camera in the frame of the view's depth camera; None if it is unknown."""
    if view.sensor == "depth" and registered(frame.depth, colour):
        return Pose3()
    if view.depth.T_body_camera is None or colour.T_body_camera is None:
        return None
    return view.depth.T_body_camera.inverse() @ colour.T_body_camera
