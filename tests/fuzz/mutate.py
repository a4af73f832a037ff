"""Changes to a file that a reader may meet: damaged bytes, cut ends, doubled parts, and impossible words."""

from __future__ import annotations

import random
import re

WORDS = (
    b"", b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1e300", b"1e-300", b"9" * 20, b"9" * 400, b"9" * 5000,
    b"4294967296", b"-2147483649", b"65536", b"0x10", "²".encode(), "٣".encode(), b"true", b"null", b"[]", b"{}", b"''",
    b'"x"', b"[" * 2000, b"/dev/zero", b"../..", b"a\0b", b"%s", b"\xff\xfe", b"\n", b" ", b",",
)  # fmt: skip
_WORD = re.compile(rb"[A-Za-z0-9_.+-]+")


def mutated(content: bytes, rng: random.Random) -> bytes:
    """The content with one to four changes."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        content = rng.choice(KINDS)(content, rng)
    return content


def _flip(content: bytes, rng: random.Random) -> bytes:
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if found:
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _byte(content: bytes, rng: random.Random) -> bytes:
    found = bytearray(content)
    if found:
        found[rng.randrange(len(found))] = rng.choice((0, 1, 127, 128, 255))
    return bytes(found)


def _cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _remove(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + content[start + rng.choice((1, 2, 7, 50)) :]


def _repeat(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    end = start + rng.choice((1, 4, 30, 300))
    return content[:end] + content[start:end] * rng.choice((1, 3, 40)) + content[end:]


def _insert(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + rng.choice(WORDS) + content[start:]


def _word(content: bytes, rng: random.Random) -> bytes:
    """Another word in the place of one; in files that are mostly binary, of one near the beginning."""
    places = list(_WORD.finditer(content[:20_000]))
    if not places:
        return _insert(content, rng)
    place = rng.choice(places)
    return content[: place.start()] + rng.choice(WORDS) + content[place.end() :]


def _number(content: bytes, rng: random.Random) -> bytes:
    """Four or eight bytes as another integer."""
    size = rng.choice((2, 4, 8))
    start = rng.randrange(max(len(content) - size, 0) + 1)
    value = rng.choice((0, 1, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1)) % 2 ** (8 * size)
    return (
        content[:start]
        + value.to_bytes(size, rng.choice(("little", "big")))
        + content[start + size :]
    )


KINDS = (_flip, _byte, _cut, _remove, _repeat, _insert, _word, _word, _number)
