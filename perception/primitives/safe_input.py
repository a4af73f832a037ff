"""Reading what somebody else wrote: files, text, TOML, JSON, numbers, arrays and pictures, within limits.

Whatever is wrong with the content is one exception, `UnreadableError`, so that a caller has one thing to report.
"""

from __future__ import annotations

import io
import json as _json
import math
import os
import stat
import struct
import tomllib
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64, Shaped

MOST_BYTES = 1 << 30  # of a file
MOST_TEXT_BYTES = 1 << 28  # of a text file, unpacked
MOST_ARRAY_BYTES = 1 << 30  # of the arrays of a file together, unpacked
MOST_PIXELS = 100_000_000  # of a picture
MOST_DIGITS = 18  # of an integer; 64 bits hold them
_LARGEST = 10**MOST_DIGITS
_PNG = b"\x89PNG\r\n\x1a\n"
_NPY = b"\x93NUMPY"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # of both orders of bytes; + is BigTIFF
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257  # tags
_TIFF_TYPES = {1: "B", 6: "B", 3: "H", 8: "H", 4: "I", 9: "I", 16: "Q", 17: "Q"}  # integers
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers that hold width and height


class UnreadableError(ValueError):
    """Content that cannot be used; the message says what is wrong, without the name of the file."""


class MissingError(UnreadableError):
    """There is no such file."""


def data(path: str | Path, most_bytes: int = MOST_BYTES) -> bytes:
    """The content of a regular file.

    Raises:
        MissingError: There is no such file.
        UnreadableError: It is a folder, a pipe or a device, too large, or cannot be read.
    """
    size = check_file(path)
    if size > most_bytes:
        raise UnreadableError(f"has {size} bytes; {most_bytes} are the most")
    return head(path, most_bytes)


def head(path: str | Path, count: int) -> bytes:
    """The first bytes of a regular file, at most so many; errors as of `check_file`."""
    check_file(path)
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except OSError as error:
        raise UnreadableError(f"cannot be read: {error.strerror or error}") from error


