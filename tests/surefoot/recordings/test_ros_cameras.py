"""Cameras of the images in a bag: raw ones have K and D, rectified ones P; unknown lenses are refused."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from surefoot.batch.job import Job
from surefoot.batch.work import do
from surefoot.recordings.open import open_recording
from surefoot.recordings.ros_messages import is_rectified


def _beside(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


bags = _beside("bags")
WIDTH, HEIGHT = bags.WIDTH, bags.HEIGHT
BOTH_ROS = ("ros1", "ros2")
K = np.array([[30.0, 0, 15.2], [0, 31.0, 11.9], [0, 0, 1]])
P = np.array([[26.0, 0, 16.1, 0], [0, 27.5, 11.3, 0], [0, 0, 1, 0]])
PLUMB_BOB = (-0.28, 0.09, 0.001, -0.0015, -0.01)
RATIONAL = (4.7247, 3.2092, 5.88e-6, 1.238e-4, 0.1706, 5.0559, 4.7758, 0.8865)  # an Azure Kinect
FISHEYE = (-0.02, 0.003, -0.004, 0.001)
POINTS = np.random.default_rng(5).uniform((-0.4, -0.3, 0.9), (0.4, 0.3, 1.6), (50, 3))


def lens(model, d, p=P):
    """CameraInfo of the driver."""
    return {"model": model, "d": d, "k": K.ravel(), "p": np.ravel(p)}


def write(path, kind, depth, info, colour=None, colour_info=None, picture=None):
    """Three depth images, and colour images of the same frame if a topic is given."""
    bag = bags.Bag(path, kind)
    for i in range(3):
        stamp = 1.0 + 0.1 * i
        bag.write(info_of(depth), bag.info(stamp, "camera", **info), stamp)
        bag.write(depth, depth_message(bag, depth, i, stamp), stamp)
        if colour is not None:
            bag.write(info_of(colour), bag.info(stamp, "camera", **colour_info), stamp)
            shown = bags.colour(i) if picture is None else picture
            bag.write(colour, bag.image(stamp, "camera", shown, "rgb8"), stamp)
    return bag.close()


def info_of(topic):
    return "/".join(topic.split("/")[:3]) + "/camera_info"


def depth_message(bag, topic, i, stamp):
    if topic.endswith("compressedDepth"):
        data = bags.compressed_depth(bags.depth_mm(i))
        return bag.compressed(stamp, "camera", data, "16UC1; compressedDepth png")
    return bag.image(stamp, "camera", bags.depth_mm(i), "16UC1")


def camera_of(path):
    return next(iter(open_recording(path).frames())).depth.camera


def seen_by_opencv(d):
    pixels, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, np.array(d))
    return pixels.reshape(-1, 2)


@pytest.mark.parametrize("kind", BOTH_ROS)
@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", PLUMB_BOB),
        ("plumb_bob", PLUMB_BOB[:4]),
        ("", PLUMB_BOB),
        ("rational_polynomial", RATIONAL),
        ("rational_polynomial", (*PLUMB_BOB, 0.0, 0.0, 0.0)),
        (
            "plumb_bob",
            RATIONAL,
        ),  # Orbbec's driver; image_geometry goes by the number of coefficients
        ("plumb_bob", (*RATIONAL, 0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_raw_image_has_the_distortion_of_opencv(tmp_path, kind, model, d):
    camera = camera_of(write(tmp_path / "walk", kind, "/cam/depth/image_raw", lens(model, d)))
    pixels = seen_by_opencv(d)
    assert np.abs(pixels - seen_by_opencv(np.zeros(5))).max() > 0.5  # the lens distorts visibly
    np.testing.assert_allclose(camera.project(POINTS), pixels, atol=1e-9)
    np.testing.assert_allclose(camera.back_project(pixels, POINTS[:, 2]), POINTS, atol=1e-9)


def test_a_rational_lens_with_zero_denominator_has_five_coefficients(tmp_path):
    info = lens("rational_polynomial", (*PLUMB_BOB, 0.0, 0.0, 0.0))
    assert (
        camera_of(write(tmp_path / "walk", "ros2", "/cam/depth/image", info)).distortion
        == PLUMB_BOB
    )


@pytest.mark.parametrize("kind", BOTH_ROS)
@pytest.mark.parametrize(
    "topic",
    [
        "/cam/depth/image_rect",
        "/cam/depth/image_rect_raw",
        "/cam/depth/image_rect/compressedDepth",
        "/cam/depth/sw_registered/image_rect",
    ],
)
def test_a_rectified_image_is_not_undistorted_again(tmp_path, undistort, kind, topic):
    """OpenCV rectifies the distorted image; P alone gives the points back."""
    camera = camera_of(write(tmp_path / "walk", kind, topic, lens("plumb_bob", PLUMB_BOB)))
    raw = seen_by_opencv(PLUMB_BOB).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    rectified = undistort(raw, K, np.array(PLUMB_BOB), np.eye(3), P, stop)
    assert camera.distortion == (0.0,) * 5
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (26.0, 27.5, 16.1, 11.3)
    back = camera.back_project(rectified.reshape(-1, 2), POINTS[:, 2])
    np.testing.assert_allclose(back, POINTS, atol=1e-6)


@pytest.mark.parametrize("kind", bags.KINDS)
def test_a_rectified_image_without_p_has_k_and_no_lens(tmp_path, kind):
    info = lens("equidistant", FISHEYE, np.zeros(12))
    camera = camera_of(write(tmp_path / "walk", kind, "/cam/depth/image_rect_raw", info))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30.0, 31.0, 15.2, 11.9)
    assert not camera.is_distorted


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/cam/depth/image_rect", True),
        ("/cam/depth/image_rect_raw", True),
        ("/cam/rgb/image_rect_color/compressed", True),
        ("/cam/image_rectified", True),
        ("/cam/rect_image", True),
        ("/cam/imageRect", True),
        ("image_rect", True),
        ("/cam/depth/image_raw", False),
        ("/cam/left_rect/image", False),
        ("/cam/image_rect_color/other", False),
        ("/cam/image_direct", False),
        ("/cam/image_unrectified", False),
        ("compressed", False),
    ],
)
def test_the_last_part_of_a_topic_name_marks_rectified_images(topic, rectified):
    assert is_rectified(topic) is rectified


@pytest.mark.parametrize("kind", BOTH_ROS)
@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("equidistant", FISHEYE),
        ("fisheye", FISHEYE),
        ("kannala_brandt", FISHEYE),
        ("none_of_these", PLUMB_BOB),
        ("rational_polynomial", (*RATIONAL, 0.001, 0.0, 0.0, 0.0)),  # a thin prism
        ("rational_polynomial", RATIONAL[:7]),
        ("equidistant", (np.nan,) * 4),
    ],
)
def test_an_unknown_lens_is_refused_with_advice(tmp_path, kind, model, d):
    bag = write(tmp_path / "walk", kind, "/cam/depth/image_raw", lens(model, d))
    info = f"topic /cam/depth/camera_info of the images /cam/depth/image_raw.*'{model}'.*image_proc"
    with pytest.raises(RecordingError, match=info):
        open_recording(bag)


@pytest.mark.parametrize("f", [0.8366, 1e-3, 1e9])
def test_a_focal_length_that_is_not_in_pixels_is_refused(tmp_path, f):
    k = [f, 0, 15.5, 0, f, 11.5, 0, 0, 1]
    bag = write(tmp_path / "walk", "ros2", "/cam/depth/image", {"k": k})
    words = rf"camera_info.*fx={f:g} px for an image 32 px wide.*multiply"
    with pytest.raises(RecordingError, match=words.replace("+", r"\+")):
        open_recording(bag)


def test_nonfinite_coefficients_are_refused(tmp_path):
    bag = write(tmp_path / "walk", "ros2", "/cam/depth/image", lens("plumb_bob", (np.nan,) * 5))
    with pytest.raises(RecordingError, match=r"/cam/depth/image.*nan.*5 finite numbers"):
        open_recording(bag)


@pytest.mark.parametrize("model", ["equidistant", "fisheye", "none_of_these", "plumb_bob", ""])
@pytest.mark.parametrize("count", [0, 8])
def test_a_lens_without_coefficients_has_no_distortion(tmp_path, model, count):
    info = lens(model, np.zeros(count))
    camera = camera_of(write(tmp_path / "walk", "ros1", "/cam/depth/image_raw", info))
    assert camera.distortion == (0.0,) * 5
    assert (camera.fx, camera.cy) == (30.0, 11.9)


def test_an_unknown_lens_of_the_colour_camera_is_refused_by_its_topic(tmp_path):
    bag = write(
        tmp_path / "walk", "ros2", "/cam/depth/image_rect", lens("plumb_bob", PLUMB_BOB),
        "/cam/rgb/image_raw", lens("fisheye", FISHEYE),
    )  # fmt: skip
    with pytest.raises(RecordingError, match=r"/cam/rgb/camera_info of the images /cam/rgb/image"):
        open_recording(bag)


def test_a_refused_lens_fails_its_own_recording_of_a_batch_only(tmp_path):
    bag = write(tmp_path / "walk.x", "ros1", "/cam/depth/image", lens("equidistant", FISHEYE))
    answer = do(Job("walk", "process", str(bag), str(tmp_path / "out")))
    assert answer["status"] == "failed"
    assert answer["reason"].startswith(str(bag))
    assert "'equidistant'" in answer["reason"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("topic", ["image_raw", "image_rect"])
def test_depth_registered_to_colour_keeps_its_pixels(tmp_path, topic):
    """Both raw or both rectified: one camera, colours untouched."""
    info = lens("plumb_bob", PLUMB_BOB)
    bag = write(
        tmp_path / "walk", "ros2", f"/cam/depth_registered/{topic}", info, f"/cam/rgb/{topic}", info
    )
    frame = next(iter(open_recording(bag).frames()))
    assert frame.colour.camera == frame.depth.camera
    assert frame.depth.camera.is_distorted == (topic == "image_raw")
    np.testing.assert_array_equal(frame.colour.rgb, bags.colour(0))


@pytest.mark.parametrize(
    ("model", "d"), [("plumb_bob", PLUMB_BOB), ("rational_polynomial", RATIONAL)]
)
def test_raw_colours_of_a_rectified_depth_image_are_undistorted(tmp_path, undistort, model, d):
    """A scene whose red and green increase with the slope of the ray, distorted by OpenCV."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    pixels = np.stack([u, v], -1).reshape(-1, 1, 2)
    slopes = undistort(pixels, K, np.array(d), None, None, stop).reshape(HEIGHT, WIDTH, 2)

    def scene(x, y):
        return np.rint(np.stack([120 + 140 * x, 120 + 140 * y, 0 * x], -1)).astype(np.uint8)

    bag = write(
        tmp_path / "walk", "ros2", "/cam/depth_registered/image_rect", lens(model, d),
        "/cam/rgb/image_raw", lens(model, d), scene(slopes[..., 0], slopes[..., 1]),
    )  # fmt: skip
    frame = next(iter(open_recording(bag).frames()))
    expected = scene((u - P[0, 2]) / P[0, 0], (v - P[1, 2]) / P[1, 1])
    inside = frame.colour.rgb[..., 0] > 0
    assert frame.colour.camera == frame.depth.camera
    assert inside[6:-6, 8:-8].all()
    off = np.abs(frame.colour.rgb.astype(int) - expected)[6:-6, 8:-8]
    assert off.max() <= 2
    raw = np.abs(scene(slopes[..., 0], slopes[..., 1]).astype(int) - expected)[6:-6, 8:-8]
    assert raw.max() > 4  # what the colours were off before


def test_rectified_images_of_a_camera_are_preferred(tmp_path):
    """The raw images have a fisheye lens, which is not supported."""
    bag = bags.Bag(tmp_path / "walk", "ros2")
    for i in range(5):
        stamp = 1.0 + 0.1 * i
        info = lens("equidistant", FISHEYE)
        bag.write("/cam/depth/camera_info", bag.info(stamp, "camera", **info), stamp)
        for name in ("image_raw", "image_rect")[: 1 if i == 0 else 2]:
            message = bag.image(stamp, "camera", bags.depth_mm(i), "16UC1")
            bag.write(f"/cam/depth/{name}", message, stamp)
    recording = open_recording(bag.close())
    assert recording.info.frames == 4
    assert next(iter(recording.frames())).depth.camera.fx == 26.0
