"""Stereo on real pairs: floors of three stereo cameras, and the share of wrong pixels on a pair with ground truth.

EuRoC's raw pairs are rectified here; the floor of a camera at rest is compared with the accelerometer, that of a
handheld camera with motion capture. The floor of the rectified 3IT pair is compared with the value by SGBM in the
description of the set, since there is no truth. Motorcycle has dense truth: our accepted pixels are compared with
StereoBM at the same coverage, set by its uniqueness ratio.

Source: ours; data sets EuRoC V1_01, RTAB-Map 3IT, Middlebury 2014.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Float, Float32

from perception.depth import stereo
from perception.depth.points import from_depth
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.primitives.camera import Camera
from perception.primitives.frame import Frame, StereoView
from perception.primitives.plane import Plane
from perception.primitives.pose import CAMERA_IN_BODY_AXES

from ...recordings.euroc import open_euroc
from ...recordings.stereo_calibration import read_rectified_pair
from ..seed_003.stereo_range import roc_area
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target, combined

REACH_M = (0.2, 4.0)  # seed 003: range of reliable depth
LAB_HEIGHT_M, LAB_PITCH_DEG = 1.11, 3.7  # 3IT: by SGBM, from the description of the set
MOTORCYCLE = Camera(741, 500, 994.978, 994.978, 311.193, 254.877)  # by the description of the set
MOTORCYCLE_BASELINE_M = 0.193001
WRONG_PX = 2.0
BM_BLOCK_PX = 15
UNIQUENESS = (0, 5, 10, 15, 20, 25, 30, 40, 60)


def floor_of(view: StereoView, up_camera: Float[np.ndarray, "3"] | None) -> choose.Floor | None:
    """Detect the floor as the pipeline does, from the pixels that stereo accepts."""
    points = from_depth(stereo.depth(view), *REACH_M)
    rng = np.random.default_rng(0)
    return choose.find(points, handheld_prior(up_camera), rng, sensor="stereo")


def euroc(part: str, say: Say) -> tuple[dict[str, float], list[str]]:
    """All pairs of one part; the figures are those of the worst pair, inf if no floor was detected."""
    folder = real_data.folder("euroc_v101_stereo")
    recording = open_euroc(folder / part)
    known = real_data.floors(folder / "floor.csv")
    names = sorted(int(path.stem) for path in (folder / part / "cam0").glob("*.png"))
    to_rectified = recording.rig.T_left_rectified.inverse()
    rows, angles, heights = [], [], []
    for name, frame in zip(names, recording.frames(), strict=True):
        say(f"EuRoC {part} {name}")
        assert frame.stereo is not None, "the reader gives pairs"
        true = known[str(name)].moved(to_rectified)
        found = floor_of(frame.stereo, _up(frame))
        angle, height = _errors(None if found is None else found.plane, true)
        angles.append(angle)
        heights.append(abs(height))
        rows.append(f"euroc {part:<7} {name}  {angle:5.2f} deg {height:+6.0f} mm")
    figures = {f"euroc_{part}_deg": max(angles), f"euroc_{part}_mm": max(heights)}
    return figures, rows


def _up(frame: Frame) -> Float[np.ndarray, "3"] | None:
    """Vertical in the camera frame, from the given pose, else from the accelerometer."""
    if frame.T_world_camera is not None:
        return frame.T_world_camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    if frame.imu is not None:
        return CAMERA_IN_BODY_AXES.T @ frame.imu.specific_force
    return None


def _errors(found: Plane | None, true: Plane) -> tuple[float, float]:
    if found is None:
        return math.inf, math.inf
    return math.degrees(found.angle_to(true)), 1e3 * (found.offset_m - true.offset_m)


def laboratory(say: Say) -> tuple[dict[str, float], list[str]]:
    """The floor of the 3IT pair, with the prior of a handheld camera alone."""
    say("3IT laboratory")
    folder = real_data.folder("rtabmap_3it")
    camera, baseline = read_rectified_pair(
        folder / "stereo_left.yaml", folder / "stereo_right.yaml"
    )
    left, right = (_grey(str(folder / f"stereo_50_{side}.jpg")) for side in ("left", "right"))
    points = from_depth(stereo.depth(StereoView(left, right, baseline, camera)), 0.2, 6.0)
    found = choose.find(points, handheld_prior(None), np.random.default_rng(0), sensor="stereo")
    if found is None:
        figures = {"rtabmap_floor_found": 0.0}
        return figures, ["rtabmap 3it    no floor"]
    pitch = math.degrees(math.asin(-float(found.plane.normal[2])))
    figures = {
        "rtabmap_floor_found": 1.0,
        "rtabmap_floor_deg": abs(pitch - LAB_PITCH_DEG),
        "rtabmap_floor_mm": 1e3 * abs(found.plane.offset_m - LAB_HEIGHT_M),
        "rtabmap_floor_share": found.share,
    }
    row = f"rtabmap 3it    {found.plane.offset_m:.3f} m, {pitch:.2f} deg down, {found.share:.0%} of points"
    return figures, [row]


def motorcycle(say: Say) -> tuple[dict[str, float], list[str]]:
    """Share of wrong pixels among the accepted ones, compared with StereoBM with its own filters."""
    say("Middlebury motorcycle")
    folder = real_data.folder("middlebury_motorcycle")
    left, right = (_grey(str(folder / f"motorcycle_{side}.png")) for side in ("left", "right"))
    with np.load(folder / "motorcycle_disp.npz") as file:
        true = file["arr_0"].astype(np.float32)
    view = StereoView(left, right, MOTORCYCLE_BASELINE_M, MOTORCYCLE)
    found = stereo.disparity(view)
    known = np.isfinite(true)
    there = known & np.isfinite(found.disparity_px)
    error = np.abs(found.disparity_px - true)
    accepted = there & (found.reliability >= stereo.StereoConfig().least_reliability)
    coverage = float(accepted.sum() / known.sum())
    bad = float(np.mean(error[accepted] > WRONG_PX))
    theirs = _stereobm(view, true, coverage)
    area = roc_area(found.reliability[there].astype(np.float64), error[there] > 1.0)
    figures = {
        "motorcycle_bad2_ratio": bad / theirs,
        "motorcycle_bad2_pct": 100.0 * bad,
        "motorcycle_coverage_pct": 100.0 * coverage,
        "motorcycle_auc": area,
    }
    row = (
        f"motorcycle     {bad:.2%} of {coverage:.0%} off by more than {WRONG_PX:.0f} px, "
        f"StereoBM {theirs:.2%}; reliability against 1 px: {area:.3f}"
    )
    return figures, [row]


def _stereobm(view: StereoView, true: Float32[np.ndarray, "h w"], coverage: float) -> float:
    """Share of wrong pixels of StereoBM at that coverage, interpolated over its uniqueness ratio."""
    steps = stereo.searched(view, stereo.StereoConfig())
    padded = [
        cv2.copyMakeBorder(image, 0, 0, steps, 0, cv2.BORDER_REPLICATE)
        for image in (view.left, view.right)
    ]
    known = np.isfinite(true)
    shares, faults = [], []
    for uniqueness in UNIQUENESS:
        blocks = cv2.StereoBM.create(steps, BM_BLOCK_PX)
        blocks.setUniquenessRatio(uniqueness)
        disparity = blocks.compute(*padded)[:, steps:].astype(np.float32) / np.float32(16.0)
        given = known & (disparity >= 0.0)
        shares.append(float(given.sum() / known.sum()))
        faults.append(float(np.mean(np.abs(disparity - true)[given] > WRONG_PX)))
    return float(np.interp(coverage, shares[::-1], faults[::-1]))


def _grey(path: str) -> np.ndarray:
    return np.asarray(cv2.imread(path, cv2.IMREAD_GRAYSCALE), np.uint8)


def run(seeds: int, say: Say) -> Outcome:
    """Half a minute; independent of the seeds."""
    return combined(euroc("static", say), euroc("room", say), laboratory(say), motorcycle(say))


EXPERIMENT = Experiment(
    id="real-stereo",
    title="Stereo on real pairs: floors of three cameras, wrong pixels against StereoBM",
    run=run,
    targets={
        "euroc_static_deg": Target("<=", 1.0),
        "euroc_static_mm": Target("<=", 20.0),
        "euroc_room_deg": Target("<=", 2.5),
        "euroc_room_mm": Target("<=", 35.0),
        "rtabmap_floor_found": Target(">=", 1.0),
        "motorcycle_bad2_ratio": Target("<=", 0.5),
    },
    seeds=1,
)
