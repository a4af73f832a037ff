"""Where the colour camera of a frame stands above the floor z = 0, whatever kind of recording the frame is of.

A robot's camera stands on its body by the joints, and the body where the pipeline believes. A camera in the hand
whose depth is registered to its colours stands where the pipeline placed that depth image, levelled and raised by
the floor in it. A colour camera alone stands by its given poses, if the recording says which way is up and how
high the floor lies.
"""

from __future__ import annotations

import numpy as np

from perception.estimate import Estimate
from perception.floor.levelling import UP, level, rotation_between
from perception.floor.segmented_view import SegmentedView
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3

from ..recordings.recording import FrameError, RecordingInfo


def registered(depth: DepthView | None, colour: ColourView) -> bool:
    """Whether depth is there, and each pixel of it that of the same pixel of the colour picture."""
    return (
        depth is not None
        and depth.T_body_camera == colour.T_body_camera
        and depth.depth.shape == colour.rgb.shape[:2]
    )


def T_floor_colour(frame: Frame, estimate: Estimate, info: RecordingInfo) -> Pose3:
    """The colour camera in an upright world whose floor is z = 0.

    Args:
        frame: With a colour picture.
        estimate: What the pipeline concluded of the frame.
        info: Of its recording.

    Raises:
        FrameError: Nobody says where the camera stands.
    """
    colour = frame.colour
    if colour is None:
        raise FrameError("it has no colour picture")
    live = frame.T_world_camera is None and estimate.pose is not None
    if live and colour.T_body_camera is not None:
        return estimate.pose2.lifted() @ colour.T_body_camera
    for view in estimate.views:
        T_depth_colour = _beside(view, frame, colour)
        if T_depth_colour is not None:
            return level(view.T_map_camera, view.floor) @ T_depth_colour
    if frame.T_world_camera is None:
        raise FrameError("no floor is seen in it, and it has no pose")
    if info.gravity_up_world is None or info.floor_height_world_m is None:
        raise FrameError(
            "no floor is seen in depth, and nobody says which way is up and how high the floor lies "
            "(up and floor_height of [world] in recording.toml)"
        )
    upright = rotation_between(np.array(info.gravity_up_world), UP)
    sunk = np.array([0.0, 0.0, -info.floor_height_world_m])
    return Pose3.from_rotation(upright, sunk) @ frame.T_world_camera


def _beside(view: SegmentedView, frame: Frame, colour: ColourView) -> Pose3 | None:
    """The colour camera in the frame of the view's depth camera; None if nobody says."""
    if view.sensor == "depth" and registered(frame.depth, colour):
        return Pose3()
    if view.depth.T_body_camera is None or colour.T_body_camera is None:
        return None
    return view.depth.T_body_camera.inverse() @ colour.T_body_camera
