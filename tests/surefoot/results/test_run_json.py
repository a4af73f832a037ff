"""The JSON files of a run are checked where they are read."""

from __future__ import annotations

import json
import math

import pytest

from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError
from surefoot.results.run_folder import RunFolder
from surefoot.results.run_json import MOST, Maybe, Some, Values, check

SHAPE = {
    "a": float, "b?": [[int, 2]], "c?": Maybe(str), "d?": Values(bool), "e?": Some((bool, float)), "f?": dict,
}  # fmt: skip


@pytest.mark.parametrize(
    "value",
    [
        {"a": 1},
        {"a": -2.5, "b": [], "c": None, "d": {}, "e": True, "f": {"x": [1]}, "more": 1},
        {"a": 0.0, "b": [[1, 2], [3, 4]], "c": "x", "d": {"k": False}, "e": 3.0},
    ],
)
def test_what_has_the_shape_is_accepted_until_a_value_is_missing(value):
    check(value, SHAPE)
    with pytest.raises(UnreadableError, match="at a not a value"):
        check({name: one for name, one in value.items() if name != "a"}, SHAPE)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([], "its top not an object"),
        ({}, "at a not a value"),
        ({"a": "1"}, "at a not a finite number"),
        ({"a": True}, "at a not a finite number"),
        ({"a": math.nan}, "at a not a finite number"),
        ({"a": math.inf}, "at a not a finite number"),
        ({"a": 2 * MOST}, "at a not a finite number"),
        ({"a": 1, "b": [[1]]}, r"at b\[0\] not a list of 2"),
        ({"a": 1, "b": [[1, 2], [1, 2.0]]}, r"at b\[1\]\[1\] not a whole number"),
        ({"a": 1, "c": 1}, "at c not text"),
        ({"a": 1, "d": {"k": 0}}, "at d.k not true or false"),
        ({"a": 1, "e": "x"}, "at e not a finite number"),
        ({"a": 1, "f": []}, "at f not an object"),
    ],
)
def test_what_has_not_is_refused_with_its_place(value, words):
    with pytest.raises(UnreadableError, match=words):
        check(value, SHAPE)


TRACK = {"stamp": 1.0, "track": 1, "mean": [0.0] * 4, "covariance": [[0.0] * 4] * 4}


def test_a_run_with_a_file_of_another_shape_is_one_error_that_names_it(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    run.write_json("obstacles.json", {"tracks": [TRACK, {**TRACK, "mean": [0.0]}]})
    with pytest.raises(RecordingError, match=r"obstacles.json has at tracks\[1\].mean not a list of 4"):  # fmt: skip
        run.read_json("obstacles.json")


def test_of_a_killed_run_tracks_are_read_up_to_the_first_that_is_none(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    lines = ["", json.dumps(TRACK), json.dumps(TRACK), json.dumps({**TRACK, "track": "x"}), json.dumps(TRACK)]  # fmt: skip
    run.path(".part-obstacles.json").write_text("\n".join(lines))
    assert (run.read_json("obstacles.json") or {})["tracks"] == [TRACK, TRACK]
