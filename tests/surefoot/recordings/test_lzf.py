"""LZF decompression, against a compressor and with damaged data."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.recordings._lzf_kernels import lzf_decompress


def unpack(packed, size):
    return lzf_decompress(np.frombuffer(packed, np.uint8), size).tobytes()


@given(st.binary(max_size=60), st.integers(1, 12), st.binary(max_size=20))
def test_decompression_inverts_compression(lzf_packer, head, repeats, tail):
    data = head * repeats + tail
    assert unpack(lzf_packer(data), len(data)) == data


def test_a_reference_may_overlap_what_it_writes():
    packed = bytes([0, ord("a"), (7 << 5) | 0, 20, 0])  # one literal, then 29 bytes from one back
    assert unpack(packed, 30) == b"a" * 30


@pytest.mark.parametrize(
    ("packed", "size"),
    [
        (bytes([5, 1, 2]), 6),  # literals cut short
        (bytes([32, 9]), 3),  # refers to before the start
        (bytes([0, 1, 32]), 4),  # reference cut short
        (bytes([0, 1]), 5),  # too little comes out
        (bytes([3, 1, 2, 3, 4]), 2),  # too much comes out
    ],
)
def test_damaged_data_gives_an_empty_result(packed, size):
    assert unpack(packed, size) == b""


@given(st.binary(max_size=80), st.integers(0, 200))
def test_random_bytes_never_read_or_write_outside(packed, size):
    assert len(unpack(packed, size)) in (0, size)
