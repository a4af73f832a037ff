"""What somebody else wrote is read within limits, and whatever is wrong with it is one kind of error."""

from __future__ import annotations

import gzip
import os
import struct
import zlib

import cv2
import numpy as np
import pytest

from perception.primitives import safe_input
from perception.primitives.safe_input import MissingError, UnreadableError


def test_only_regular_files_are_read(tmp_path):
    file = tmp_path / "a.txt"
    file.write_bytes(b"abc")
    assert safe_input.data(file) == b"abc"
    link = tmp_path / "link"
    link.symlink_to(file)
    assert safe_input.data(link) == b"abc"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (tmp_path, pipe, tmp_path.__class__("/dev/zero")):
        with pytest.raises(UnreadableError, match="is not a file"):
            safe_input.data(path)
        with pytest.raises(UnreadableError, match="is not a file"):
            safe_input.head(path, 1)
    assert safe_input.head(file, 2) == b"ab"
    with pytest.raises(MissingError, match="No such file"):
        safe_input.data(tmp_path / "none")
    with pytest.raises(UnreadableError, match="impossible name"):
        safe_input.data(tmp_path / "a\0b")
    with pytest.raises(UnreadableError, match="3 bytes; 2 are the most"):
        safe_input.data(file, 2)


def test_text_may_be_zipped_but_not_without_end(tmp_path, monkeypatch):
    file = tmp_path / "a.csv.gz"
    file.write_bytes(gzip.compress(b"1,2\n" * 1000))
    assert safe_input.text(file) == "1,2\n" * 1000
    monkeypatch.setattr(safe_input, "MOST_TEXT_BYTES", 2000)
    with pytest.raises(UnreadableError, match="more than the limit of 2000 bytes"):
        safe_input.text(file)
    file.write_bytes(gzip.compress(os.urandom(500))[:-20])
    with pytest.raises(UnreadableError, match="cut off"):
        safe_input.text(file)
    file.write_bytes(b"plain")
    with pytest.raises(UnreadableError, match="not gzip"):
        safe_input.text(file)
    plain = tmp_path / "a.txt"
    plain.write_bytes(b"\xff\xfe")
    with pytest.raises(UnreadableError, match="not text in UTF-8"):
        safe_input.text(plain)


NESTED = "[" * 100_000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (f"a = {NESTED}", "nested too deeply"),
        ("a = " + "9" * 5000, "not valid TOML: Exceeds the limit"),
        ("a = " + "9" * 400, "more than 18 digits"),
        (f"a = [{{b = -{'9' * 19}}}]", "more than 18 digits"),
        ("a = ", "not valid TOML"),
    ],
)
def test_toml_beyond_the_limits_is_refused(content, message):
    with pytest.raises(UnreadableError, match=message):
        safe_input.toml(content)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (NESTED, "nested too deeply"),
        ("9" * 5000, "not valid JSON: Exceeds the limit"),
        ("[1, {" + f'"a": {"9" * 30}' + "}]", "more than 18 digits"),
        ("{", "not valid JSON"),
        (b"\xff", "not valid JSON"),
    ],
)
def test_json_beyond_the_limits_is_refused(content, message):
    with pytest.raises(UnreadableError, match=message):
        safe_input.json(content)


def test_ordinary_toml_and_json_are_read():
    assert safe_input.toml("a = [1, {b = 2.5}]") == {"a": [1, {"b": 2.5}]}
    assert safe_input.json('{"a": [1, true, null, 2.5]}') == {"a": [1, True, None, 2.5]}
    most = int("9" * 18)
    assert safe_input.json(f"[{most}, {-most}]") == [most, -most]
    assert safe_input.whole(str(most)) == most


@pytest.mark.parametrize("word", ["²", "٣", "", "-1", "1.0", "9" * 19, " 1"])
def test_only_plain_digits_are_whole_numbers(word):
    assert safe_input.whole(word) is None
    assert safe_input.whole("0042") == 42


def chunk(name, content):
    return (
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
    )


