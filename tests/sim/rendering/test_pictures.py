"""Rendering: both renderers agree with ray casting, and tags are detectable."""

import ctypes
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.renderer import Renderer, TexturedMesh, choose_renderer
from sim.rendering.textures import KINDS, paint
from sim.scenes import catalogue
from sim.world import World


@pytest.fixture(scope="module", params=["egl", "tiny"])
def world(request):
    if request.param == "egl" and choose_renderer("auto") != "egl":
        pytest.skip("the EGL renderer does not work on this machine")
    with World(catalogue.load("boxes", 1), request.param) as opened:
        yield opened


def pose(x, y, yaw, tilt):
    head = Pose3.from_rotation(head_rotation(0.0, tilt), np.array([0.03, 0.0, 0.39]))
    return Pose2(x, y, yaw).lifted() @ head


CAMERAS = [
    Camera.from_view(320, 240, math.radians(60), math.radians(46.8)),
    Camera.from_view(200, 200, math.radians(90), math.radians(90)),
]


@pytest.mark.parametrize("camera", CAMERAS, ids=["60deg", "square"])
def test_rendered_depth_agrees_with_ray_casting(world, camera):
    T = pose(0.7, 1.3, 0.15, 0.35)
    depth = world.rendered_depth(camera, T)
    rays = camera.rays.reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    unit = (rays / length[:, None] @ T.rotation.T).astype(np.float32)
    along = (world.rays.cast(T.position, unit).distance_m / length).reshape(depth.shape)
    error = np.abs(depth - along)
    near = np.isfinite(error) & (along < 2.5)
    assert near.mean() > 0.5
    assert np.median(error[near]) < 1e-3
    assert np.percentile(error[near], 95) < 1e-3
    # an offset of half a pixel would exceed the tolerance
    shifted = np.abs(np.roll(depth, 1, axis=0) - along)[near]
    assert np.median(shifted) > 5 * np.median(error[near])


@pytest.mark.parametrize("distance", [0.7, 1.5, 2.5])
def test_tags_are_detected_at_their_positions(world, distance):
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), cv2.aruco.DetectorParameters()
    )
    camera = Camera.from_view(720, 720, math.radians(90), math.radians(90))
    x0, y0, x1, y1 = world.scene.extent
    plates = {t.name: t.parts[0] for t in world.scene.static_objects if t.name.startswith("tag")}
    tried = found = 0
    for landmark in world.scene.landmarks[:8]:
        yaw = plates[f"tag {landmark.identity}"].yaw_rad
        x = landmark.position[0] + distance * math.cos(yaw)
        y = landmark.position[1] + distance * math.sin(yaw)
        if not (x0 + 0.2 < x < x1 - 0.2 and y0 + 0.2 < y < y1 - 0.2):
            continue
        T = pose(x, y, yaw + math.pi + 0.1, 0.1)
        ahead = np.array(landmark.position) - T.position
        reach = float(np.linalg.norm(ahead))
        met = world.rays.cast(T.position, (ahead / reach)[None].astype(np.float32)).distance_m[0]
        if abs(met - reach) > 0.01:
            continue  # occluded
        tried += 1
        grey = cv2.cvtColor(world.picture(camera, T), cv2.COLOR_RGB2GRAY)
        corners, ids, _ = detector.detectMarkers(grey)
        seen = {} if ids is None else dict(zip(np.ravel(ids).tolist(), corners, strict=True))
        if landmark.identity in seen:
            found += 1
            centre = np.asarray(seen[landmark.identity]).reshape(4, 2).mean(axis=0)
            expected = camera.project(T.inverse().apply(np.array([landmark.position])))[0]
            assert np.linalg.norm(centre - expected) < 2.0
    assert tried >= 1
    assert found == tried


def test_nothing_is_written_to_the_terminal(capfd):
    with World(catalogue.load("corridor", 0), "tiny") as world:
        world.picture(CAMERAS[1], pose(0.6, 0.8, 0.0, 0.2))
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_an_unknown_renderer_is_refused():
    with pytest.raises(ConfigError, match="renderer='opengl'"):
        World(catalogue.load("empty_room", 0), "opengl")


def test_plain_material_has_no_texture():
    image = paint("plain/grey", (1.0, 1.0), 0.004, np.random.default_rng(0))
    assert image.reshape(-1, 3).std(axis=0).max() == 0.0


@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"plain"}))
def test_materials_are_aperiodic(kind):
    rng = np.random.default_rng(0)
    image = cv2.cvtColor(paint(f"{kind}/grey", (1.0, 1.0), 0.004, rng), cv2.COLOR_RGB2GRAY)
    patch = image[100:132, 60:92]
    assert patch.std() > 2.0
    match = cv2.matchTemplate(image, patch, cv2.TM_CCOEFF_NORMED)
    match[90:111, 50:71] = -1.0
    assert match[100, :].max() < 0.9  # the stereo match along the row is unique


def test_a_closed_renderer_keeps_none_of_its_meshes():
    """PyBullet keeps every mesh file that it has loaded, unless it is told not to."""
    side = 100
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) / side
    corner = (x + side * y)[:-1, :-1].reshape(-1, 1)
    halves = np.array([[0, 1, side], [1, side + 1, side]])
    triangles = (corner[:, None] + halves).reshape(-1, 3)
    texture = np.full((8, 8, 3), 200, np.uint8)
    mesh = TexturedMesh(vertices, triangles, vertices[:, :2], texture)

    def held_mb() -> float:
        renderer = Renderer("tiny")
        renderer.show(mesh)
        renderer.close()
        ctypes.CDLL(None).malloc_trim(0)
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

    held = [held_mb() for _ in range(8)]
    assert held[-1] - held[1] < 3.0
