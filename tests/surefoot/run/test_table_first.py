"""A hand-held recording that begins above a table: the floor is found as soon as it is in view."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame
from perception.primitives.pose import Pose3, head_rotation
from surefoot.config.schema import Config
from surefoot.recordings.recording import RecordingInfo
from surefoot.run.pipeline import Pipeline

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
EYE_M, TOP_M = 1.5, 0.75
TABLE = ((0.0, 2.0), (-1.5, 1.0))
"""Its range of x and y, m."""


def depth_of(pose: Pose3, rng: np.random.Generator) -> np.ndarray:
    """A table on a floor with the noise of structured light (Nguyen 2012), m."""
    rays = CAMERA.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        floor, top = (
            np.where(rays[..., 2] < 0.0, -height / rays[..., 2], np.inf)
            for height in (EYE_M, EYE_M - TOP_M)
        )
    places = pose.position + np.where(np.isfinite(top), top, 0.0)[..., None] * rays
    on = np.all(
        [(low < places[..., k]) & (places[..., k] < high) for k, (low, high) in enumerate(TABLE)],
        axis=0,
    )
    z = np.where(on, top, floor)
    z[(z > 4.0) | (z < 0.3)] = np.nan
    return (z + (0.0012 + 0.0019 * (z - 0.4) ** 2) * rng.standard_normal(z.shape)).astype(np.float32)  # fmt: skip


def test_a_table_that_was_taken_for_the_floor_is_given_up():
    rng = np.random.default_rng(0)
    info = RecordingInfo("room", "plain", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0))
    pipeline = Pipeline(Config(), info)
    heights = []
    for k in range(24):
        turn = head_rotation(np.radians(5.0 * k), np.radians(50.0))
        pose = Pose3.from_rotation(turn, np.array([0.4, 0.0, EYE_M]))
        view = DepthView(depth_of(pose, rng), CAMERA)
        frame = Frame(stamp_s=0.1 * k, depth=view, T_world_camera=pose)
        floor = pipeline.cycle(frame).floor
        heights.append(np.nan if floor is None else floor.offset_m)
    assert heights[0] == pytest.approx(EYE_M - TOP_M, abs=0.02)  # nothing is below the table yet
    assert heights[-1] == pytest.approx(EYE_M, abs=0.03)
