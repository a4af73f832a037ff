"""LZF decompression, as PCD's binary_compressed uses it (Marc Lehmann's liblzf format)."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def lzf_decompress(packed: np.ndarray, size: int) -> np.ndarray:
    """Unpack uint8 data of known size; an array of length 0 where the data is damaged.

    A control byte below 32 is followed by that many literals plus one; any other copies from what was
    written: 3 bits of length, 13 bits of distance, one more length byte if the 3 bits are full.
    """
    out = np.empty(size, dtype=np.uint8)
    read, written = 0, 0
    while read < packed.size:
        control = int(packed[read])
        read += 1
        if control < 32:
            count = control + 1
            if read + count > packed.size or written + count > size:
                return np.empty(0, dtype=np.uint8)
            for i in range(count):
                out[written + i] = packed[read + i]
            read += count
        else:
            count = control >> 5
            if count == 7 and read < packed.size:
                count += int(packed[read])
                read += 1
            if read >= packed.size:
                return np.empty(0, dtype=np.uint8)
            start = written - ((control & 31) << 8) - int(packed[read]) - 1
            read += 1
            count += 2
            if start < 0 or written + count > size:
                return np.empty(0, dtype=np.uint8)
            for i in range(count):  # one by one: source and target may overlap
                out[written + i] = out[start + i]
        written += count
    if written != size:
        return np.empty(0, dtype=np.uint8)
    return out
