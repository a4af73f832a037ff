"""Reads the tables of numbers in a MATLAB file of version 5 to 7, packed or not; no content can crash it.

SciPy reads such files too, but a damaged one can end the process there.

Source: MathWorks, "MAT-File Format" (level 5).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from perception.primitives import safe_input
from perception.primitives.safe_input import UnreadableError

MOST_BYTES = 1 << 28  # unpacked
_HEAD = 128  # bytes before the first element
_MATRIX, _PACKED = 14, 15
_KINDS = {
    1: "<i1", 2: "<u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 9: "<f8", 12: "<i8", 13: "<u8",
}  # fmt: skip
_NUMBERS = range(6, 16)  # classes of matrices: double to uint64
_COMPLEX = 0x0800


def read_tables(path: Path) -> dict[str, Float64[np.ndarray, "n k"]]:
    """The two-dimensional real matrices of a file, by name; everything else in it is left out.

    Raises:
        UnreadableError: The file is missing, damaged, of another version or byte order, or unpacks to too much.
    """
    content = safe_input.data(path)
    if len(content) < _HEAD or content[126:128] != b"IM":
        raise UnreadableError("is no MATLAB file of version 5 to 7")
    found = {}
    left = MOST_BYTES
    for kind, body in _elements(content[_HEAD:]):
        if kind == _PACKED:
            unpacked = _unpacked(body, left)
            left -= len(unpacked)
            kind, body = next(_elements(unpacked), (0, b""))
        if kind == _MATRIX and (table := _table(body)) is not None:
            found[table[0]] = table[1]
    return found


def _elements(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element; small ones have both in eight bytes."""
    place = 0
    while place + 8 <= len(content):
        kind, length = struct.unpack_from("<II", content, place)
        if kind >> 16:
            kind, length, start, step = kind & 0xFFFF, kind >> 16, place + 4, 8
        else:
            start = place + 8
            step = 8 + (length if kind == _PACKED else -(-length // 8) * 8)
        if start + length > len(content):
            raise UnreadableError("is cut off")
        yield kind, content[start : start + length]
        place += step


def _unpacked(packed: bytes, most: int) -> bytes:
    machine = zlib.decompressobj()
    try:
        found = machine.decompress(packed, max(most, 1))
    except zlib.error as error:
        raise UnreadableError(f"is damaged ({error})") from error
    if machine.unconsumed_tail:
        raise UnreadableError(f"unpacks to more than {MOST_BYTES} bytes")
    return found


def _table(body: bytes) -> tuple[str, np.ndarray] | None:
    """Name and values of a matrix; None if it is none of real numbers with two dimensions."""
    parts = list(_elements(body))
    if len(parts) < 4 or len(parts[0][1]) < 4 or len(parts[1][1]) != 8:
        return None
    (flags,) = struct.unpack_from("<I", parts[0][1])
    rows, columns = struct.unpack("<ii", parts[1][1])
    kind, values = parts[3]
    if flags & 0xFF not in _NUMBERS or flags & _COMPLEX or kind not in _KINDS:
        return None
    dtype = np.dtype(_KINDS[kind])
    if rows < 0 or columns < 0 or rows * columns * dtype.itemsize != len(values):
        raise UnreadableError("has a matrix of another size than it says")
    table = np.frombuffer(values, dtype).reshape(rows, columns, order="F").astype(np.float64)
    return parts[2][1].decode("ascii", "replace"), table
