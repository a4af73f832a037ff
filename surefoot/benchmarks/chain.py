"""The complete chain of a depth camera: floor, odometry and surface map of every image, from memory or from files."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np

from mapping.surface.background import Background
from mapping.surface.tsdf import Tsdf
from perception.depth import points, structured_light
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.odometry.odometry import Odometry
from perception.odometry.pyramid import build
from perception.primitives.frame import Depth, DepthView
from perception.primitives.pose import Pose3

from ..recordings.open import open_recording

Image = tuple[Depth, np.ndarray, Pose3]
"""Depth, colour and true pose."""

View = tuple[DepthView, np.ndarray]
LENGTH = 60  # frames of the recording in files
ROUNDS = 3


def in_memory(given: list[Image]) -> float:
    """Frames per second of processor time, best of three."""
    views = cycle(
        [(DepthView(given[k][0].z, given[k][0].camera), given[k][1]) for k in swing(len(given))]
    )
    one = _chain()
    _run(one, islice(views, 8))
    best = 0.0
    for _ in range(ROUNDS):
        start = time.process_time()
        _run(one, islice(views, 20))
        best = max(best, 20.0 / (time.process_time() - start))
    return best


def from_files(given: list[Image]) -> float:
    """Frames per second of wall time from a folder of PNG files, best of three."""
    with tempfile.TemporaryDirectory(prefix="surefoot-") as folder:
        write(Path(folder), given)
        best = 0.0
        for _ in range(ROUNDS):
            start = time.perf_counter()
            _run(_chain(), _read(Path(folder)))
            best = max(best, LENGTH / (time.perf_counter() - start))
    return best


def write(folder: Path, given: list[Image]) -> None:
    """Write the images, forth and back, as a recording of `LENGTH` frames."""
    camera = given[0][0].camera
    names = ("width", "height", "fx", "fy", "cx", "cy")
    lines = [f"{name} = {getattr(camera, name)}" for name in names]
    (folder / "recording.toml").write_text(
        "\n".join(["[camera]", *lines, "[depth]", "scale_per_metre = 1000.0", "none = [0]", ""])
    )
    for part in ("depth", "colour"):
        (folder / part).mkdir()
    for number, k in enumerate(islice(cycle(swing(len(given))), LENGTH)):
        depth, rgb, _ = given[k]
        millimetres = np.rint(1000.0 * np.nan_to_num(depth.z)).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{number:06d}.png"), millimetres)
        cv2.imwrite(str(folder / "colour" / f"{number:06d}.png"), rgb[..., ::-1])


def swing(count: int) -> list[int]:
    """Indices forth and back without repetition: 0 1 2 1 for three."""
    return [*range(count), *range(count - 2, 0, -1)]


def _read(folder: Path) -> Iterator[View]:
    for frame in open_recording(folder).frames():
        assert frame.depth is not None
        assert frame.colour is not None
        yield frame.depth, frame.colour.rgb


def _chain() -> Callable[[View], None]:
    """A function that processes the next image."""
    odometry, surface = Odometry(), Background(Tsdf())
    rng, prior = np.random.default_rng(0), handheld_prior(None)

    def one(view: View) -> None:
        noisy = structured_light.depth(view[0])
        floor = choose.find(points.from_depth(noisy, 0.3, 5.0, 4), prior, rng, sensor="depth")
        step = odometry.track(build(noisy, view[1], None if floor is None else floor.plane))
        surface.integrate(noisy, step.T_start_camera, view[1])

    return one


def _run(one: Callable[[View], None], views: Iterable[View]) -> None:
    for view in views:
        one(view)
