"""Values with arrays are immutable; wrong shapes and types are found where shapes are checked."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import (
    ConfigError,
    InputError,
    OutputError,
    RecordingError,
    SurefootError,
)
from perception.primitives.frame import DepthView, Frame, StepOdometry
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.pose import Pose2

shapes_checked = pytest.mark.skipif(
    not os.environ.get("CHECK_SHAPES"), reason="shapes are checked with CHECK_SHAPES=1"
)
CAMERA = Camera(4, 3, 3.0, 3.0, 1.5, 1.0)


@shapes_checked
def test_a_depth_view_of_the_wrong_type_is_refused():
    with pytest.raises(TypeError):
        DepthView(np.zeros((3, 4), dtype=np.float64), CAMERA)


@shapes_checked
def test_a_sighting_of_the_wrong_shape_is_refused():
    with pytest.raises(TypeError):
        Sighting(1, np.zeros(3), np.eye(2))


@pytest.mark.parametrize(
    "value",
    [
        Frame(1.0),
        Pose2(),
        CAMERA,
        StepOdometry(Pose2(), 0.5),
        Landmark(1, (0.0, 0.0, 0.5), 0.16),
    ],
)
def test_values_are_immutable(value):
    name = dataclasses.fields(value)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(value, name, 0)


def test_a_frame_without_sensors_has_a_time():
    frame = Frame(3.5)
    rest = [getattr(frame, f.name) for f in dataclasses.fields(frame) if f.name != "stamp_s"]
    assert frame.stamp_s == 3.5
    assert not any(rest)


def test_one_root_catches_every_error_and_input_errors_differ_from_output_errors():
    for kind in (InputError, ConfigError, RecordingError, OutputError):
        assert issubclass(kind, SurefootError)
    assert issubclass(ConfigError, InputError)
    assert issubclass(RecordingError, InputError)
    assert not issubclass(OutputError, InputError)
