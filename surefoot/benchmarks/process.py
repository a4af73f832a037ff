"""A recording of depth and colour at 640x480: odometry and surface map against Open3D, and the complete chain.

The images are five of Redwood's living room if available, else a synthetic room: two walls and a floor, seen by a
moving camera. The time of ours includes the image pyramid; the images of Open3D are converted beforehand.
"""

from __future__ import annotations

import time
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np

from mapping.surface.tsdf import Tsdf
from mapping.surface.tsdf_config import TsdfConfig
from mapping.surface.tsdf_open3d import Open3dMap
from perception.depth import points, structured_light
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.odometry.odometry import Odometry
from perception.odometry.pyramid import build
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, DepthView
from perception.primitives.pose import Pose3

from ..experiments.support import real_data
from ..recordings.open import open_recording
from .benchmark import Benchmark, Comparison, race

Image = tuple[Depth, np.ndarray, Pose3]


def images() -> list[Image]:
    """Depth, colour and true pose."""
    try:
        recording = open_recording(real_data.folder("redwood_livingroom"))
    except InputError:
        return synthetic()
    found = []
    for frame in recording.frames():
        assert frame.depth is not None
        assert frame.colour is not None
        assert frame.T_world_camera is not None
        depth = structured_light.depth(frame.depth)
        found.append((depth, frame.colour.rgb, frame.T_world_camera))
    return found


def synthetic() -> list[Image]:
    """Five views of a corner with a floor, from exact planes with noise."""
    camera = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
    rng = np.random.default_rng(0)
    planes = np.array([[0.0, 0.0, 1.0, 3.0], [1.0, 0.0, 0.2, 1.6], [0.0, 1.0, 0.1, 0.9]])
    found = []
    for number in range(5):
        pose = Pose3((0.02 * number, 0.0, 0.01 * number), (0.0, 0.0, 0.0, 1.0))
        approach = camera.rays @ planes[:, :3].T
        distance = planes[:, 3] - planes[:, :3] @ pose.position
        with np.errstate(divide="ignore"):
            z = np.where(approach > 1e-6, distance / approach, np.inf).min(axis=-1)
        points_world = pose.apply(camera.rays * z[..., None])
        light = 128 + 60 * np.sin(7 * points_world[..., 0]) * np.sin(
            9 * points_world[..., 1] + 5 * points_world[..., 2]
        )
        rgb = np.repeat(light[..., None], 3, axis=2).astype(np.uint8)
        noisy = (z + rng.normal(0.0, 0.002, z.shape) * z**2).astype(np.float32)
        found.append((structured_light.depth(DepthView(noisy, camera)), rgb, pose))
    return found


def run() -> Comparison:
    """Odometry, surface map, and the complete chain."""
    given = images()
    odometry, drift = _race_odometry(given)
    surface = _race_tsdf(given)
    chain = _chain(given)
    times = {**odometry, **surface, "chain_ms": 1e3 / chain}
    ratios = {
        "frames_per_second": chain,
        "ratio_odometry_open3d": odometry["odometry_open3d_ms"] / odometry["odometry_ours_ms"],
        "ratio_tsdf_open3d": surface["tsdf_open3d_ms"] / surface["tsdf_ours_ms"],
    }
    return Comparison(times, ratios, drift)


def _race_odometry(given: list[Image]) -> tuple[dict[str, float], dict[str, float]]:
    import open3d

    core: Any = open3d.core
    engine: Any = open3d.t.pipelines.odometry
    geometry: Any = open3d.t.geometry
    pairs = [
        geometry.RGBDImage(
            geometry.Image(np.ascontiguousarray(rgb.astype(np.float32) / 255.0)),
            geometry.Image(np.ascontiguousarray(np.nan_to_num(depth.z)[..., None])),
        )
        for depth, rgb, _ in given
    ]
    K = core.Tensor(given[0][0].camera.matrix)
    ours = Odometry()
    turn, peers_turn = cycle(swing(len(given))), cycle(swing(len(given)))
    last = [next(peers_turn)]
    errors: dict[str, list[float]] = {"odometry_ours_m": [], "odometry_open3d_m": []}

    def step_ours() -> None:
        number = next(turn)
        ours.track(build(given[number][0], given[number][1]))

    def step_open3d() -> None:
        number = next(peers_turn)
        found = engine.rgbd_odometry_multi_scale(
            pairs[number],
            pairs[last[0]],
            K,
            core.Tensor(np.eye(4)),
            1.0,
            6.0,
            [engine.OdometryConvergenceCriteria(n) for n in (10, 5, 3)],
            engine.Method.Hybrid,
            engine.OdometryLossParams(),
        )
        true = given[last[0]][2].inverse() @ given[number][2]
        moved = found.transformation.numpy()[:3, 3]
        errors["odometry_open3d_m"].append(float(np.linalg.norm(moved - true.position)))
        last[0] = number

    taken = race({"odometry_ours_ms": step_ours, "odometry_open3d_ms": step_open3d}, 24)
    fresh, before = Odometry(), Pose3()
    for number, (depth, rgb, pose) in enumerate(given):
        here = fresh.track(build(depth, rgb)).T_start_camera
        if number:
            true = given[number - 1][2].inverse() @ pose
            moved = (before.inverse() @ here).position
            errors["odometry_ours_m"].append(float(np.linalg.norm(moved - true.position)))
        before = here
    return taken, {name: float(np.mean(values)) for name, values in errors.items()}


def swing(count: int) -> list[int]:
    """Indices forth and back without repetition: 0 1 2 1 for three."""
    return [*range(count), *range(count - 2, 0, -1)]


def _race_tsdf(given: list[Image]) -> dict[str, float]:
    config = TsdfConfig(voxel_m=0.02)
    ours, peer = Tsdf(config), Open3dMap(config)
    candidates = {}
    for name, surface in (("tsdf_ours_ms", ours), ("tsdf_open3d_ms", peer)):
        turn = cycle(given)

        def fuse(surface: Tsdf | Open3dMap, turn: Any) -> None:
            depth, rgb, pose = next(turn)
            surface.integrate(depth, pose, rgb)

        candidates[name] = partial(fuse, surface, turn)
    return race(candidates, 20)


def _chain(given: list[Image]) -> float:
    """Frames per second of floor, odometry and surface together; processor time, best of three."""
    odometry, surface = Odometry(), Tsdf()
    rng = np.random.default_rng(0)
    turn = cycle(swing(len(given)))
    prior = handheld_prior(None)

    def one() -> None:
        depth, rgb, _ = given[next(turn)]
        noisy = structured_light.depth(DepthView(depth.z, depth.camera))
        floor = choose.find(points.from_depth(noisy, 0.3, 5.0, 4), prior, rng, sensor="depth")
        step = odometry.track(build(noisy, rgb, None if floor is None else floor.plane))
        surface.integrate(noisy, step.T_start_camera, rgb)

    for _ in range(8):
        one()
    best = 0.0
    for _ in range(3):
        start = time.process_time()
        for _ in range(20):
            one()
        best = max(best, 20.0 / (time.process_time() - start))
    return best


BENCHMARK = Benchmark(
    "process",
    "A depth recording at 640x480: odometry, surface map, complete chain",
    run,
    {"frames_per_second": 30.0, "ratio_odometry_open3d": 3.0, "ratio_tsdf_open3d": 2.0},
)