def test_the_size_of_a_picture_is_looked_at_before_its_pixels():
    header = struct.pack(">IIBBBBB", 32_000, 32_000, 16, 0, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(999)))
    with pytest.raises(UnreadableError, match="32000x32000 px"):
        safe_input.picture(bomb, cv2.IMREAD_UNCHANGED)
    for ending in (".png", ".jpg"):
        content = cv2.imencode(ending, np.zeros((30, 50, 3), np.uint8))[1].tobytes()
        assert safe_input.picture_size(content) == (50, 30)
        assert safe_input.picture(content, cv2.IMREAD_COLOR).shape == (30, 50, 3)
        with pytest.raises(UnreadableError, match="cannot be decoded"):
            safe_input.picture(content[:20], cv2.IMREAD_COLOR)
    with pytest.raises(UnreadableError, match="cannot be decoded"):
        safe_input.picture(b"", cv2.IMREAD_COLOR)


def tiff_header(order, big, kind, width, height):
    """The first directory of a TIFF, after TIFF 6.0 and BigTIFF, without pixels."""
    offset, count, value = ("Q", "Q", "Q") if big else ("I", "H", "I")
    size = {"B": 1, "H": 2, "I": 4, "Q": 8}
    code = {"H": 3, "I": 4, "Q": 16}[kind]
    start = struct.pack(order + "HHH", 43, 8, 0) if big else struct.pack(order + "H", 42)
    place = 16 if big else 8
    entries = b"".join(
        struct.pack(order + "HH" + value + kind, tag, code, 1, number).ljust(
            4 + 2 * size[value], b"\0"
        )
        for tag, number in ((254, 0), (256, width), (257, height))
    )
    head = {"<": b"II", ">": b"MM"}[order] + start + struct.pack(order + offset, place)
    return head + struct.pack(order + count, 3) + entries


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("big", "kind"), [(False, "H"), (False, "I"), (True, "I"), (True, "Q")])
def test_the_size_of_a_tiff_is_looked_at_before_its_pixels(order, big, kind):
    bomb = tiff_header(order, big, kind, 20_000, 30_000)
    with pytest.raises(UnreadableError, match="is 20000x30000 px; 100000000 pixels are the most"):
        safe_input.picture(bomb, cv2.IMREAD_UNCHANGED)
    for cut in range(len(bomb)):  # no other error
        safe_input.picture_size(bomb[:cut])


def test_ordinary_tiffs_are_read():
    image = np.linspace(0.0, 1.0, 1500).reshape(30, 50)
    content = cv2.imencode(".tiff", image)[1].tobytes()
    assert safe_input.picture_size(content) == (50, 30)
    np.testing.assert_array_equal(safe_input.picture(content, cv2.IMREAD_UNCHANGED), image)


def test_a_table_of_numbers_is_read_and_anything_else_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("# stamp, x\n1,2.5 # two\n\n3,nan\n")
    np.testing.assert_array_equal(safe_input.table(path, ","), [[1.0, 2.5], [3.0, np.nan]])
    packed = tmp_path / "a.dat.gz"
    packed.write_bytes(gzip.compress(b"1 2\n3 4\n"))
    np.testing.assert_array_equal(safe_input.table(packed), [[1.0, 2.0], [3.0, 4.0]])
    for content, message in (
        ("# nothing\n", "holds no numbers"),
        ("1,2\n3\n", "not a table of numbers"),
        ("1,x\n", "not a table of numbers"),
        ("\u0661,2\n\u00b2,2\n", "not a table of numbers"),
    ):
        path.write_text(content)
        with pytest.raises(UnreadableError, match=message):
            safe_input.table(path, ",")


def test_arrays_are_read_without_objects_and_within_a_limit(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=np.arange(3), b=np.zeros((2, 2)))
    found = safe_input.arrays(path)
    np.testing.assert_array_equal(found["a"], [0, 1, 2])
    assert found["b"].shape == (2, 2)
    whole = path.read_bytes()
    for content in (b"", b"x" * 99, whole[:-9], whole[:60] + b"\xff" + whole[61:]):
        path.write_bytes(content)
        with pytest.raises(UnreadableError, match=r"is damaged, or no \.npz"):
            safe_input.arrays(path)
    np.savez(path, a=np.array([{}], dtype=object))
    with pytest.raises(UnreadableError, match=r"is damaged, or no \.npz"):
        safe_input.arrays(path)
    np.savez_compressed(path, a=np.zeros(100_000))
    monkeypatch.setattr(safe_input, "MOST_ARRAY_BYTES", 1000)
    with pytest.raises(UnreadableError, match="unpacks to 800128 bytes; 1000"):
        safe_input.arrays(path)