def check_file(path: str | Path) -> int:
    """The size of a regular file, bytes; opening a pipe instead would wait for its writer.

    Raises:
        MissingError: There is no such file.
        UnreadableError: It is a folder, a pipe or a device, or has an impossible name.
    """
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise UnreadableError("is not a file")
        return status.st_size
    except OSError as error:
        kind = MissingError if isinstance(error, FileNotFoundError) else UnreadableError
        raise kind(f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        if isinstance(error, UnreadableError):
            raise
        raise UnreadableError(f"has an impossible name ({error})") from error


def text(path: str | Path) -> str:
    """The content of a UTF-8 text file without its byte order mark, also gzipped (.gz); errors as of `data`."""
    path = Path(path)
    content = data(path, MOST_TEXT_BYTES)
    if path.suffix == ".gz":
        content = _unzipped(content)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableError(f"is not text in UTF-8 ({error})") from error


def _unzipped(content: bytes) -> bytes:
    machine = zlib.decompressobj(wbits=31)
    try:
        unpacked = machine.decompress(content, MOST_TEXT_BYTES)
    except zlib.error as error:
        raise UnreadableError(f"is not gzip ({error})") from error
    if not machine.eof:
        more = (
            "unpacks to more than the limit of" if machine.unconsumed_tail else "is cut off after"
        )
        raise UnreadableError(f"{more} {len(unpacked)} bytes")
    return unpacked


def toml(content: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        UnreadableError: It is not TOML, nested too deeply, or has an integer of too many digits.
    """
    found: dict[str, Any] = _parsed(tomllib.loads, "TOML", content)
    return found


def json(content: str | bytes) -> Any:
    """The value of a JSON text; errors as of `toml`."""
    return _parsed(_json.loads, "JSON", content)


def _parsed(parse: Callable[[Any], Any], kind: str, content: str | bytes) -> Any:
    try:
        found = parse(content)
    except RecursionError as error:
        raise UnreadableError(f"is not valid {kind}: nested too deeply") from error
    except ValueError as error:
        raise UnreadableError(f"is not valid {kind}: {str(error).split(';')[0]}") from error
    _refuse_large(found)
    return found


def _refuse_large(value: Any) -> None:
    """Raise an UnreadableError for an integer of too many digits, anywhere inside."""
    waiting = [value]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            waiting += one.values()
        elif isinstance(one, list):
            waiting += one
        elif isinstance(one, int) and abs(one) >= _LARGEST:
            raise UnreadableError(f"holds an integer of more than {MOST_DIGITS} digits")


def whole(word: str) -> int | None:
    """A whole number that is not negative, written in the digits 0 to 9; None for anything else."""
    digits = word.isascii() and word.isdigit() and len(word) <= MOST_DIGITS
    return int(word) if digits else None


def table(path: str | Path, delimiter: str | None = None) -> Float64[np.ndarray, "n k"]:
    """The numbers of a text file, also gzipped, with the same count in every line; # begins a comment.

    Args:
        path: The file.
        delimiter: Between numbers; None: blanks.

    Raises:
        UnreadableError: As of `text`, or a line has no numbers or another count of them, or there is none.
    """
    lines = [line.split("#", 1)[0] for line in text(path).splitlines()]
    lines = [line for line in lines if line.strip()]
    if not lines:
        raise UnreadableError("holds no numbers")
    try:
        return np.loadtxt(lines, np.float64, delimiter=delimiter, ndmin=2)
    except ValueError as error:
        raise UnreadableError(f"is not a table of numbers ({error})") from error


def arrays(path: str | Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """The arrays of a file of NumPy (.npz).

    Raises:
        UnreadableError: As of `data`, or it is damaged, no such file, holds objects, or unpacks to too much.
    """
    content = data(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            size = sum(one.file_size for one in packed.infolist())
        if size > MOST_ARRAY_BYTES:
            raise UnreadableError(f"unpacks to {size} bytes; {MOST_ARRAY_BYTES} are the most")
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            return {name: np.asarray(file[name]) for name in file.files}
    except UnreadableError:
        raise
    except Exception as error:  # NumPy and zipfile raise many types for a damaged file
        raise UnreadableError(f"is damaged, or no .npz of NumPy ({error})") from error


def is_array(content: bytes) -> bool:
    """Whether the content of a file begins as one array of NumPy (.npy)."""
    return content.startswith(_NPY)


def array(content: bytes) -> Shaped[np.ndarray, "..."]:
    """The array of a file of NumPy (.npy), given the content of the file.

    Raises:
        UnreadableError: It is damaged, holds objects, or not as many bytes as its header says; the header is read
            before the numbers.
    """
    file = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            read = np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        if dtype.hasobject:
            raise UnreadableError("holds Python objects, not numbers")
        said, held = math.prod(shape) * dtype.itemsize, len(content) - file.tell()
        if min(shape, default=0) < 0 or said != held:
            raise UnreadableError(
                f"holds {held} bytes of numbers; its header says {said}, of shape {shape} and type {dtype}"
            )
        file.seek(0)
        return np.asarray(np.load(file, allow_pickle=False))
    except UnreadableError:
        raise
    except Exception as error:  # NumPy raises many types for a damaged header
        raise UnreadableError("is damaged, or no .npy of NumPy") from error


def picture(content: bytes, flags: int) -> Shaped[np.ndarray, "..."]:
    """A picture in any format of OpenCV.

    Args:
        content: Of the file.
        flags: `cv2.IMREAD_...`.

    Raises:
        UnreadableError: It cannot be decoded, or is too large; the size is read before the pixels.
    """
    size = picture_size(content)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise UnreadableError(f"is {size[0]}x{size[1]} px; {MOST_PIXELS} pixels are the most")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise UnreadableError("cannot be decoded")
    return np.asarray(image)


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Width and height by the header of a PNG, JPEG or TIFF; None for other formats, which OpenCV limits."""
    if content.startswith(_PNG) and len(content) >= 24:
        return int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    if content.startswith(_TIFF):
        return _tiff_size(content)
    if not content.startswith(b"\xff\xd8"):
        return None
    place = 2
    while place + 9 <= len(content) and content[place] == 0xFF:
        if content[place + 1] in _JPEG_SIZES:
            height, width = content[place + 5 : place + 7], content[place + 7 : place + 9]
            return int.from_bytes(width, "big"), int.from_bytes(height, "big")
        place += 2 + int.from_bytes(content[place + 2 : place + 4], "big")
    return None


def _tiff_size(content: bytes) -> tuple[int, int] | None:
    """By the first directory, whose entries are tag, type, count and value. Source: TIFF 6.0, section 2; BigTIFF."""
    order, big = "<" if content.startswith(b"I") else ">", b"+" in content[2:4]
    offset, number, entry, value = ("Q", "Q", 20, 12) if big else ("I", "H", 12, 8)
    sizes = {_TIFF_WIDTH: 0, _TIFF_HEIGHT: 0}
    try:
        (place,) = struct.unpack_from(order + offset, content, value - 4)
        (count,) = struct.unpack_from(order + number, content, place)
        place += struct.calcsize(order + number)
        for start in range(place, min(place + count * entry, len(content)), entry):
            tag, kind = struct.unpack_from(order + "HH", content, start)
            if tag in sizes and kind in _TIFF_TYPES:
                (size,) = struct.unpack_from(order + _TIFF_TYPES[kind], content, start + value)
                sizes[tag] = max(sizes[tag], size)
    except (struct.error, OverflowError):  # the file ends before; OpenCV refuses it
        return None
    return sizes[_TIFF_WIDTH], sizes[_TIFF_HEIGHT]
