"""Two cameras side by side in front of a known scene."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.depth.depth_to_colour import colours_of_depth
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3

DEPTH = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
COLOUR = Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
BESIDE = Pose3((-0.06, 0.0, 0.0))  # the colour camera is 6 cm to the right


def wall_and_box() -> tuple[np.ndarray, np.ndarray]:
    """Depth of a wall at 2 m and a box at 1 m in front of it, and the colour camera's picture of both."""
    z = np.full((120, 160), 2.0, np.float32)
    z[40:80, 60:100] = 1.0
    edge = (np.array([60, 100]) - 0.5 - DEPTH.cx) / DEPTH.fx * 1.0 - 0.06
    left, right = np.rint(edge * COLOUR.fx + COLOUR.cx).astype(int)
    rows = np.rint((np.array([40, 80]) - 0.5 - DEPTH.cy) / DEPTH.fy * COLOUR.fy + COLOUR.cy)
    rgb = np.zeros((240, 320, 3), np.uint8)
    rgb[...] = (0, 0, 200)
    rgb[int(rows[0]) : int(rows[1]), left:right] = (200, 0, 0)
    return z, rgb


def test_every_depth_pixel_gets_the_colour_of_its_own_object():
    z, rgb = wall_and_box()
    colours = colours_of_depth(z, DEPTH, rgb, COLOUR, BESIDE)
    box = np.zeros(z.shape, bool)
    box[42:78, 62:98] = True
    assert (colours[box] == (200, 0, 0)).all()
    red = (colours[z == 2.0] == (200, 0, 0)).all(axis=1)
    assert red.mean() < 0.01  # one pixel at the corners


def test_pixels_occluded_from_the_colour_camera_get_no_colour():
    z, rgb = wall_and_box()
    colours = colours_of_depth(z, DEPTH, rgb, COLOUR, BESIDE)
    hidden = np.zeros(z.shape, bool)
    hidden[45:75, 57:60] = True  # the box moves by 8.4 px, the wall by 4.2
    assert (colours[hidden] == 0).all()


def test_a_colour_camera_in_the_same_place_gives_the_same_image():
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (120, 160, 3), dtype=np.uint8)
    z = np.full((120, 160), 2.0, np.float32)
    colours = colours_of_depth(z, DEPTH, rgb, DEPTH, Pose3())
    np.testing.assert_array_equal(colours, rgb)


def test_an_image_of_another_size_is_refused():
    z, rgb = wall_and_box()
    with pytest.raises(InputError, match=r"colour image is \(240, 320\)"):
        colours_of_depth(z, DEPTH, rgb, DEPTH, BESIDE)


def test_edges_of_depth_and_colour_agree_on_a_real_unregistered_pair(recordings):
    """Where depth jumps, colour changes more often than elsewhere; without the calibration less so."""
    folder = recordings / "cape_tunnel"
    z, rgb, depth_camera, colour_camera, T = read_tunnel(folder)
    colours = colours_of_depth(z, depth_camera, rgb, colour_camera, T)
    naive = cv2.resize(rgb, z.shape[::-1])

    def agreement(colour: np.ndarray) -> float:
        grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
        steep = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
        filled = np.nan_to_num(z)
        near = cv2.erode(filled, np.ones((3, 3))) > 0
        jump = (cv2.dilate(filled, np.ones((3, 3))) - filled > 0.15) & near
        usable = near & (colour.sum(-1) > 0)
        return float(steep[jump & usable].mean() / steep[usable].mean())

    assert agreement(colours) > 1.1 * agreement(naive)


def read_tunnel(folder: Path) -> tuple[np.ndarray, np.ndarray, Camera, Camera, Pose3]:
    """The set's only frame, with both cameras and the pose of one in the other."""
    file = cv2.FileStorage(str(folder / "calib_params.xml"), cv2.FILE_STORAGE_READ)
    cameras = []
    for name in ("IR", "RGB"):
        K = file.getNode(f"{name}_intrinsic_params").mat()
        bent = tuple(float(v) for v in file.getNode(f"{name}_distortion_coefficients").mat()[0])
        cameras.append(Camera(640, 480, K[0, 0], K[1, 1], K[0, 2], K[1, 2], bent))
    shift = file.getNode("Translation").mat()[:, 0] / 1000.0
    T = Pose3.from_rotation(file.getNode("Rotation").mat(), shift)
    units = cv2.imread(str(folder / "depth_0.png"), cv2.IMREAD_UNCHANGED)
    z = np.where(units > 0, units / 1000.0, np.nan).astype(np.float32)
    rgb = cv2.imread(str(folder / "rgb_0.png"), cv2.IMREAD_COLOR_RGB)
    return z, rgb, cameras[0], cameras[1], T


def test_depth_beside_the_view_of_a_lens_that_folds_gets_no_colour():
    wide = Camera.from_view(160, 144, np.radians(120), np.radians(120))
    folding = Camera(320, 240, 250.0, 250.0, 159.5, 119.5, (-0.30, 0.0, 0.0, 0.0, 0.0))
    rgb = np.full((240, 320, 3), 200, np.uint8)
    colours = colours_of_depth(np.full((144, 160), 2.0, np.float32), wide, rgb, folding, Pose3())
    x, y = wide.slopes
    radius = np.hypot(x, y)
    pixels = 250.0 * np.stack([x + 0 * y, y + 0 * x], -1) * (1 - 0.3 * radius**2)[..., None]
    shown = (radius < np.sqrt(1 / 0.9)) & (np.abs(pixels) < (160, 120)).all(axis=-1)
    assert 1000 < shown.sum() < 5000
    np.testing.assert_array_equal((colours > 0).all(axis=-1), shown)
