"""Walks over ground of several levels: depth in closed form, with the errors that joints, steps and sensors make."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapping.ground.config import GroundConfig
from mapping.ground.ground_map import GroundMap
from mapping.ground.surface import Border, Surface
from perception.depth.distortion import Distortion, DistortionConfig
from perception.floor.choose import FloorConfig
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.terrain import segmentation

sys.path.insert(0, str(Path(__file__).parents[2] / "perception/terrain"))

import stair_scenes as scenes

CAMERA = scenes.CAMERA
NOISE_M, EYE_M, SHARE = 0.004, 1.0, 0.1
DISTORTION = Distortion(share=0.002, share_per_m=0.001)
CONFIG = FloorConfig(distortion=DistortionConfig(depth=DISTORTION))
POSE = np.diag([0.005, 0.005, 0.01, *np.radians([1.2, 1.2, 0.5])]) ** 2
STEP = np.diag([0.005, 0.005, math.radians(0.5), 0.004]) ** 2


@dataclass
class Walk:
    """A map, and where the robot truly is."""

    ground: GroundMap
    scene: list[scenes.Rectangle]
    body: Pose2
    height_m: float

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        return self.ground.surfaces

    def level(self, x: float) -> float:
        """Highest level surface at x, relative to where the robot stands; NaN beyond all."""
        at = [
            low + (high - low) * (x - start) / (end - start)
            for (start, low), (end, high), _ in self.scene
            if start <= x < end
        ]
        return max(at) - self.height_m if at else math.nan


def exact(sensor: Distortion | None = None) -> FloorConfig:
    return FloorConfig(distortion=DistortionConfig(depth=sensor or Distortion()))


def regions(scene, T_world_camera, seed=0, config=None):
    """Regions of one image without distortion."""
    depth = scenes.look(scene, T_world_camera, NOISE_M, seed)
    return segmentation.find(depth, config=config or exact(), sensor="depth")


def walk(scene, seed: int, steps: int = 5, step_m: float = 0.12, tilt: float = 0.6) -> Walk:
    """Steps towards +x, an image after each; all errors are drawn from their covariances."""
    rng = np.random.default_rng(seed)
    ground = GroundMap(GroundConfig(lasting_share=SHARE))
    bend, lasting = rng.standard_normal(12), rng.standard_normal(6)
    at = Walk(ground, scene, Pose2(0.0, rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)), 0.0)
    for number in range(steps):
        if number:
            motion = Pose2(step_m, 0.0, rng.normal(0.0, 0.05))
            at.body = at.body @ motion
            rise = at.level(at.body.x)
            at.height_m += rise
            error = np.sqrt(np.diag(STEP)) * rng.standard_normal(4)
            told = Pose2(*(motion.vector + error[:3]))
            ground.move(told, rise + error[3], STEP)
        mounted = Pose3.from_rotation(
            head_rotation(rng.uniform(-0.3, 0.3), tilt), np.array([0.05, 0.0, EYE_M])
        )
        sway = math.sqrt(SHARE) * lasting + math.sqrt(1.0 - SHARE) * rng.standard_normal(6)
        error = np.sqrt(np.diag(POSE)) * sway
        true = Pose3.from_rotation(
            _turned(error[3:]) @ mounted.rotation, mounted.position + error[:3]
        )
        stands = Pose3((at.body.x, at.body.y, at.height_m), at.body.lifted().quat_xyzw)
        depth = _bent(scenes.look(scene, stands @ true, NOISE_M, 1000 * seed + number), bend)
        found = segmentation.find(depth, config=CONFIG, sensor="depth")
        ground.observe(found, mounted, POSE, CAMERA)
    return at


def heights(walks: list[Walk]) -> tuple[float, float]:
    """NEES of heights at points of all surfaces, and the share of points at no true level within 5 cm."""
    squares, wrong = [], []
    for one in walks:
        for surface in one.surfaces:
            points = _within(surface)
            true = np.array([one.level(x) for x in one.body.apply(points)[:, 0]])
            z, sigma = surface.height_at(points)
            error = z - true
            near = np.abs(error) < 0.05  # else beyond an edge, whose place has its own error
            wrong += (~near).tolist()
            squares += ((error / sigma)[near] ** 2).tolist()
    return float(np.mean(squares)), float(np.mean(wrong))


def sides(walks: list[Walk]) -> list[float]:
    """Squared errors, over their variance, of the seen sides that lie across the way."""
    found = []
    rng = np.random.default_rng(0)
    for one in walks:
        edges = np.array([x for start, end, _ in one.scene for x in (start[0], end[0])])
        for surface in one.surfaces:
            ends = np.roll(surface.outline, -1, axis=0)
            for k, (a, b) in enumerate(zip(surface.outline, ends, strict=True)):
                x, y = one.body.rotation @ (b - a)
                if surface.borders[k] == Border.UNSEEN or abs(y) < 0.1 or abs(x) > 0.3 * abs(y):
                    continue
                at = one.body.apply(a + rng.uniform() * (b - a))[0]
                error = np.abs(edges - at).min()
                found.append((error / surface.sigma_m[k]) ** 2)
    return found


def _within(surface: Surface, count: int = 15) -> np.ndarray:
    low, high = surface.outline.min(axis=0), surface.outline.max(axis=0)
    axes = (np.linspace(a, b, count) for a, b in zip(low, high, strict=True))
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return points[surface.contains(points)]


def _turned(w: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(w))
    half = math.sin(angle / 2.0) / angle
    return Pose3(quat_xyzw=(*(half * w).tolist(), math.cos(angle / 2.0))).rotation


def _bent(depth: Depth, coefficients: np.ndarray) -> Depth:
    """The image with the smooth distortion of a sensor."""
    seen = np.isfinite(depth.z)
    rays, z = CAMERA.rays[seen], depth.z[seen].astype(float)
    field = DISTORTION.field(
        rays[:, 0], rays[:, 1], z, depth.sigma[seen].astype(float), float(CAMERA.rays[..., 0].max())
    )
    bent = depth.z.copy()
    bent[seen] = z * (1.0 + field @ coefficients)
    return Depth(bent, depth.sigma, CAMERA)
