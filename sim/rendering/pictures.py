"""Camera images by PyBullet's renderers, over the textured meshes of the scene.

Two renderers with one image geometry: the EGL plugin (Mesa suffices, no graphics card needed), and PyBullet's own
TinyRenderer, three times slower, without requirements. Their pixel centres differ by half a pixel horizontally, and
TinyRenderer's by one and a half vertically; the projection compensates this, so that both have pixel centres at
integers and the optical axis through the image centre, as `Camera.from_view` defines it.

Shading is part of the textures, so both renderers show the same image. PyBullet is loaded on first use, and its output
to the terminal is suppressed.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

from .. import bullet
from ..scene import Scene
from .painting import Painted, paint_scene

_log = logging.getLogger(__name__)

RENDERERS = ("auto", "egl", "tiny")
NEAR_M, FAR_M = 0.05, 12.0
BACKGROUND = (214, 222, 230)  # ours: outside the walls

# TinyRenderer's pixel (x, y) is the ray ((x - w/2)/f, (y + 1 - h/2)/f); EGL's is centred.
_SHIFT_PX = {"egl": (0.0, 0.0), "tiny": (0.5, -0.5)}


def choose_renderer(wanted: str) -> str:
    """Resolve "auto": EGL where it works, else TinyRenderer.

    Raises:
        ConfigError: for an unknown name, or for "egl" where it does not work.
    """
    if wanted not in RENDERERS:
        raise ConfigError(f"renderer={wanted!r} is unknown; choose one of {', '.join(RENDERERS)}")
    if wanted == "tiny":
        return "tiny"
    if _egl_works():
        return "egl"
    if wanted == "egl":
        raise ConfigError(
            "renderer='egl' does not work here; install Mesa (Debian: libegl1 libgl1-mesa-dri) "
            "or use 'tiny'"
        )
    return "tiny"


class Pictures:
    """Renders a scene. Close it: it holds a PyBullet client and a temporary folder."""

    def __init__(self, scene: Scene, renderer: str) -> None:
        self.renderer = choose_renderer(renderer)
        self._folder = tempfile.TemporaryDirectory(prefix="surefoot-")
        still, moving_objects = paint_scene(scene)
        with silenced_output():
            pybullet = bullet.library()
            self._bullet: Any = pybullet
            self._client = pybullet.connect(pybullet.DIRECT)
            self._plugin = -1
            if self.renderer == "egl":
                self._plugin = pybullet.loadPlugin(
                    _egl_file(), "_eglRendererPlugin", physicsClientId=self._client
                )
            for k, painted in enumerate(still):
                self._show(painted, f"still{k}")
            self._moving = [
                self._show(painted, f"moving{k}") for k, painted in enumerate(moving_objects)
            ]

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m."""
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._bullet.resetBasePositionAndOrientation(
                body, [x, y, 0.0], [0.0, 0.0, 0.0, 1.0], physicsClientId=self._client
            )

    def colour(self, camera: Camera, T_world_camera: Pose3) -> UInt8[np.ndarray, "h w 3"]:
        """Image of an ideal camera, red first."""
        return np.ascontiguousarray(self._render(camera, T_world_camera)[0])

    def depth(self, camera: Camera, T_world_camera: Pose3) -> Float32[np.ndarray, "h w"]:
        """Depth along the optical axis from the renderer's depth buffer, m, NaN for the background."""
        buffer = self._render(camera, T_world_camera)[1].astype(np.float64)
        depth = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * buffer)
        depth[buffer >= 1.0 - 1e-6] = np.nan
        return depth.astype(np.float32)

    def close(self) -> None:
        """Close the client and delete the folder; a second call does nothing."""
        if self._client >= 0:
            with silenced_output():
                if self._plugin >= 0:
                    self._bullet.unloadPlugin(self._plugin, physicsClientId=self._client)
                self._bullet.disconnect(physicsClientId=self._client)
            self._client = -1
            self._folder.cleanup()

    def _render(self, camera: Camera, T_world_camera: Pose3) -> tuple[np.ndarray, np.ndarray]:
        bullet, size = self._bullet, (camera.height, camera.width)
        egl = self.renderer == "egl"
        with silenced_output():
            _, _, rgba, depth, _ = bullet.getCameraImage(
                camera.width,
                camera.height,
                _view(T_world_camera),
                _projection(camera, _SHIFT_PX[self.renderer]),
                lightDirection=[0.0, 0.0, 1.0],
                lightColor=[1.0, 1.0, 1.0],
                lightAmbientCoeff=1.0,
                lightDiffuseCoeff=0.0,
                lightSpecularCoeff=0.0,
                shadow=0,
                renderer=bullet.ER_BULLET_HARDWARE_OPENGL if egl else bullet.ER_TINY_RENDERER,
                flags=bullet.ER_NO_SEGMENTATION_MASK,
                physicsClientId=self._client,
            )
        buffer = np.asarray(depth, dtype=np.float32).reshape(size)
        picture = np.array(rgba, dtype=np.uint8).reshape(*size, 4)[..., :3]
        picture[buffer >= 1.0 - 1e-6] = BACKGROUND
        return picture, buffer

    def _show(self, painted: Painted, name: str) -> int:
        """Add a body without mass or collision that shows a textured mesh."""
        folder = Path(self._folder.name)
        mesh, texture = folder / f"{name}.obj", folder / f"{name}.bmp"
        mesh.write_text(painted.wavefront())
        cv2.imwrite(str(texture), painted.texture[..., ::-1])
        bullet, client = self._bullet, self._client
        white, matt = [1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
        shape = bullet.createVisualShape(
            bullet.GEOM_MESH,
            fileName=str(mesh),
            rgbaColor=white,
            specularColor=matt,
            physicsClientId=client,
        )
        body = bullet.createMultiBody(0, -1, shape, physicsClientId=client)
        image = bullet.loadTexture(str(texture), physicsClientId=client)
        bullet.changeVisualShape(
            body,
            -1,
            textureUniqueId=image,
            rgbaColor=white,
            specularColor=matt,
            physicsClientId=client,
        )
        return int(body)


def _view(T_world_camera: Pose3) -> list[float]:
    """OpenGL view matrix, column by column: x right, y up, z backward."""
    matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ T_world_camera.inverse().matrix
    return [float(value) for value in matrix.T.ravel()]


def _projection(camera: Camera, shift_px: tuple[float, float]) -> list[float]:
    """OpenGL projection matrix, column by column, with the renderer's pixel shift compensated."""
    n, f = NEAR_M, FAR_M
    across = 2 * (camera.cx - shift_px[0] + 0.5) / camera.width - 1
    down = 2 * (camera.cy - shift_px[1] + 0.5) / camera.height - 1
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 2] = 2 * camera.fx / camera.width, -across
    matrix[1, 1], matrix[1, 2] = 2 * camera.fy / camera.height, down
    matrix[2, 2], matrix[2, 3] = -(f + n) / (f - n), -2 * f * n / (f - n)
    matrix[3, 2] = -1.0
    return [float(value) for value in matrix.T.ravel()]


