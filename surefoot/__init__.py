"""Surefoot: a humanoid robot sees where it may step.

The library for a user's own programs; the names below load what they need on first use.

Values: `Camera`, `Plane`, `Pose2`, `Pose3`, `Gaussian`, `Landmark`, `Obstacle`, `Footprint`, `Cluster`, `Region`, `Staircase`, `RobotModel`;
`Frame` with `DepthView`, `RangeView`, `StereoView`, `ColourView`, `StepOdometry`, `Imu`, `Depth`; `WorldModel`;
`Config`; `SurefootError` and its kinds `InputError`, `RecordingError`, `OutputError`.

Functions on NumPy arrays: `find_floor`, `find_regions`, `find_stairs`, `find_obstacles`, `find_footprints`,
`stereo_depth`, `gaze_map`, `find_path`. Objects that live from frame to frame: `Tracker`, `Pipeline`. Whole runs: `simulate`, `process`, `map`,
`panorama`, `monocular`, `evaluate`, which return a `Run`.

Plug-ins, by class or as "package.module:Class": `Planner` (gives a `Decision` of `WalkCommand` and `GazeCommand`),
`GazePolicy`, `MotionModel` (takes a `Detection`, gives an `Innovation`), `DepthSource`, `Recording` (with `RecordingInfo`). `examples/` has one of each.

Lengths are in m, angles in rad, time in s. Body and map frames have z up, x ahead and y left; camera frames x
right, y down, z ahead. `T_a_b` maps points of frame b to frame a.

Below this, read `run.pipeline` (from pixels to the world model), `run.loop` (the walking loop), `library`.

Sources: seeds 000, 001, 003 and 004, joined.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .namesakes import refuse as _refuse_namesakes

_refuse_namesakes()

if TYPE_CHECKING:
    from mapping.objects.footprints import Footprint
    from perception.depth.sources import DepthSource
    from perception.filtering.consistency import Innovation
    from perception.obstacles.clustering import Cluster
    from perception.obstacles.motion_model import MotionModel
    from perception.obstacles.track import Detection
    from perception.primitives.camera import Camera
    from perception.primitives.errors import InputError, OutputError, RecordingError, SurefootError
    from perception.primitives.frame import (
        ColourView,
        Depth,
        DepthView,
        Frame,
        Imu,
        RangeView,
        StepOdometry,
        StereoView,
    )
    from perception.primitives.gaussian import Gaussian
    from perception.primitives.landmark import Landmark
    from perception.primitives.obstacle import Obstacle
    from perception.primitives.plane import Plane
    from perception.primitives.pose import Pose2, Pose3
    from perception.primitives.robot_model import RobotModel
    from perception.terrain.region import Region
    from perception.terrain.staircase import Staircase
    from planning.commands import GazeCommand, WalkCommand
    from planning.gaze.policy import GazePolicy
    from planning.planners.planner import Decision, Planner
    from planning.world_model import WorldModel

    from .config.schema import Config
    from .library.floor import find_floor
    from .library.gaze import gaze_map
    from .library.obstacles import find_footprints, find_obstacles
    from .library.path import find_path
    from .library.pipeline import Pipeline
    from .library.run_results import Run
    from .library.stereo import stereo_depth
    from .library.terrain import find_regions, find_stairs
    from .library.tracker import Tracker
    from .library.verbs import evaluate, map, monocular, panorama, process, simulate
    from .recordings.recording import Recording, RecordingInfo

    __version__: str

_MODULES = {
    "mapping.objects.footprints": ("Footprint",),
    "perception.depth.sources": ("DepthSource",),
    "perception.filtering.consistency": ("Innovation",),
    "perception.obstacles.clustering": ("Cluster",),
    "perception.obstacles.motion_model": ("MotionModel",),
    "perception.obstacles.track": ("Detection",),
    "perception.primitives.camera": ("Camera",),
    "perception.primitives.errors": ("InputError", "OutputError", "RecordingError", "SurefootError"),
    "perception.primitives.frame": (
        "ColourView", "Depth", "DepthView", "Frame", "Imu", "RangeView", "StepOdometry", "StereoView",
    ),
    "perception.primitives.gaussian": ("Gaussian",),
    "perception.primitives.landmark": ("Landmark",),
    "perception.primitives.obstacle": ("Obstacle",),
    "perception.primitives.plane": ("Plane",),
    "perception.primitives.pose": ("Pose2", "Pose3"),
    "perception.primitives.robot_model": ("RobotModel",),
    "perception.terrain.region": ("Region",),
    "perception.terrain.staircase": ("Staircase",),
    "planning.commands": ("GazeCommand", "WalkCommand"),
    "planning.gaze.policy": ("GazePolicy",),
    "planning.planners.planner": ("Decision", "Planner"),
    "planning.world_model": ("WorldModel",),
    "surefoot.config.schema": ("Config",),
    "surefoot.library.floor": ("find_floor",),
    "surefoot.library.gaze": ("gaze_map",),
    "surefoot.library.obstacles": ("find_footprints", "find_obstacles"),
    "surefoot.library.path": ("find_path",),
    "surefoot.library.pipeline": ("Pipeline",),
    "surefoot.library.run_results": ("Run",),
    "surefoot.library.stereo": ("stereo_depth",),
    "surefoot.library.terrain": ("find_regions", "find_stairs"),
    "surefoot.library.tracker": ("Tracker",),
    "surefoot.library.verbs": ("evaluate", "map", "monocular", "panorama", "process", "simulate"),
    "surefoot.recordings.recording": ("Recording", "RecordingInfo"),
}  # fmt: skip
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Camera", "Cluster", "ColourView", "Config", "Decision", "Depth", "DepthSource", "DepthView", "Detection", "Footprint",
    "Frame", "Gaussian", "GazeCommand", "GazePolicy", "Imu", "Innovation", "InputError", "Landmark", "MotionModel",
    "Obstacle", "OutputError", "Pipeline", "Plane", "Planner", "Pose2", "Pose3", "RangeView", "Recording", "RecordingError",
    "RecordingInfo", "Region", "RobotModel", "Run", "Staircase", "StepOdometry", "StereoView", "SurefootError", "Tracker", "WalkCommand",
    "WorldModel", "__version__", "evaluate", "find_floor", "find_footprints", "find_obstacles", "find_path",
    "find_regions", "find_stairs", "gaze_map", "map", "monocular", "panorama", "process", "simulate", "stereo_depth",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("surefoot")
    if name not in _HOME:
        raise AttributeError(f"module 'surefoot' has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*__all__, *globals()})
