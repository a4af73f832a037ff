"""The cloud of a run: voxel means, bounded memory, PLY."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.io import _voxel_kernels
from mapping.io.clouds import CloudBuilder, CloudConfig, load_ply, save_ply
from perception.primitives.errors import ConfigError, InputError, OutputError


def twin(frames: list[tuple[np.ndarray, np.ndarray]], voxel_m: float) -> dict:
    """Sums, counts and frames of each voxel by a dictionary, in the order of the first hit."""
    held: dict[tuple[int, ...], list] = {}
    for k, (points, colours) in enumerate(frames):
        for point, colour in zip(points, colours, strict=True):
            key = tuple(np.floor(point * (1 / voxel_m)).astype(int).tolist())
            entry = held.setdefault(key, [np.zeros(3), np.zeros(3), 0, set()])
            entry[0] += point
            entry[1] += colour
            entry[2] += 1
            entry[3].add(k)
    return held


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_each_voxel_holds_the_mean_of_its_points(seed):
    rng = np.random.default_rng(seed)
    frames = [
        (rng.uniform(-0.5, 0.5, (150, 3)), rng.integers(0, 256, (150, 3)).astype(np.uint8))
        for _ in range(3)
    ]
    builder = CloudBuilder(CloudConfig(voxel_m=0.2))
    for points, colours in frames:
        builder.add(points, colours)
    held = twin(frames, 0.2)
    points, colours = builder.cloud()
    np.testing.assert_allclose(points, [e[0] / e[2] for e in held.values()], atol=1e-12)
    np.testing.assert_array_equal(colours, [np.rint(e[1] / e[2]) for e in held.values()])
    np.testing.assert_array_equal(builder.sightings, [len(e[3]) for e in held.values()])


def test_growth_of_the_table_keeps_all_voxels():
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, (60_000, 3))
    builder = CloudBuilder(CloudConfig(voxel_m=0.02))
    builder.add(points[:30_000])
    builder.add(points[30_000:])
    cells = np.floor(points * (1 / 0.02)).astype(int)
    assert len(builder) == len(np.unique(cells, axis=0))
    assert builder.cloud()[1] is None


def test_voxels_double_in_size_at_the_limit_and_keep_the_mean():
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (20_000, 3))
    builder = CloudBuilder(CloudConfig(voxel_m=0.02, most_voxels=3000))
    for part in np.split(points, 4):
        builder.add(part)
    assert len(builder) <= 3000
    assert builder.voxel_m > 0.02
    weights = builder._counts[: len(builder)]
    assert weights.sum() == len(points)
    np.testing.assert_allclose(
        np.average(builder.cloud()[0], axis=0, weights=weights), points.mean(axis=0), atol=1e-12
    )


def thinned_by_numpy(points, sums, counts, calls, last, voxel_m):
    """Sums, counts, calls and last calls of the voxels of a larger size, in the order of their first parts."""
    cells = np.floor(points / voxel_m)
    _, first, group = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    group = np.argsort(np.argsort(first))[group.reshape(-1)]
    size = len(first)
    found = np.zeros((size, sums.shape[1])), np.zeros(size, int), np.zeros(size, int)
    latest = np.full(size, -1)
    np.add.at(found[0], group, sums)
    np.add.at(found[1], group, counts)
    np.maximum.at(found[2], group, calls)
    np.maximum.at(latest, group, last)
    return *found, latest


def test_thinning_in_place_agrees_with_numpy_to_the_last_bit_and_allocates_nothing():
    rng = np.random.default_rng(6)
    builder = CloudBuilder(CloudConfig(voxel_m=0.02, most_voxels=4096), values=2)
    while len(builder) < 4000:
        builder.add(
            rng.normal(0.0, 0.3, (100, 3)),
            rng.integers(0, 256, (100, 3)).astype(np.uint8),
            rng.random((100, 2)),
        )
    used = len(builder)
    arrays = builder._sums, builder._counts, builder._hits, builder._last
    expected = thinned_by_numpy(builder.cloud()[0], *(one[:used].copy() for one in arrays), 0.04)
    assert used < len(builder._keys) == 4096
    builder._used = used
    builder.config = CloudConfig(voxel_m=0.02, most_voxels=used)
    builder._make_room()
    assert builder.voxel_m == 0.04
    assert len(builder) == len(expected[0]) < used
    for mine, numpy, before in zip(
        (builder._sums, builder._counts, builder._hits, builder._last),
        expected,
        arrays,
        strict=True,
    ):
        np.testing.assert_array_equal(mine[: len(builder)], numpy)
        assert mine is before
    again = len(builder)
    builder.add(builder.cloud()[0], None, np.zeros((again, 2)))  # every voxel is found again
    assert len(builder) == again


def test_nan_and_points_out_of_reach_are_ignored():
    builder = CloudBuilder()
    builder.add(np.array([[np.nan, 0, 0], [1e9, 0, 0], [0.5, 0.5, 0.5], [np.inf, 0, 0]]))
    assert len(builder) == 1
    np.testing.assert_array_equal(builder.cloud()[0], [[0.5, 0.5, 0.5]])


def test_bad_input_is_refused_with_its_reason():
    with pytest.raises(ConfigError, match="voxel_m=0"):
        CloudConfig(voxel_m=0.0)
    with pytest.raises(ConfigError, match="most_voxels=1 "):
        CloudConfig(most_voxels=1)


def test_a_cloud_is_written_and_read_back(tmp_path):
    pytest.importorskip("open3d", reason="Open3D cannot be loaded here", exc_type=ImportError)
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (100, 3))
    colours = rng.integers(0, 256, (100, 3)).astype(np.uint8)
    save_ply(tmp_path / "c.ply", points, colours)
    read, tints = load_ply(tmp_path / "c.ply")
    np.testing.assert_allclose(read, points, atol=1e-12)
    np.testing.assert_array_equal(tints, colours)
    save_ply(tmp_path / "c.ply", points)
    assert load_ply(tmp_path / "c.ply")[1] is None
    assert [f.name for f in tmp_path.iterdir()] == ["c.ply"]
    with pytest.raises(OutputError, match="cannot write"):
        save_ply(tmp_path / "none" / "c.ply", points)


HEAD = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
XYZ = b"property float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        (b"not a cloud", "is no PLY"),
        (HEAD.replace(b"binary_little_endian", b"ascii") + XYZ + b"end_header\n0 0 0\n", "ascii"),
        (HEAD + XYZ + b"end_header\n" + bytes(11), "cut off: 1 points"),
        (
            HEAD.replace(b" 1\n", b" 99999999999999999\n") + XYZ + b"end_header\n" + bytes(12),
            "cut off",
        ),
        (HEAD + b"property list uchar int x\nend_header\n", "no number"),
        (HEAD + XYZ[:17] + b"end_header\n" + bytes(12), "holds no points"),
        (b"ply\nelement face 1\nend_header\n", "holds no points"),
        (HEAD + XYZ + b"end_header\n" + bytes(8) + b"\0\0\xc0\x7f", "no points within"),
    ],
)
def test_a_cloud_that_cannot_be_read_is_refused_with_its_reason(tmp_path, content, words):
    path = tmp_path / "a.ply"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        load_ply(path)


def test_further_numbers_are_averaged_per_voxel_and_survive_thinning():
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 1.0, (20_000, 3))
    builder = CloudBuilder(CloudConfig(voxel_m=0.02, most_voxels=3000), values=2)
    for part in np.split(points, 4):
        builder.add(part, None, np.column_stack([part[:, 0], np.full(len(part), 7.0)]))
    assert builder.voxel_m > 0.02
    np.testing.assert_allclose(builder.values[:, 0], builder.cloud()[0][:, 0], atol=1e-12)
    np.testing.assert_allclose(builder.values[:, 1], 7.0, atol=1e-12)


def test_a_wrong_number_of_further_numbers_is_refused():
    with pytest.raises(InputError, match="expected 2 a point"):
        CloudBuilder(values=2).add(np.zeros((3, 3)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_voxels_in_a_row_along_any_axis_do_not_share_a_place_in_the_table(axis):
    steps = np.zeros((1000, 3), np.int64)
    steps[:, axis] = np.arange(1000)
    x, y, z = (steps + _voxel_kernels.REACH).T
    free = np.full(1 << 15, -1, np.int64)
    slots = [
        _voxel_kernels._slot_of(key, free, np.zeros(1, np.int64))
        for key in (x << 42) | (y << 21) | z
    ]
    assert len(set(slots)) > 900
