"""Files of objects: values come back bit for bit, and no file can run code or name a class that is not ours."""

from __future__ import annotations

import json
import math
import struct
from array import array
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.obstacles._track_kernels import Belief
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.gaussian import Gaussian
from surefoot.config.schema import Config
from surefoot.results import object_file
from surefoot.results.object_file import MAGIC, dumps, loads

KEYS = st.one_of(st.integers(-(2**200), 2**200), st.text(), st.booleans(), st.none())
FLAT = st.one_of(KEYS, st.floats(), st.binary())
VALUES = st.recursive(
    FLAT,
    lambda inner: st.one_of(
        st.lists(inner), st.tuples(inner, inner), st.dictionaries(KEYS, inner), st.sets(KEYS)
    ),
    max_leaves=12,
)
NUMBERS = arrays.arrays(
    st.one_of(arrays.floating_dtypes(), arrays.integer_dtypes(), arrays.boolean_dtypes()),
    arrays.array_shapes(min_dims=0, min_side=0),
)


def alike(a, b):
    """Equal in type and value, NaN and the sign of zero included."""
    if type(a) is not type(b):
        return False
    if isinstance(a, float):
        return struct.pack("d", a) == struct.pack("d", b) or (math.isnan(a) and math.isnan(b))
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, dict):
        return alike(list(a.items()), list(b.items()))
    return a == b


@given(VALUES)
@settings(max_examples=200)
def test_every_value_comes_back(value):
    assert alike(loads(dumps(value)), value)


@given(NUMBERS)
def test_every_array_comes_back(value):
    for one in (value, np.asfortranarray(value), value.T):
        found = loads(dumps(one))
        assert found.dtype == one.dtype
        assert found.shape == one.shape
        assert found.tobytes() == one.tobytes()
        assert found.flags.fnc == one.flags.fnc
        assert found.flags.writeable


def test_other_containers_and_scalars_come_back():
    value = [
        deque([1, 2], maxlen=3),
        array("d", [0.1, 0.2]),
        Path("a/b"),
        np.float32(0.1),
        frozenset({2}),
    ]
    found = loads(dumps(value))
    assert found == value
    assert [type(one) for one in found] == [type(one) for one in value]
    assert found[0].maxlen == 3


def test_a_generator_goes_on_with_the_same_numbers_and_the_same_children():
    rng = np.random.default_rng([3, 4])
    rng.spawn(2)
    rng.random(7)
    found = loads(dumps(rng))
    assert found.random(5).tolist() == rng.random(5).tolist()
    assert found.spawn(1)[0].random() == rng.spawn(1)[0].random()


def test_objects_of_the_project_come_back_and_stay_one_object():
    gaussian = Gaussian(np.arange(3.0), np.eye(3))
    belief = Belief(*map(np.float64, range(len(Belief._fields))))
    first, second, config, named = loads(dumps([gaussian, gaussian, Config(), belief]))
    assert first is second
    assert isinstance(first, Gaussian)
    assert first.mean.tolist() == [0.0, 1.0, 2.0]
    assert config == Config()
    assert type(named) is Belief
    assert named == belief
    ring = []
    ring.append(ring)
    found = loads(dumps(ring))
    assert found[0] is found


def test_given_objects_are_not_stored():
    camera = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
    other = Camera(8, 6, 4.0, 4.0, 3.5, 2.5)
    content = dumps({"camera": camera}, {"it": camera})
    assert b"Camera" not in content
    assert loads(content, {"it": other})["camera"] is other


@dataclass
class NotOfTheProject:
    number: int = 1


@pytest.mark.parametrize(
    "value",
    [NotOfTheProject(), print, np.array([None]), Gaussian, dict.items({}), lambda: 1, 2**300],
    ids=["class", "function", "objects", "type", "view", "lambda", "integer"],
)
def test_what_cannot_be_kept_is_refused(value):
    with pytest.raises(InputError, match="cannot be kept"):
        dumps([value])


def forged(nodes, blobs=(), root=None):
    text = json.dumps({"nodes": nodes, "blobs": list(map(len, blobs)), "root": root or {"node": 0}})
    body = len(text).to_bytes(8, "little") + text.encode() + b"".join(blobs)
    return MAGIC + object_file.hashlib.sha256(body).digest() + body


@pytest.mark.parametrize(
    "nodes",
    [
        [["object", "os:system", {}]],
        [["object", "subprocess:Popen", {}]],
        [["object", "surefoot.results.object_file:Path", {}]],  # imported there, not of the project
        [["object", "surefoot.results.object_file:loads", {}]],  # no class
        [["object", "surefoot.__main__:main", {}]],  # would start the program if it were imported
        [["object", "surefoot.results.object_file:json.JSONDecoder", {}]],
        [["named", "perception.primitives.gaussian:Gaussian", [1]]],
        [["enum", "perception.primitives.gaussian:Gaussian", "__init__"]],
        [["array", "|O", [1], "C", 0]],
        [["array", "<f8", [7], "C", 0]],
        [["run", "import os"]],
        [["list", [{"node": 5}]]],
        [],
        "text",
    ],
)
def test_a_forged_file_is_refused(nodes):
    with pytest.raises(InputError, match=r"it names|content is wrong|holds an array"):
        loads(forged(nodes, [bytes(8)]))


def test_damage_is_told():
    content = dumps({"a": np.arange(50)})
    for cut in (0, 5, len(MAGIC) + 3, len(content) - 1):
        with pytest.raises(InputError):
            loads(content[:cut])
    rng = np.random.default_rng(1)
    for _ in range(200):
        bad = bytearray(content)
        bad[rng.integers(len(bad))] ^= 1 << int(rng.integers(8))
        with pytest.raises(InputError):
            loads(bytes(bad))
