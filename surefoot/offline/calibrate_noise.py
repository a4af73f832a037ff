"""Calibrate the depth sensor of a recording: noise and bend, as settings that every verb takes.

The bend of an RGB-D camera comes from its motion; it is written if flat surfaces are flatter without it. The vergence
of a stereo pair comes from its motion too.

Source: ours; see `perception.floor.depth_calibration`, `perception.odometry.depth_bend` and `vergence` there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from jaxtyping import Float

from perception.depth import points
from perception.depth.distortion import Bend, Distortion, DistortionConfig, stretch
from perception.depth.points import Points
from perception.depth.sources import DepthSources, registered_picture
from perception.depth.time_of_flight import SIGMA_AT_M
from perception.floor.depth_calibration import Calibrator, DepthCalibration
from perception.odometry.depth_bend import BendEstimator, MotionBend
from perception.odometry.vergence import Vergence, VergenceEstimator
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError, OutputError
from perception.primitives.pose import Pose3

from ..config.schema import Config
from ..progress import Say
from ..recordings.recording import Recording

MOST_VIEWS = 60  # ours: views of a recording, evenly spaced
SHAPES = ("scale", "right", "down", "right^2", "right down", "down^2")
LEAST_SIGMA_M = 0.0005  # ours: of a setting
WITHOUT_SURFACES = DepthCalibration((), np.zeros(6), np.eye(6), 0, False)


@dataclass(frozen=True)
class NoiseSettings:
    """Calibration of one sensor.

    Args:
        sensor: "tof", "stereo" or "depth".
        frames, surfaces: Number of views used and of flat surfaces in them.
        calibration: Estimates with their uncertainty, of depth that is straightened by `motion` if there is one.
        motion: The bend that is taken out; None if the motion of the camera does not tell it.
        vergence: The same of a stereo pair.
        settings: Nested tables of a configuration.
        remarks: What the recording did not tell.
    """

    sensor: str
    frames: int
    surfaces: int
    calibration: DepthCalibration
    motion: MotionBend | None
    vergence: Vergence | None
    settings: dict[str, Any]
    remarks: tuple[str, ...]

    def lines(self) -> list[str]:
        """For the terminal, and as comments of the file."""
        found = self.calibration
        rows = [
            f"sensor {self.sensor}: {self.surfaces} flat surfaces in {self.frames} views, "
            f"{found.views} different ones{', related by poses' if found.posed else ''}"
        ]
        rows += [
            f"noise at {one.z:.1f} m: {1e3 * one.sigma:.1f} ± {1e3 * one.error:.1f} mm "
            f"(model so far {1e3 * one.claimed:.1f} mm)"
            for one in found.noise
        ]
        if self.motion is not None:
            sigma = np.sqrt(np.diag(self.motion.covariance))
            rows.append(
                f"bend at the edge of the picture, by {self.motion.pairs} motions of the camera:"
            )
            rows += _listed(
                SHAPES[1:],
                100.0 * self.motion.bend.coefficients,
                100.0 * sigma,
                self.motion.known,
                " %",
            )
        if self.vergence is not None:
            rows.append(
                f"right camera turned outwards by {math.degrees(self.vergence.angle):+.4f} ± "
                f"{math.degrees(self.vergence.sigma):.4f} deg, by {self.vergence.pairs} motions of the pair"
            )
        left = "" if self.motion is None else "what is left of the "
        rows.append(f"{left}bend by flat surfaces, 1 = the published size:")
        rows += _listed(SHAPES, found.bend, found.sigma, found.known)
        rows.append(f"size of the distortion: {found.size:.2f} of the published one")
        return rows + list(self.remarks)

    def content(self) -> dict[str, Any]:
        """For --json."""
        found, motion = self.calibration, self.motion
        return {
            "sensor": self.sensor,
            "frames": self.frames,
            "surfaces": self.surfaces,
            "views": found.views,
            "posed": found.posed,
            "noise": [one._asdict() for one in found.noise],
            "bend": found.bend.tolist(),
            "bend_sigma": found.sigma.tolist(),
            "bend_known": found.known.tolist(),
            "motion_bend": None if motion is None else motion.bend.coefficients.tolist(),
            "motion_bend_sigma": None
            if motion is None
            else np.sqrt(np.diag(motion.covariance)).tolist(),
            "motion_bend_known": None if motion is None else motion.known.tolist(),
            "vergence_deg": None if self.vergence is None else math.degrees(self.vergence.angle),
            "vergence_sigma_deg": None
            if self.vergence is None
            else math.degrees(self.vergence.sigma),
            "size": found.size,
            "settings": self.settings,
            "remarks": list(self.remarks),
        }

    def write(self, path: Path) -> None:
        """Write the settings as TOML.

        Raises:
            OutputError: The file exists or cannot be written.
        """
        comments = "".join(f"# {line}\n" for line in self.lines())
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(comments + tomli_w.dumps(self.settings))
        except FileExistsError as error:
            raise OutputError(f"{path} exists; choose another file with --out") from error
        except OSError as error:
            raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def calibrate(recording: Recording, config: Config, say: Say) -> NoiseSettings:
    """Noise and bend of the depth sensor of a recording; of the one with the most flat surfaces if it has several.

    Args:
        recording: Of a flat floor or a static room.
        config: Depth sources and their noise models so far.
        say: Receives lines of progress.

    Raises:
        InputError: There is no depth, or no surface that is flat and large enough.
    """
    sources = DepthSources(
        config.tof,
        config.structured_light,
        config.stereo,
        config.depth_sources,
        recording.info.own_body,
    )
    views: dict[str, list[_View]] = {}
    moving: dict[str, BendEstimator | VergenceEstimator] = {
        "depth": BendEstimator(DistortionConfig().depth),
        "stereo": VergenceEstimator(DistortionConfig().stereo),
    }
    every = max(1, (recording.info.frames or 1) // MOST_VIEWS)
    for number, frame in enumerate(recording.frames()):
        for sensor, estimator in moving.items():
            depth = None if estimator.is_full else sources.image(frame, sensor)
            if depth is not None:
                estimator.add(depth, registered_picture(frame, sensor))
        if number % every:
            continue
        for sensor, depth in sources.images(frame):
            reach = config.reach.of(sensor, depth)
            cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
            views.setdefault(sensor, []).append(_View(cloud, depth.camera, frame.T_world_camera))
        say(f"frame {number}")
    if not views:
        raise InputError("the recording has no depth images; there is no depth sensor to calibrate")
    flat = {sensor: _flat(sensor, seen, config) for sensor, seen in views.items()}
    sensor = max(flat, key=lambda name: flat[name][1])
    calibrator, surfaces = flat[sensor]
    told = moving[sensor].solve() if sensor in moving else None
    motion, vergence, refused = None, None, ""
    if isinstance(told, Vergence) and told.known:
        vergence = told
        calibrator, surfaces = _flat(sensor, [one.turned(told) for one in views[sensor]], config)
    found = calibrator.solve() if surfaces or vergence is None else WITHOUT_SURFACES
    if isinstance(told, MotionBend) and told.known.any():
        straight = [one.straightened(told.bend) for one in views[sensor]]
        calibrator, count = _flat(sensor, straight, config)
        straightened = calibrator.solve() if count else found
        if straightened.size < found.size:
            found, surfaces, motion = straightened, count, told
        else:
            refused = "bend by the motion of the camera left out: flat surfaces do not confirm it"
    settings, remarks = _settings(sensor, found, motion, vergence, config)
    remarks += (refused,) if refused else ()
    count = len(views[sensor])
    return NoiseSettings(sensor, count, surfaces, found, motion, vergence, settings, remarks)


@dataclass(frozen=True, eq=False)
class _View:
    """Points of one depth image."""

    points: Points
    camera: Camera
    T_world_camera: Pose3 | None

    def straightened(self, bend: Bend) -> _View:
        return self._nearer(stretch(self.camera, bend).ravel()[self.points.pixels])

    def turned(self, vergence: Vergence) -> _View:
        x, _, z = self.points.xyz.T
        share = 1.0 - vergence.share_per_m * z * (1.0 + (x / z) ** 2)
        return self._nearer(np.where(share > 0.0, share, 1.0))

    def _nearer(self, share: Float[np.ndarray, "n"]) -> _View:
        """All points at depths divided by these."""
        moved = replace(self.points, xyz=self.points.xyz / share[:, None])
        return _View(moved, self.camera, self.T_world_camera)


def _flat(sensor: str, views: list[_View], config: Config) -> tuple[Calibrator, int]:
    """The calibrator with the flat surfaces of all views, and their number."""
    rng = np.random.default_rng(config.seed)
    calibrator = Calibrator(DistortionConfig().of(sensor), rng, config.floor)
    return calibrator, sum(calibrator.add(one.points, one.T_world_camera) for one in views)


def _listed(
    names: Sequence[str],
    values: np.ndarray,
    sigmas: np.ndarray,
    known: np.ndarray,
    unit: str = "",
) -> list[str]:
    """Lines of coefficients."""
    return [
        f"  {name:<10} {value:+.2f} ± {sigma:.2f}{unit}" if told else f"  {name:<10} not told"
        for name, value, sigma, told in zip(names, values, sigmas, known, strict=True)
    ]


def _settings(
    sensor: str,
    found: DepthCalibration,
    motion: MotionBend | None,
    vergence: Vergence | None,
    config: Config,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The calibration as tables of a configuration, and what the recording did not tell."""
    remarks = []
    if not found.noise and vergence is None:
        raise InputError(
            "the flat surfaces are too small to tell the noise at any depth; record a bare floor or a wall that "
            "fills a third of the picture"
        )
    published: Distortion = DistortionConfig().of(sensor)
    size = found.size
    scaled = {name: round(size * value, 6) for name, value in vars(published).items()}
    tables: dict[str, Any] = {"floor": {"distortion": {sensor: scaled}}}
    z = np.array([one.z for one in found.noise])
    sigma = np.array([one.sigma for one in found.noise])
    if sensor == "depth":
        model = config.structured_light
        squares = (z - model.start_m) ** 2
        constant, growth, _ = found.growth(squares)
        if math.isnan(growth):
            ratio = float(np.median(sigma / (model.floor_m + model.growth_per_m * squares)))
            constant, growth = ratio * model.floor_m, ratio * model.growth_per_m
            remarks.append(
                f"growth of noise not told: all surfaces are between {z.min():.1f} and {z.max():.1f} m; both "
                "terms are scaled alike. Record them from 0.5 to 3 m"
            )
        tables["structured_light"] = {
            "floor_m": round(max(constant, LEAST_SIGMA_M), 6),
            "growth_per_m": round(growth, 6),
            "start_m": model.start_m,
        }
        bend = model.bend if motion is None else model.bend.and_then(motion.bend)
        if bend != Bend():
            tables["structured_light"]["bend"] = {
                name: round(value, 6) for name, value in vars(bend).items()
            }
    elif sensor == "tof":
        varying = np.maximum(sigma**2 - config.tof.fixed_m**2, LEAST_SIGMA_M**2)
        white = np.sqrt(varying) / (z / SIGMA_AT_M) ** 2
        tables["tof"] = {"sigma_m": round(float(np.median(white)), 6)}
    elif sensor == "stereo":
        turned = 0.0 if vergence is None else math.degrees(vergence.angle)
        tables["stereo"] = {"vergence_deg": round(config.stereo.vergence_deg + turned, 6)}
        if found.noise:
            ratio = float(np.median([one.sigma / one.claimed for one in found.noise]))
            tables["stereo"]["sigma_px"] = round(ratio * config.stereo.sigma_px, 6)
        else:
            remarks.append("noise not told: no flat surface of 25 by 25 degrees was seen")
        if vergence is None:
            remarks.append("vergence not told: the pair did not move far enough, or is too near")
    if not found.known.any():
        remarks.append(
            "bend not told: the surfaces fill too little of the picture, or are not flat; the published size is kept"
        )
    if not found.posed:
        remarks.append(
            "scale and tilt not told: the recording has no poses of one surface from several places"
        )
    return tables, tuple(remarks)
