"""LZF decompression, as PCD's binary_compressed uses it (Marc Lehmann's liblzf format)."""

from __future__ import annotations

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def lzf_decompress(packed: np.ndarray, size: int) -> np.ndarray:
    """Decompress uint8 data of known size; returns an array of length 0 for damaged data.

    A control byte below 32 precedes that many literals plus one. Any other control byte copies earlier output:
    3 bits of length, 13 bits of distance, and another length byte if the 3 bits are all set.
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
            for i in range(count):  # byte by byte, because source and target may overlap
                out[written + i] = out[start + i]
        written += count
    if written != size:
        return np.empty(0, dtype=np.uint8)
    return out
