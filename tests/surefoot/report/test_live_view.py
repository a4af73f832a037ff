"""The live page: what it passes to viser, and its error message without viser."""

from __future__ import annotations

import sys
import types
from types import SimpleNamespace

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3, head_rotation
from planning.planners.avoidance_planner import AvoidancePlanner
from planning.planners.settings import PlanningConfig
from surefoot.config.schema import Config
from surefoot.recordings.recording import RecordingInfo
from surefoot.report.live_view import PANE_PX, LivePage
from surefoot.run.pipeline import Pipeline


class Recorder:
    """Replaces all parts of viser; keeps the panes by their label."""

    def __init__(self):
        self.panes = {}
        self.scene = self.gui = self

    def add_image(self, picture, values=None, label="", **options):
        if not label:  # the map on the floor
            return None
        handle = SimpleNamespace(image=picture)
        assert label not in self.panes
        self.panes[label] = handle
        return handle

    def __getattr__(self, name):  # points, frames, boxes: not checked
        return lambda *values, **options: SimpleNamespace(remove=lambda: None)


@pytest.fixture
def server(monkeypatch):
    recorder = Recorder()
    library = types.ModuleType("viser")
    library.ViserServer = lambda **options: recorder
    monkeypatch.setitem(sys.modules, "viser", library)
    return recorder


def cycle(pipeline, grey):
    """A frame with a grey image and a floor up to 4 m away, and its estimate."""
    camera = Camera.from_view(64, 48, 0.8, 0.6)
    T = Pose3.from_rotation(head_rotation(0.0, 0.3), np.array([0.0, 0.0, 0.4]))
    down = -(camera.rays @ T.rotation.T)[..., 2]
    z = np.where(down > 0.1, 0.4 / np.maximum(down, 0.1), np.nan).astype(np.float32)
    colour = ColourView(np.full((48, 64, 3), grey, np.uint8), camera, T)
    frame = Frame(0.1 * grey, colour=colour, depth=DepthView(z, camera, T))
    return frame, pipeline.cycle(frame)


def test_camera_depth_and_panorama_are_shown_beside_the_3d_view(server):
    page, pipeline = LivePage(), Pipeline(Config(), RecordingInfo("test", "rgbd"))
    page.show(cycle(pipeline, 90)[0], cycle(pipeline, 91)[1])
    assert set(server.panes) == {"Camera", "Depth (depth)"}
    planner = AvoidancePlanner(PlanningConfig(), [(1.0, 0.0)])
    drawing = SimpleNamespace(range_m=np.full((20, 100), 1.0))
    planner.looks = [SimpleNamespace(panorama=SimpleNamespace(drawing=drawing))]
    frame, world = cycle(pipeline, 200)
    page.show(frame, world, planner)
    assert set(server.panes) == {"Camera", "Depth (depth)", "Panoramic environment map"}
    assert server.panes["Camera"].image.shape == (240, PANE_PX, 3)
    assert (server.panes["Camera"].image == 200).all()  # the newest image, in the same pane
    painted = server.panes["Depth (depth)"].image
    assert (painted[0] == 0).all()  # missing range is black
    assert painted[-1].sum() > painted[180].sum()  # near is brighter
    assert server.panes["Panoramic environment map"].image.shape == (64, PANE_PX, 3)


def test_without_viser_the_error_names_the_extra_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"surefoot\[viz\]"):
        LivePage()
