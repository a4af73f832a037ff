"""Depth images of floats, as TIFF and as arrays of NumPy: the metres that were written, or the frame is skipped."""

import io
import re

import cv2
import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording

METRES = np.linspace(0.5, 4.0, 12 * 16).reshape(12, 16) + 1e-4  # no whole millimetres
NO_DEPTH = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e10, 1e30)  # 1e10: the background of Blender


def saved(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def tiff(image):
    return cv2.imencode(".tiff", image)[1].tobytes()


def rewritten(folder, suffix, content):
    """The three depth images, replaced by files with this content."""
    for image in (folder / "depth").iterdir():
        image.with_suffix(suffix).write_bytes(content)
        image.unlink()


def scaled(folder, per_metre):
    text = (folder / "recording.toml").read_text()
    (folder / "recording.toml").write_text(text.replace("= 1000", f"= {per_metre}"))


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".tif", lambda z: tiff(z.astype(np.float32))),
        (".tiff", tiff),
        (".npy", lambda z: saved(z.astype(np.float32))),
        (".npy", saved),
        (".npy", lambda z: saved(z.astype(">f4"))),
        (".npy", lambda z: saved(np.asfortranarray(z))),
        (".npy", lambda z: saved(z[..., None])),
    ],
)
@pytest.mark.parametrize("per_metre", [1, 1000])
def test_floats_are_the_metres_that_were_written(plain, suffix, write, per_metre):
    truth = METRES.copy()
    truth[3, :7] = NO_DEPTH
    rewritten(plain, suffix, write(truth * per_metre))
    scaled(plain, per_metre)
    truth[3, :7] = np.nan
    frames = list(open_recording(plain).frames())
    assert len(frames) == 3
    for frame in frames:
        assert frame.depth.depth.dtype == np.float32
        assert frame.colour is not None
        np.testing.assert_allclose(frame.depth.depth, truth, rtol=2e-7)


def test_arrays_of_16_bits_are_units_as_in_a_png(plain):
    before = [frame.depth.depth for frame in open_recording(plain).frames()]
    for image in (plain / "depth").iterdir():
        np.save(image.with_suffix(".npy"), cv2.imread(str(image), cv2.IMREAD_UNCHANGED))
        image.unlink()
    after = [frame.depth.depth for frame in open_recording(plain).frames()]
    np.testing.assert_array_equal(after, before)


def test_layouts_of_others_are_read_too(redwood, tum):
    for folder in (redwood, tum):
        rewritten(folder, ".npy", saved(METRES * (1000 if folder is redwood else 5000)))
        for frame in open_recording(folder).frames():
            np.testing.assert_allclose(frame.depth.depth, METRES, rtol=2e-7)
            assert frame.T_world_camera is not None


def test_arrays_beside_images_are_no_further_frames(plain):
    for image in list((plain / "depth").iterdir()):
        np.save(image.with_suffix(".npy"), np.ones((12, 16)))
    assert len(list(open_recording(plain).frames())) == 3


def test_floats_at_the_scale_of_millimetres_are_asked_about(plain):
    rewritten(plain, ".npy", saved(METRES))
    with pytest.raises(RecordingError, match=r"nearer than 0.00225 m .* 1 for metres, 1000 for"):
        list(open_recording(plain).frames())


def header(shape, kind="<f4", version=1):
    """The head of an .npy file, written by hand after NEP 1."""
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY" + bytes([version, 0]) + len(text).to_bytes(2, "little") + text


WHOLE = saved(METRES)
BAD = [
    (".tif", tiff(np.ones((12, 16, 3), np.float32)), "3 channels of float32; .*TIFF or .npy of float32"),
    (".tif", tiff(np.ones((12, 16), np.int32)), "1 channel of int32"),
    (".tif", tiff(np.ones((6, 8), np.float32)), "8x6 px; 16x12 px was expected"),
    (".tif", tiff(np.full((12, 16), np.nan, np.float32)), "no valid pixel: no value is positive and below 1000 m"),
    (".tif", tiff(METRES)[:-40], "cannot be decoded"),
    (".npy", b"", "an empty file"),
    (".npy", b"no array", "cannot be decoded"),
    (".npy", WHOLE[:5], "cannot be decoded"),
    (".npy", WHOLE[:40], "is damaged, or no .npy"),
    (".npy", WHOLE[:-8], r"holds 1528 bytes of numbers; its header says 1536, of shape \(12, 16\)"),
    (".npy", WHOLE + b"\0", "holds 1537 bytes"),
    (".npy", header((12, 16)), "holds 0 bytes of numbers; its header says 768"),
    (".npy", header((10**9, 10**9)), "its header says 4000000000000000000"),
    (".npy", header((-12, -16)) + bytes(768), "holds 768 bytes of numbers; its header says 768"),
    (".npy", header((12, 16), version=9) + bytes(768), "is damaged, or no .npy"),
    (".npy", header((12, 16), "|V0"), "1 channel of "),
    (".npy", saved(np.full((12, 16), None)), "holds Python objects"),
    (".npy", saved(np.ones((12, 16), np.float16)), "1 channel of float16"),
    (".npy", saved(np.ones((12, 16), complex)), "1 channel of complex128"),
    (".npy", saved(np.ones((12, 16), bool)), "1 channel of bool"),
    (".npy", saved(np.full((12, 16), "far")), "1 channel of "),
    (".npy", saved(np.ones((3, 12, 16))), "16 channels of float64"),
    (".npy", saved(np.ones((12, 16, 0))), "0 channels of float64"),
    (".npy", saved(np.ones(192)), r"an array of shape \(192,\); \(height, width\) was expected"),
    (".npy", saved(np.ones((1, 12, 16, 1))), "an array of shape"),
    (".npy", saved(np.ones((0, 16))), "16x0 px; 16x12 px was expected"),
    (".npy", saved(np.zeros((12, 16))), "no valid pixel: no value is positive and below 1000 m"),
    (".npy", saved(np.full((12, 16), 1e300)), "no valid pixel"),
]  # fmt: skip


@pytest.mark.parametrize(("suffix", "content", "words"), BAD)
def test_a_damaged_depth_image_costs_its_frame(plain, suffix, content, words):
    good = saved(METRES) if suffix == ".npy" else tiff(METRES)
    rewritten(plain, suffix, good)
    scaled(plain, 1)
    (plain / "depth" / f"1{suffix}").write_bytes(content)
    recording = open_recording(plain)
    assert [frame.stamp_s for frame in recording.frames()] == [0.0, pytest.approx(0.2)]
    (skipped,) = recording.skipped
    assert skipped.name == f"1{suffix}"
    assert re.search(words, skipped.reason), skipped.reason


@pytest.mark.parametrize("encoding", ["rotated", "kinect-disparity"])
def test_coded_depth_is_whole_numbers(plain, encoding):
    rewritten(plain, ".npy", saved(METRES))
    text = (plain / "recording.toml").read_text()
    (plain / "recording.toml").write_text(f'{text}encoding = "{encoding}"\n')
    with pytest.raises(RecordingError, match="1 channel of float64; one channel of uint16 was"):
        list(open_recording(plain).frames())
