"""PyBullet's renderers: textured meshes in one client, and what a pinhole camera sees of them.

Two renderers with one image geometry: the EGL plugin (Mesa suffices, no graphics card needed), and PyBullet's own
TinyRenderer, three times slower, without requirements. Their pixel centres differ by half a pixel horizontally, and
TinyRenderer's by one and a half vertically; the projection compensates this, so that both have pixel centres at
integers and the optical axis through the image centre, as `Camera.from_view` defines it.

Neither shades: a pixel has the colour of its texture. PyBullet is loaded on first use, and its output to the terminal
is suppressed.
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
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, SurefootError
from perception.primitives.pose import Pose3

from .. import bullet

_log = logging.getLogger(__name__)

RENDERERS = ("auto", "egl", "tiny")
FAR_M = 12.0  # ours: what is farther is background
BEHIND = 1.0 - 1e-6  # value of the depth buffer from which a pixel shows the background

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


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """A mesh with one texture.

    Args:
        vertices: m.
        triangles: Vertex indices.
        uv: Of the vertices; (0, 0) the upper left corner of the texture.
        texture: Red first.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    uv: Float[np.ndarray, "n 2"]
    texture: UInt8[np.ndarray, "h w 3"]

    def wavefront(self) -> str:
        """Text of a Wavefront OBJ file, whose v runs upwards.

        All normals point up, to the light: EGL would darken every other surface, at any coefficient of its light.
        """
        lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in self.vertices]
        lines += [f"vt {u:.7f} {1 - v:.7f}" for u, v in self.uv]
        lines += ["vn 0 0 1"]
        lines += [
            "f " + " ".join(f"{i + 1}/{i + 1}/1" for i in triangle) for triangle in self.triangles
        ]
        return "\n".join(lines) + "\n"


class Renderer:
    """A PyBullet client that renders. Close it: it holds a temporary folder.

    Raises:
        SurefootError: Another one of this process renders by EGL and is open.
    """

    _egl_in_use: ClassVar[bool] = False  # two EGL clients in one process corrupt each other

    def __init__(self, name: str) -> None:
        self.name = choose_renderer(name)
        self._client = self._plugin = -1
        if self.name == "egl" and Renderer._egl_in_use:
            raise SurefootError(
                "renderer='egl' is in use by another open world of this process, and two would corrupt each other's "
                "images; close that world first, or use 'tiny'"
            )
        self._folder = tempfile.TemporaryDirectory(prefix="surefoot-")
        with silenced_output():
            pybullet = bullet.library()
            self._bullet: Any = pybullet
            self._client = bullet.connect(pybullet)
            if self.name == "egl":
                self._plugin = pybullet.loadPlugin(
                    _egl_file(), "_eglRendererPlugin", physicsClientId=self._client
                )
                Renderer._egl_in_use = True

    def show(self, mesh: TexturedMesh) -> int:
        """Add a body without mass or collision at the origin; its identity."""
        folder = Path(self._folder.name)
        number = len(list(folder.iterdir()))
        file, texture = folder / f"{number}.obj", folder / f"{number}.bmp"
        file.write_text(mesh.wavefront())
        cv2.imwrite(str(texture), mesh.texture[..., ::-1])
        pybullet, client = self._bullet, self._client
        white, matt = [1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
        with silenced_output():
            shape = pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                fileName=str(file),
                rgbaColor=white,
                specularColor=matt,
                physicsClientId=client,
            )
            body = pybullet.createMultiBody(0, -1, shape, physicsClientId=client)
            image = pybullet.loadTexture(str(texture), physicsClientId=client)
            pybullet.changeVisualShape(
                body,
                -1,
                textureUniqueId=image,
                rgbaColor=white,
                specularColor=matt,
                physicsClientId=client,
            )
        return int(body)

    def place(self, body: int, x: float, y: float) -> None:
        """Move a body on the floor, m."""
        self._bullet.resetBasePositionAndOrientation(
            body, [x, y, 0.0], [0.0, 0.0, 0.0, 1.0], physicsClientId=self._client
        )

    def pose(self, body: int, T_world_body: Pose3) -> None:
        """Move and turn a body."""
        self._bullet.resetBasePositionAndOrientation(
            body, T_world_body.translation, T_world_body.quat_xyzw, physicsClientId=self._client
        )

    def render(
        self, camera: Camera, T_world_camera: Pose3, near_m: float
    ) -> tuple[UInt8[np.ndarray, "h w 4"], Float32[np.ndarray, "h w"]]:
        """Image of an ideal camera, red first, and the depth buffer, see `depth_m`.

        Args:
            camera: Without distortion.
            T_world_camera: Its pose.
            near_m: What is nearer is not drawn.
        """
        pybullet, size = self._bullet, (camera.height, camera.width)
        egl = self.name == "egl"
        with silenced_output():
            _, _, rgba, depth, _ = pybullet.getCameraImage(
                camera.width,
                camera.height,
                _view(T_world_camera),
                _projection(camera, _SHIFT_PX[self.name], near_m),
                lightDirection=[0.0, 0.0, 1.0],
                lightColor=[1.0, 1.0, 1.0],
                lightAmbientCoeff=1.0,
                lightDiffuseCoeff=0.0,
                lightSpecularCoeff=0.0,
                shadow=0,
                renderer=pybullet.ER_BULLET_HARDWARE_OPENGL if egl else pybullet.ER_TINY_RENDERER,
                flags=pybullet.ER_NO_SEGMENTATION_MASK,
                physicsClientId=self._client,
            )
        picture = np.asarray(rgba, dtype=np.uint8).reshape(*size, 4)
        return picture, np.asarray(depth, dtype=np.float32).reshape(size)

    def close(self) -> None:
        """Close the client and delete the folder; a second call does nothing."""
        if self._client < 0:
            return
        with silenced_output():
            if self._plugin >= 0:
                self._bullet.unloadPlugin(self._plugin, physicsClientId=self._client)
                Renderer._egl_in_use = False
            self._bullet.disconnect(physicsClientId=self._client)
        self._client = -1
        self._folder.cleanup()


def depth_m(buffer: Float32[np.ndarray, "h w"], near_m: float) -> Float[np.ndarray, "h w"]:
    """Depth along the optical axis from a depth buffer, m, NaN for the background.

    EGL's buffer has 16 bits: at a depth z its steps are z^2 / (2^16 near_m).
    """
    depth = FAR_M * near_m / (FAR_M - (FAR_M - near_m) * buffer.astype(np.float64))
    depth[buffer >= BEHIND] = np.nan
    return depth


def _view(T_world_camera: Pose3) -> list[float]:
    """OpenGL view matrix, column by column: x right, y up, z backward."""
    matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ T_world_camera.inverse().matrix
    return [float(value) for value in matrix.T.ravel()]


def _projection(camera: Camera, shift_px: tuple[float, float], near_m: float) -> list[float]:
    """OpenGL projection matrix, column by column, with the renderer's pixel shift compensated."""
    n, f = near_m, FAR_M
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