def _egl_file() -> str:
    spec = importlib.util.find_spec("eglRenderer")
    return spec.origin if spec is not None and spec.origin else ""


@cache
def _egl_works() -> bool:
    """Try EGL in another process: without a display the plugin terminates its process."""
    if not _egl_file():
        return False
    trial = (
        "import sys, pybullet as b; b.connect(b.DIRECT); "
        "ok = b.loadPlugin(sys.argv[1], '_eglRendererPlugin') >= 0; "
        "ok = ok and len(b.getCameraImage(8, 8, renderer=b.ER_BULLET_HARDWARE_OPENGL)) == 5; "
        "sys.exit(0 if ok else 1)"
    )
    try:
        tried = subprocess.run(
            [sys.executable, "-c", trial, _egl_file()], capture_output=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    if tried.returncode != 0:
        _log.info("the EGL renderer does not work here; using TinyRenderer")
    return tried.returncode == 0


@contextlib.contextmanager
def silenced_output() -> Iterator[None]:
    """Suppress the standard output and error of C++ code."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept: list[tuple[int, int]] = []
    with open(os.devnull, "w") as nowhere:
        try:
            for number in (1, 2):
                with contextlib.suppress(OSError):  # it may be closed
                    kept.append((number, os.dup(number)))
                    os.dup2(nowhere.fileno(), number)
            yield
        finally:
            ctypes.CDLL(None).fflush(None)  # discard buffered output of C as well
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
