"""Whether the given poses of a recording can be those of its camera; without poses, whether it is held upright.

Poses far from the origin of their world are refused: maps hold single precision and hash keys of voxels, so that at map
coordinates of a country, such as UTM, cloud and mesh would be empty or torn.

Depth images whose view has changed are compared by the given poses and by other readings of them, see `pose_readings`.
In the same images a floor is sought twice: level by the stated vertical of the poses' world, and, if there is none or
the camera would look down on it, as of a camera held upright. Without poses a floor is sought as of a camera held
upright, and of one held upside down. A small error is not noticed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.depth import structured_light
from perception.depth.points import Points, from_depth
from perception.depth.reach import ReachesConfig
from perception.floor.choose import find
from perception.floor.prior import handheld_prior
from perception.primitives.errors import RecordingError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.pose import Pose3

from .pose_readings import IGNORE, LEAST_PAIRS, PRONE, PoseReadings
from .recording import (
    DESCRIPTION_FILE,
    FOLLOWING,
    Recording,
    RecordingInfo,
    SkippedFrame,
    odd_intrinsics,
    slow_stamps,
)

FARTHEST_M = 1e4  # ours: of a given pose along an axis; single precision is then 1 mm
_FAST_M_S, _FAR_M = 5.0, 0.5  # ours: faster and farther from frame to frame no camera is carried
_MOST_FLOORS = 30  # ours: images in which a floor is sought; ms each
_TILTED = math.radians(45.0)  # ours: steeper than any ramp
_STEEP = math.cos(_TILTED)  # ours: looking down so steeply, the camera may look at a wall
_ALIKE = math.cos(math.radians(5.0))  # ours: length of the mean normal of one floor


def far_pose(frame: Frame) -> str:
    """What is wrong with the place of a given pose, and what to do; empty if nothing is."""
    pose = frame.T_world_camera
    if pose is None or max(map(abs, pose.translation)) <= FARTHEST_M:
        return ""
    place = ", ".join(f"{metres:.1f}" for metres in pose.translation)
    return (
        f"its pose is at ({place}) m; poses within {FARTHEST_M:.0f} m of the origin of their world were expected. Subtract "
        "the same offset from all of them, check that they are in m, or ignore them (--ignore-poses)"
    )


class GivenPoses:
    """A recording, refused at the first pose too far away; remarks at the end if its poses cannot be right."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._start()

    def _start(self) -> None:
        self._fastest = (0.0, 0.0)
        self._odd = ""
        self._stamps: list[float] = []  # the first ones
        self._moving = False
        self._sought = self._level = 0
        self._readings = PoseReadings()
        self._tilted: list[Float[np.ndarray, "3"]] = []  # normals of floors, world
        self._upright = self._upside_down = 0

    @property
    def info(self) -> RecordingInfo:
        """As the recording's."""
        return self._recording.info

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._recording.skipped

    @property
    def remarks(self) -> list[str]:
        """The recording's own, and what speaks against its poses."""
        found = [one for one in (self._odd, slow_stamps(self._stamps)) if one]
        speed, stamp_s = self._fastest
        if speed:
            found.append(
                f"the given poses move the camera at {speed:.4g} m/s (at {stamp_s:.6f} s); are they in metres?"
            )
        if self._readings.changes >= LEAST_PAIRS and not self._moving:
            found.append(f"all given poses are the same, but the depth images change; {IGNORE}")
        elif not speed and (better := self._readings.better):
            reading, pairs = better
            found.append(
                f"in {pairs} pairs of images the depth contradicts the given poses: it fits better {reading.words}; "
                f"{reading.advice}"
            )
        elif len(self._tilted) >= max(LEAST_PAIRS, PRONE * self._level):
            found += self._other_vertical()
        if self._upside_down >= max(LEAST_PAIRS, PRONE * self._upright, self._sought / 2):
            found.append(
                f"{self._upside_down} images show a floor above the camera, {self._upright} one below it. If the camera "
                "hung upside down, and did not look at a ceiling, turn all images by 180 deg; the principal point becomes "
                "(width - 1 - cx, height - 1 - cy)"
            )
        return [*self._recording.remarks, *found]

    def _other_vertical(self) -> list[str]:
        """The remark on a floor that is tilted by the stated vertical; none if the images do not agree on it."""
        mean = np.mean(self._tilted, axis=0)
        length = float(np.linalg.norm(mean))
        if length < _ALIKE:
            return []
        stated = ", ".join(f"{axis:.2f}" for axis in self.info.gravity_up_world or ())
        shown = ", ".join(f"{axis:.2f}" for axis in mean / length)
        return [
            f"{len(self._tilted)} images show a floor if ({shown}) is up in the world of the poses, not if ({stated}) "
            f"is. If the camera was held upright, write up = [{shown}] under [world] of a {DESCRIPTION_FILE}"
        ]

    def frames(self) -> Iterator[Frame]:
        """The readable frames.

        Raises:
            RecordingError: A pose is too far away.
        """
        self._start()
        last: tuple[Pose3, float] | None = None
        for frame in self._recording.frames():
            if fault := far_pose(frame):
                raise RecordingError(f"{self.info.name}: frame at {frame.stamp_s} s: {fault}")
            self._odd = self._odd or odd_intrinsics(frame)
            self._stamps += [frame.stamp_s] * (len(self._stamps) <= FOLLOWING)
            pose, depth = frame.T_world_camera, frame.depth
            if pose is not None:
                if last is not None:
                    self._check_step(*last, pose, frame.stamp_s)
                last = pose, frame.stamp_s
            if self._readings.add(frame.stamp_s, pose, depth) and depth is not None:
                if pose is not None:
                    self._check_floor(pose, depth)
                elif depth.T_body_camera is None:
                    self._check_upright(depth)
            yield frame

    def _check_step(self, last: Pose3, last_s: float, pose: Pose3, stamp_s: float) -> None:
        step_m, pause_s = math.dist(last.position, pose.position), stamp_s - last_s
        if step_m > _FAR_M and step_m > _FAST_M_S * pause_s > 0.0:
            self._fastest = max(self._fastest, (step_m / pause_s, stamp_s))
        self._moving |= step_m > 0.0 or not np.array_equal(last.rotation, pose.rotation)

    def _check_floor(self, pose: Pose3, depth: DepthView) -> None:
        """Look for a floor by the stated vertical, or else for one against it."""
        if self.info.gravity_up_world is None or self._sought >= _MOST_FLOORS:
            return
        self._sought += 1
        points = _points(depth)
        up, rng = np.array(self.info.gravity_up_world), np.random.default_rng(0)
        up_camera = pose.rotation.T @ up
        level = find(points, handheld_prior(up_camera), rng)
        if level is None or abs(up_camera[2]) > _STEEP:
            upright = find(points, handheld_prior(None), rng)
            normal = up if upright is None else pose.rotation @ upright.plane.normal
            if normal @ up < math.cos(_TILTED):
                self._tilted.append(normal)
                return
        self._level += level is not None

    def _check_upright(self, depth: DepthView) -> None:
        """Look for a floor below the camera and above it; an image with both, as floor and ceiling, tells nothing."""
        if self._sought >= _MOST_FLOORS:
            return
        self._sought += 1
        points, rng = _points(depth), np.random.default_rng(0)
        below, above = (
            find(points, replace(prior, normal=sign * prior.normal), rng) is not None
            for prior in (handheld_prior(None),)
            for sign in (1.0, -1.0)
        )
        self._upright += below and not above
        self._upside_down += above and not below


def _points(view: DepthView) -> Points:
    depth = structured_light.depth(view)
    reach = ReachesConfig().of("depth", depth)
    return from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
