"""Pictures that show nothing, or nothing new, are noticed and not used."""

from __future__ import annotations

import numpy as np
import pytest

from perception.monitoring.pictures import PictureWatch, cut
from perception.monitoring.status import SLOW, STAND, Doubt
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, Frame, RangeView

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


def seen(rng: np.random.Generator, blind: int = 0) -> RangeView:
    """A noisy range picture, without its first columns."""
    range_m = (2.0 + 0.01 * rng.standard_normal((48, 64))).astype(np.float32)
    range_m[:, :blind] = np.nan
    return RangeView(range_m, np.ones((48, 64), np.float32), CAMERA)


def words(doubts: list[Doubt]) -> list[str]:
    return [one.words for one in doubts]


def test_noisy_pictures_pass_as_they_are():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    for number in range(20):
        frame = Frame(0.3 * number, tof=seen(rng))
        after, doubts = watch.check(frame)
        assert after is frame
        assert doubts == []


def test_a_repeated_picture_is_used_once_and_the_second_repeat_is_said():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    for number in range(5):
        watch.check(Frame(0.3 * number - 1.5, tof=seen(rng)))
    frozen = seen(rng)
    said = []
    for number in range(4):
        after, doubts = watch.check(Frame(0.3 * number, tof=frozen))
        assert (after.tof is None) == (number > 0)
        said.append(words(doubts))
    assert said == [[], [], ["tof frozen"], ["tof frozen"]]
    after, doubts = watch.check(Frame(1.2, tof=seen(rng)))
    assert after.tof is not None
    assert doubts == []


def test_a_camera_without_noise_may_see_the_same_floor_again():
    watch = PictureWatch()
    floor = seen(np.random.default_rng(1))
    for number in range(20):
        after, doubts = watch.check(Frame(0.3 * number, tof=floor))
        assert after.tof is floor
        assert doubts == []


def test_without_anything_to_see_the_robot_is_asked_to_stand():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    watch.check(Frame(0.0, tof=seen(rng)))
    for number in range(1, 10):
        after, doubts = watch.check(Frame(0.3 * number, tof=seen(rng, blind=64)))
        assert after.tof is None
        assert "tof empty" in words(doubts)
        assert (Doubt("no pictures", STAND) in doubts) == (number > 5)


def test_a_camera_with_another_that_sees_does_not_stop_the_robot():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    dark = ColourView(np.zeros((48, 64, 3), np.uint8), CAMERA)
    for number in range(10):
        _, doubts = watch.check(Frame(0.3 * number, tof=seen(rng), colour=dark))
        assert words(doubts) == ["colour empty"]


def test_a_half_blind_picture_becomes_that_of_a_narrower_camera():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    view = seen(rng, blind=32)
    after, doubts = watch.check(Frame(0.0, tof=view))
    assert doubts == [Doubt("tof half blind", SLOW)]
    assert after.tof.range_m.shape == (48, 32)
    np.testing.assert_array_equal(after.tof.range_m, view.range_m[:, 32:])
    assert after.tof.amplitude.shape == (48, 32)
    point = np.array([[0.3, 0.1, 2.0]])
    whole, half = CAMERA.project(point)[0], after.tof.camera.project(point)[0]
    np.testing.assert_allclose(half, whole - [32, 0])


@pytest.mark.parametrize("columns", [slice(0, 5), slice(59, 64), slice(31, 33)])
def test_a_picture_with_a_strip_of_content_keeps_it_and_its_directions(columns):
    watch, view = PictureWatch(), seen(np.random.default_rng(1))
    view.range_m[:, : columns.start] = np.nan
    view.range_m[:, columns.stop :] = np.nan
    after, doubts = watch.check(Frame(0.0, tof=view))
    assert doubts == [Doubt("tof half blind", SLOW)]
    found = np.flatnonzero(np.isfinite(after.tof.range_m).any(axis=0))
    assert len(found) == columns.stop - columns.start
    kept = after.tof.range_m[:, found[0] : found[-1] + 1]
    np.testing.assert_array_equal(kept, view.range_m[:, columns])
    moved = view.camera.cx - after.tof.camera.cx
    assert found[0] + moved == columns.start
    assert after.tof.camera.fx == view.camera.fx


def test_a_few_blind_columns_are_no_fault():
    watch, rng = PictureWatch(), np.random.default_rng(1)
    frame = Frame(0.0, tof=seen(rng, blind=15))
    after, doubts = watch.check(frame)
    assert after is frame
    assert doubts == []


def test_cutting_nothing_changes_nothing():
    view = seen(np.random.default_rng(1))
    same = cut(view, 0, 64)
    assert same.camera == view.camera
    np.testing.assert_array_equal(same.range_m, view.range_m)
