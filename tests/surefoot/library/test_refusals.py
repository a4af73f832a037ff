"""Every public function with every wrong argument: refused by an `InputError` that names it."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

import surefoot as sf
from perception.primitives.frame import Frame, RangeView

if os.environ.get("CHECK_SHAPES"):
    pytest.skip("the check of types comes before the library", allow_module_level=True)

CAMERA = sf.Camera(8, 6, 10.0, 10.0, 3.5, 2.5)
DEPTH = np.ones((6, 8), np.float32)
GREY = np.zeros((6, 8), np.uint8)
UP = (0.0, -1.0, 0.0)
EYE = np.eye(2)
RAGGED = [[1.0, 2.0], [3.0]]
NAN = float("nan")

HUGE = 1e300


class Gradient:
    """A tensor of another library that will not become an array."""

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise RuntimeError("call detach() first")


BEHIND_MASK = np.ma.array(DEPTH, mask=DEPTH > 0.0)
DEPTHS = [
    None,
    "a",
    RAGGED,
    DEPTH[:3],
    DEPTH[..., None],
    DEPTH.astype(int),
    1000.0 * DEPTH,
    BEHIND_MASK,
    Gradient(),
]
CAMERAS = [None, CAMERA.matrix, "a"]
MOUNTS = [np.eye(4), UP, "a", sf.Pose3((0.0, NAN, 0.0)), sf.Pose3((0.0, 0.0))]
POINTS = ["a", 1.0, (1.0,), (NAN, 0.0), RAGGED, EYE, (HUGE, 0.0)]
DIRECTIONS = ["a", 1.0, (1.0, 0.0), (NAN, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, HUGE, 0.0)]
NUMBERS = ["a", "1", None, NAN, (1.0, 2.0), HUGE, Gradient()]
FLAGS = ["false", None, 1]
RADII = ["a", -1.0, NAN, (0.1, 0.1), RAGGED]
SEEDS = ["a", 1.5, -1]
IMAGES = [None, "a", RAGGED, DEPTH, GREY[:3], GREY[..., None]]
ROBOTS = ["g1", object()]
NAMES = [object(), 5]
PATHS = [5, object()]
ON_DEPTH: dict[str, list[Any]] = {
    "depth_m": DEPTHS,
    "camera": CAMERAS,
    "scale_per_metre": ["a", "1", 0.0, NAN, 1e-300, 1000.0],
    "sigma_m": ["a", RAGGED, DEPTH[:3], 0.0, -DEPTH, 1e-20, HUGE],
    "nearest_m": [*NUMBERS, -1.0, 5.0],
    "farthest_m": [*NUMBERS, -1.0],
    "sensor": [None, 5, "lidar", ["tof"], "stereo"],
}
OF_A_RECORDING: dict[str, list[Any]] = {
    "recording": [None, *PATHS],
    "description": PATHS,
    "config": PATHS,
    "settings": [5, ["a"]],
    "out": PATHS,
}


def added(*, stamp_s: Any = 0.0, walks: bool = True, **given: Any) -> Any:
    """A first frame in a pipeline, of a walking body or of a camera alone."""
    return sf.Pipeline(start=sf.Pose2() if walks else None).add(stamp_s, **given)


def framed(frame: Any) -> Any:
    """A frame in a pipeline."""
    return sf.Pipeline(start=sf.Pose2()).add_frame(frame)


def alone(**given: Any) -> Any:
    """A gaze without obstacles."""
    return sf.gaze_map((1.0, 0.0), **given)


def updated(**given: Any) -> Any:
    """Detections of a new tracker."""
    return sf.Tracker().update(**given)


CASES: dict[Any, tuple[dict[str, Any], dict[str, list[Any]]]] = {
    sf.find_floor: (
        {"depth_m": DEPTH, "camera": CAMERA},
        {**ON_DEPTH, "up": DIRECTIONS, "T_body_camera": MOUNTS, "calibrated": FLAGS, "seed": SEEDS},
    ),
    sf.find_regions: ({"depth_m": DEPTH, "camera": CAMERA}, ON_DEPTH),
    sf.find_stairs: (
        {"depth_m": DEPTH, "camera": CAMERA, "up": UP},
        {**ON_DEPTH, "up": [None, *DIRECTIONS], "T_body_camera": MOUNTS},
    ),
    sf.find_obstacles: (
        {"depth_m": DEPTH, "camera": CAMERA},
        {
            **ON_DEPTH,
            "floor": [UP, np.array(UP), sf.Plane(np.eye(3), 1.0), sf.Plane(np.array(UP), NAN)],
            "up": DIRECTIONS,
            "robot_height_m": NUMBERS,
            "seed": SEEDS,
        },
    ),
    alone: ({}, {"radii_m": [-1.0, "a"], "pose_covariance": [0.01]}),
    sf.find_footprints: (
        {"points_m": np.zeros((5, 3))},
        {
            "points_m": ["a", 1.0, RAGGED, EYE, None, np.full((5, 3), HUGE)],
            "sightings": ["a", 1.0, RAGGED, np.ones(4, int), np.ones(5)],
            "sensor_m": ["a", 1.0, RAGGED, EYE],
        },
    ),
    sf.stereo_depth: (
        {"left": GREY, "right": GREY, "camera": CAMERA, "baseline_m": 0.1},
        {
            "left": IMAGES,
            "right": IMAGES,
            "camera": CAMERAS,
            "baseline_m": [*NUMBERS, 0.0, 1e-300, 120.0],
            "least_reliability": [*NUMBERS, 2.0],
            "nearest_m": [*NUMBERS, 0.0],
        },
    ),
    sf.gaze_map: (
        {"waypoint": (1.0, 0.0), "positions": [(1.0, 0.0)], "covariances": [EYE]},
        {
            "waypoint": [None, *POINTS],
            "positions": ["a", 1.0, (1.0, 0.0), [(NAN, 0.0)], [(HUGE, 0.0)], RAGGED],
            "velocities": ["a", 1.0, (1.0, 0.0), RAGGED],
            "covariances": [None, "a", 0.04, [0.04], -EYE[None], RAGGED],
            "pose_covariance": ["a", 0.01, EYE, -np.eye(3)],
            "stale": ["a", 1.0, (1.0,), RAGGED],
            "fresh": [-3, 1.5, "a", None],
            "radii_m": RADII,
            "present": [(0.0, 0.0), sf.GazeCommand(NAN, 0.0)],
            "robot_velocity": POINTS,
            "robot": ROBOTS,
            "step_deg": ["a", 0.0, NAN, None, 1e-3, 10**400],
            "head": [sf.Pose2(), 5],
        },
    ),
    sf.find_path: (
        {"occupancy": np.zeros((9, 9)), "cell_m": 0.1, "start": (0.4, 0.4), "goal": (0.5, 0.5)},
        {
            "occupancy": [
                None,
                "a",
                RAGGED,
                np.zeros((9, 9), int),
                np.zeros(9),
                np.full((9, 9), 5.0),
            ],
            "cell_m": [*NUMBERS, 0.0],
            "start": [None, *POINTS],
            "goal": [None, *POINTS],
            "origin": POINTS,
            "robot": ROBOTS,
            "alpha": ["1", None, -1.0, NAN],
            "form": ["a", 1],
            "smooth": FLAGS,
        },
    ),
    sf.Tracker: (
        {},
        {
            "speed_sigma_mps": [*NUMBERS, 0.0],
            "motion_model": [object()],
            "hits_to_show": ["a", 1.5, 0],
        },
    ),
    updated: (
        {"stamp_s": 0.0, "positions": [(1.0, 0.0)], "covariances": EYE},
        {
            "stamp_s": NUMBERS,
            "positions": ["a", 1.0, (1.0, 0.0), [(NAN, 0.0)], [(HUGE, 0.0)], RAGGED, None],
            "covariances": [None, "a", 1e-2, [1e-2], -EYE, HUGE * EYE, RAGGED],
            "radii_m": [*RADII, 9.0],
            "pose": [
                (0.0, 0.0, 0.0),
                sf.Pose2(),
                sf.Gaussian(np.zeros(2), EYE),
                sf.Gaussian(np.zeros(3), -np.eye(3)),
            ],
        },
    ),
    sf.Pipeline: (
        {"start": sf.Pose2()},
        {
            "config": [5, "no_such_file.toml"],
            "landmarks": [5, [(1, (0.0, 0.0, 0.0), 0.1)], [sf.Landmark(1, (0.0, 0.0), 0.1)]],
            "start": [(0.0, 0.0, 0.0), sf.Pose2("a", 0, 0), sf.Pose2(NAN, 0.0, 0.0)],  # type: ignore[arg-type]
            "start_covariance": ["a", 1e-4, EYE, -np.eye(3)],
            "up_world": DIRECTIONS,
            "calibrated": FLAGS,
        },
    ),
    added: (
        {"depth_m": DEPTH, "camera": CAMERA, "T_body_camera": sf.Pose3((0.0, 0.0, 1.0))},
        {
            "stamp_s": NUMBERS,
            "depth_m": DEPTHS[1:],
            "footstep_due": FLAGS,
            "camera": CAMERAS,
            "scale_per_metre": ON_DEPTH["scale_per_metre"],
            "range_m": DEPTHS[1:],
            "rgb": IMAGES[1:],
            "T_body_camera": MOUNTS,
            "T_world_camera": MOUNTS,
            "step": [(0.1, 0.0, 0.0), sf.Pose2(NAN, 0.0, 0.0), sf.StepOdometry(0.1, 1.0)],  # type: ignore[arg-type]
            "imu": [(0.0, 0.0, 0.0), sf.Imu(np.zeros(3), np.zeros(2))],
        },
    ),
    framed: (
        {"frame": sf.Frame(0.0, odometry=sf.StepOdometry(sf.Pose2(), 1.0))},
        {"frame": [None, 5, DEPTH]},
    ),
    sf.simulate: (
        {},
        {
            "scene": [5],
            "planner": NAMES,
            "gaze": NAMES,
            "body": [5, "a"],
            "seed": SEEDS,
            "seconds": ["a", 0.0, NAN],
            "config": PATHS,
            "settings": [5, ["a"]],
        },
    ),
    sf.process: ({"recording": "no_such_folder"}, OF_A_RECORDING),
    sf.map: ({"recording": "no_such_folder"}, OF_A_RECORDING),
    sf.evaluate: (
        {"run": "no_such_folder"},
        {
            "run": [None, *PATHS],
            "truth": PATHS,
            "surface": PATHS,
            "truth_sigma": ["a", 0.1, (0.1, NAN), None],
        },
    ),
    sf.Run: ({}, {"folder": [None, *PATHS]}),
    sf.Pose3.from_matrix: (
        {},
        {"matrix": [None, "a", RAGGED, np.eye(3), np.zeros((2, 4, 4))]},
    ),
    sf.Camera: (
        {"width": 8, "height": 6, "fx": 10.0, "fy": 10.0, "cx": 3.5, "cy": 2.5},
        {
            "width": ["a", 10.5, None],
            "height": ["a", 10.5, None],
            "fx": ["a", NAN, 0.0, None],
            "fy": ["a", NAN, 0.0, None],
            "cx": ["a", NAN, None],
            "cy": ["a", NAN, None],
            "distortion": ["a", 0.1, None, np.zeros(4), np.zeros((5, 1)), np.full(5, NAN)],
        },
    ),
}
OTHERS = (sf.simulate, sf.process, sf.map, sf.evaluate, sf.Run, sf.Pose3.from_matrix)
"""Without a wrong argument they walk, or there is no recording, or no other argument."""


@pytest.mark.parametrize(
    ("function", "name", "value"),
    [
        pytest.param(function, name, value, id=f"{function.__name__}-{name}-{number}")
        for function, (_, wrong) in CASES.items()
        for name, values in wrong.items()
        for number, value in enumerate(values)
    ],
)
def test_a_wrong_argument_is_refused_by_its_name(function, name, value):
    usual, _ = CASES[function]
    with pytest.raises(sf.InputError, match=name):
        function(**{**usual, name: value})


@pytest.mark.parametrize("function", [f for f in CASES if f not in OTHERS])
def test_the_arguments_beside_the_wrong_one_are_right(function):
    usual, _ = CASES[function]
    function(**usual)


@pytest.mark.parametrize("given", [{"amplitude": np.ones((6, 8, 3))}, {"amplitude": "a"}])
def test_an_amplitude_must_be_an_image(given):
    with pytest.raises(sf.InputError, match="amplitude"):
        added(range_m=DEPTH, camera=CAMERA, T_body_camera=sf.Pose3(), **given)


@pytest.mark.parametrize("units", [255.0, 4000.0])
@pytest.mark.parametrize("range_m", [0.5, 2.0, 4.0])
def test_amplitudes_in_the_units_of_a_sensor_are_refused_with_advice(units, range_m):
    """A grey wall, reflectance .4, by the inverse square law; `units` for white paper at 2 m."""
    view = {"walks": False, "range_m": range_m * DEPTH, "camera": CAMERA}
    amplitude = 0.4 * (2.0 / range_m) ** 2 * DEPTH
    added(amplitude=amplitude, **view)
    with pytest.raises(sf.InputError, match=r"tof: .* divide them by .* white paper 2 m"):
        added(amplitude=units * amplitude, **view)
    raw = RangeView(range_m * DEPTH, units * amplitude, CAMERA)
    with pytest.raises(sf.InputError, match="divide them"):
        sf.Pipeline().add_frame(Frame(0.0, raw))


def test_a_few_mirrors_are_no_other_units():
    amplitude = 0.4 * DEPTH
    amplitude[:2] = 900.0
    seen = added(stamp_s=1.5, walks=False, amplitude=amplitude, range_m=2.0 * DEPTH, camera=CAMERA)
    assert seen.stamp_s == 1.5


def test_the_message_of_a_matrix_says_how_a_pose_is_made_of_it():
    with pytest.raises(sf.InputError, match=r"Pose3.from_matrix\(T\)"):
        sf.find_floor(DEPTH, CAMERA, T_body_camera=np.eye(4))  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [{"step": sf.Pose2()}, {"imu": sf.Imu(np.zeros(3), np.zeros(3))}])
def test_without_a_start_odometry_is_refused(given):
    with pytest.raises(sf.InputError, match=f"{next(iter(given))} needs start"):
        added(walks=False, depth_m=DEPTH, camera=CAMERA, **given)


@pytest.mark.parametrize(
    "given",
    [{"landmarks": [sf.Landmark(1, (0.0, 0.0, 0.0), 0.1)]}, {"start_covariance": np.eye(3)}],
)
def test_without_a_start_landmarks_are_refused(given):
    with pytest.raises(sf.InputError, match=f"{next(iter(given))} needs start"):
        sf.Pipeline(**given)


def test_what_stands_for_numbers_is_taken():
    assert sf.find_footprints([]) == []
    matrix = np.array(
        [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
    )
    assert sf.Pose3.from_matrix(matrix.tolist()) == sf.Pose3.from_matrix(matrix)
    assert len(updated(stamp_s=np.float32(1.0), positions=[], covariances=EYE)) == 0
    assert sf.Tracker(hits_to_show=np.int64(1)).update(0, [(1, 0)], EYE * 1e-4)[0].track == 1


def test_the_distortion_of_a_camera_may_be_an_array():
    given = np.array([-0.1, 0.0, 0.0, 0.0, 0.0])
    camera = sf.Camera(160, 120, 200.0, 200.0, 79.5, 59.5, given)  # type: ignore[arg-type]
    assert camera == sf.Camera(160, 120, 200.0, 200.0, 79.5, 59.5, tuple(given))
    image = np.zeros((120, 160), np.uint8)
    assert not sf.stereo_depth(image, image, camera, 0.06).camera.is_distorted
