"""Compiled loops of the surface map: voxel blocks in a hash table, and fusion of depth into them.

A block has 8x8x8 voxels. Its integer coordinates, packed into one key, index a hash table with open
addressing. Voxel (i, j, k) of the map is at (i, j, k) times the voxel size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

from ..pinhole import Pinhole

SIDE = 8
CELLS = SIDE**3
EMPTY = np.int64(-1)
FIXED = 256.0  # colours are 16 bit fixed point, with 8 fractional bits


class Blocks(NamedTuple):
    """Storage of all blocks.

    Args:
        keys, values: Hash table: (slots,) int64 keys, (slots,) int32 block numbers.
        places: (capacity, 3) int32, coordinates of each block, in blocks.
        stamps: (capacity,) int64, number of the last image that touched it.
        voxels: (capacity, CELLS, 2) float32, distance in [-1, 1] truncation bands, and weight.
        colours: (capacity, CELLS, 3) uint16 RGB, or (0, CELLS, 3) without colours.
    """

    keys: np.ndarray
    values: np.ndarray
    places: np.ndarray
    stamps: np.ndarray
    voxels: np.ndarray
    colours: np.ndarray


class Fusion(NamedTuple):
    """Parameters of the fusion, m.

    Args:
        nearest, farthest: Depth range.
        band: Truncation distance.
        voxel: Side of a voxel.
        unit_sigma: Depth sigma with weight 1.
        most_weight: Largest weight of a voxel.
    """

    nearest: float
    farthest: float
    band: float
    voxel: float
    unit_sigma: float
    most_weight: float


@njit(cache=True, inline="always")
def key_of(i: int, j: int, k: int) -> np.int64:
    """Coordinates of a block, up to a million along each axis, packed into one key."""
    return np.int64(((i + 1048576) << 42) | ((j + 1048576) << 21) | (k + 1048576))


@njit(cache=True, inline="always")
def slot_of(keys: np.ndarray, key: np.int64) -> int:
    """Slot of the key in the table, or the free slot for it."""
    mask = len(keys) - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = int(mixed >> np.uint64(32)) & mask
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True)
def find(keys: np.ndarray, values: np.ndarray, i: int, j: int, k: int) -> int:
    """Number of a block; -1 if it does not exist."""
    slot = slot_of(keys, key_of(i, j, k))
    return values[slot] if keys[slot] != EMPTY else -1


@njit(cache=True)
def rehash(places: np.ndarray, count: int, keys: np.ndarray, values: np.ndarray) -> None:
    """Fill an empty hash table with the first `count` blocks."""
    for number in range(count):
        key = key_of(places[number, 0], places[number, 1], places[number, 2])
        slot = slot_of(keys, key)
        keys[slot], values[slot] = key, number


@njit(cache=True, nogil=True)
def touch(
    z: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    T: np.ndarray,
    rule: Fusion,
    stride: int,
    blocks: Blocks,
    stamp: int,
    count: int,
    visible: np.ndarray,
) -> tuple[int, int]:
    """Find the blocks within the band around the visible surface; missing ones are created.

    Args:
        z: (h, w) depth, m.
        x, y: (w,) and (h,), slopes of the pixels' rays.
        T: (4, 4), camera to map.
        rule: Range, band and voxel size.
        stride: Pixels between samples.
        blocks: Storage; changed.
        stamp: Number of the image.
        count: Blocks in use.
        visible: (capacity,) int64, out: numbers of the blocks.

    Returns:
        (blocks in use, visible blocks); the latter is -1 if the capacity is exceeded.
    """
    keys, values, places, stamps = blocks.keys, blocks.values, blocks.places, blocks.stamps
    nearest, farthest, band, block_m = rule.nearest, rule.farthest, rule.band, SIDE * rule.voxel
    seen = 0
    inverse = 1.0 / block_m
    samples = int(np.ceil(2.0 * band * inverse * 1.5)) + 1
    last = EMPTY
    for row in range(stride // 2, z.shape[0], stride):
        for column in range(stride // 2, z.shape[1], stride):
            depth = z[row, column]
            if not (depth > nearest and depth < farthest):
                continue
            dx = T[0, 0] * x[column] + T[0, 1] * y[row] + T[0, 2]
            dy = T[1, 0] * x[column] + T[1, 1] * y[row] + T[1, 2]
            dz = T[2, 0] * x[column] + T[2, 1] * y[row] + T[2, 2]
            for n in range(samples):
                along = depth - band + 2.0 * band * n / (samples - 1)
                i = int(np.floor((T[0, 3] + dx * along) * inverse))
                j = int(np.floor((T[1, 3] + dy * along) * inverse))
                k = int(np.floor((T[2, 3] + dz * along) * inverse))
                key = key_of(i, j, k)
                if key == last:
                    continue
                last = key
                slot = slot_of(keys, key)
                if keys[slot] == EMPTY:
                    if count == len(places):
                        return count, -1
                    keys[slot], values[slot] = key, count
                    places[count, 0], places[count, 1], places[count, 2] = i, j, k
                    stamps[count] = -1
                    count += 1
                number = values[slot]
                if stamps[number] != stamp:
                    stamps[number] = stamp
                    visible[seen] = number
                    seen += 1
    return count, seen


@njit(cache=True, nogil=True)
def integrate(
    z: np.ndarray,
    sigma: np.ndarray,
    rgb: np.ndarray,
    camera: Pinhole,
    T: np.ndarray,
    rule: Fusion,
    visible: np.ndarray,
    blocks: Blocks,
) -> None:
    """Update the weighted mean distance to the surface in every voxel of the visible blocks.

    The distance is along the optical axis, divided by the band and at most 1; its weight is 1/sigma^2, at most that of a
    voxel: exact depth has sigma 0.

    Args:
        z, sigma: (h, w) depth and its standard deviation, m.
        rgb: (h, w, 3) uint8, or (1, 1, 3) without colours.
        T: (4, 4), map to camera.
        visible: Numbers of the blocks.
        blocks: Storage; changed.
    """
    places, voxels, colours, voxel = blocks.places, blocks.voxels, blocks.colours, rule.voxel
    fx, fy = np.float32(camera.fx), np.float32(camera.fy)
    cx, cy = np.float32(camera.cx), np.float32(camera.cy)
    height, width = z.shape
    coloured = rgb.shape[0] > 1
    one = np.float32(1.0)
    half = np.float32(0.5)
    per_band = np.float32(1.0 / rule.band)
    unit2 = np.float32(rule.unit_sigma * rule.unit_sigma)
    most = np.float32(rule.most_weight)
    far = np.float32(rule.farthest)
    step = np.float32(voxel)
    sx, sy, sz = np.float32(T[0, 2]) * step, np.float32(T[1, 2]) * step, np.float32(T[2, 2]) * step
    for number in visible:
        block = voxels[number]
        ox = places[number, 0] * SIDE * voxel
        oy = places[number, 1] * SIDE * voxel
        oz = places[number, 2] * SIDE * voxel
        for i in range(SIDE):
            wx = ox + i * voxel
            for j in range(SIDE):
                wy = oy + j * voxel
                px = np.float32(T[0, 0] * wx + T[0, 1] * wy + T[0, 2] * oz + T[0, 3])
                py = np.float32(T[1, 0] * wx + T[1, 1] * wy + T[1, 2] * oz + T[1, 3])
                pz = np.float32(T[2, 0] * wx + T[2, 1] * wy + T[2, 2] * oz + T[2, 3])
                base = (i * SIDE + j) * SIDE
                for k in range(SIDE):
                    qx, qy, qz = px + k * sx, py + k * sy, pz + k * sz
                    if qz < np.float32(0.05):
                        continue
                    inverse = one / qz
                    u = fx * qx * inverse + cx + half
                    v = fy * qy * inverse + cy + half
                    if not (0.0 <= u < width and 0.0 <= v < height):
                        continue  # also what is not a number
                    iu, iv = np.int32(u), np.int32(v)
                    depth = z[iv, iu]
                    if not depth < far:
                        continue
                    distance = (depth - qz) * per_band
                    if distance < -one:
                        continue
                    s = sigma[iv, iu]
                    weight = unit2 / max(s * s, unit2 / most)
                    if distance < np.float32(0.0):
                        weight *= one + distance * half
                    cell = block[base + k]
                    total = cell[1] + weight
                    share = weight / total
                    cell[0] += (min(distance, one) - cell[0]) * share
                    cell[1] = min(total, most)
                    if coloured and distance < one:
                        colour = colours[number, base + k]
                        for c in range(3):
                            old = np.float32(colour[c])
                            new = (
                                old + (np.float32(rgb[iv, iu, c]) * np.float32(FIXED) - old) * share
                            )
                            colour[c] = np.uint16(new + half)
