"""Compiled: blocks of voxels in a hash table, filled from depth images, and the surface through them.

A block is 8x8x8 voxels. Blocks are found by their whole-number place, packed into one key, in a table with
open addressing. Voxel (i, j, k) of the world lies at (i, j, k) times the voxel's size.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SIDE = 8
CELLS = SIDE**3
EMPTY = np.int64(-1)
FIXED = 256.0  # colours are kept as 16 bit, the lower 8 behind the point


@njit(cache=True, inline="always")
def key_of(i: int, j: int, k: int) -> np.int64:
    """One number for a block's place; up to a million blocks each way."""
    return np.int64(((i + 1048576) << 42) | ((j + 1048576) << 21) | (k + 1048576))


@njit(cache=True, inline="always")
def slot_of(keys: np.ndarray, key: np.int64) -> int:
    """Where the key is in the table, or where it would go."""
    mask = len(keys) - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = int(mixed >> np.uint64(32)) & mask
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True)
def find(keys: np.ndarray, values: np.ndarray, i: int, j: int, k: int) -> int:
    """Number of a block, -1 if there is none."""
    slot = slot_of(keys, key_of(i, j, k))
    return values[slot] if keys[slot] != EMPTY else -1


@njit(cache=True)
def rehash(places: np.ndarray, count: int, keys: np.ndarray, values: np.ndarray) -> None:
    """Fill an empty table."""
    for number in range(count):
        key = key_of(places[number, 0], places[number, 1], places[number, 2])
        slot = slot_of(keys, key)
        keys[slot], values[slot] = key, number


@njit(cache=True)
def touch(
    z: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    T: np.ndarray,
    nearest: float,
    farthest: float,
    band: float,
    block_m: float,
    stride: int,
    keys: np.ndarray,
    values: np.ndarray,
    places: np.ndarray,
    stamps: np.ndarray,
    stamp: int,
    count: int,
    visible: np.ndarray,
) -> tuple[int, int]:
    """Blocks within the band around the surface that is seen, made where missing.

    Returns (number of blocks, number of visible ones); the latter -1 if the room did not suffice.
    """
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


@njit(cache=True)
def integrate(
    z: np.ndarray,
    sigma: np.ndarray,
    rgb: np.ndarray,
    intrinsics: np.ndarray,
    T: np.ndarray,
    farthest: float,
    band: float,
    voxel: float,
    sigma_unit: float,
    most_weight: float,
    places: np.ndarray,
    visible: np.ndarray,
    voxels: np.ndarray,
    colours: np.ndarray,
) -> None:
    """Running mean of the distance to the surface, of weight 1/sigma^2, in every voxel of the blocks.

    `T` maps the world to the camera. Distance is along the axis, over the band, at most 1.
    """
    fx, fy, cx, cy = intrinsics.astype(np.float32)
    height, width = z.shape
    coloured = rgb.shape[0] > 1
    one = np.float32(1.0)
    half = np.float32(0.5)
    per_band = np.float32(1.0 / band)
    unit2 = np.float32(sigma_unit * sigma_unit)
    most = np.float32(most_weight)
    far = np.float32(farthest)
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
                    if u < 0.0 or v < 0.0 or u >= width or v >= height:
                        continue
                    iu, iv = np.int32(u), np.int32(v)
                    depth = z[iv, iu]
                    if not depth < far:
                        continue
                    distance = (depth - qz) * per_band
                    if distance < -one:
                        continue
                    s = sigma[iv, iu]
                    weight = unit2 / (s * s)
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


@njit(cache=True)
def sample(
    keys: np.ndarray,
    values: np.ndarray,
    voxels: np.ndarray,
    i: int,
    j: int,
    k: int,
) -> tuple[int, int]:
    """(block, voxel in it) of a voxel of the world; block -1 if there is none."""
    number = find(keys, values, i >> 3, j >> 3, k >> 3)
    return number, ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)


@njit(cache=True)
def corners(
    keys: np.ndarray,
    values: np.ndarray,
    voxels: np.ndarray,
    colours: np.ndarray,
    places: np.ndarray,
    count: int,
    least_weight: float,
    voxel: float,
    ids: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    tints: np.ndarray,
) -> int:
    """A vertex in every cell that the surface cuts; call with no room for vertices to count them."""
    found = 0
    f = np.empty(8)
    store = len(vertices) > 0
    coloured = len(colours) > 0
    around = np.empty(8, np.int64)
    for number in range(count):
        a, b, c = places[number]
        for n in range(8):
            around[n] = find(keys, values, a + (n >> 2), b + ((n >> 1) & 1), c + (n & 1))
        for cell in range(CELLS):
            i, j, k = cell >> 6, (cell >> 3) & 7, cell & 7
            ids[number, cell] = -1
            inside = 0
            whole = True
            tint = np.zeros(3)
            for n in range(8):
                x, y, z = i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1)
                block = around[((x >> 3) << 2) | ((y >> 3) << 1) | (z >> 3)]
                if block < 0:
                    whole = False
                    break
                at = (((x & 7) << 3) | (y & 7)) << 3 | (z & 7)
                if voxels[block, at, 1] < least_weight:
                    whole = False
                    break
                f[n] = voxels[block, at, 0]
                if f[n] < 0.0:
                    inside += 1
                if store and coloured:
                    for m in range(3):
                        tint[m] += colours[block, at, m]
            if not whole or inside == 0 or inside == 8:
                continue
            if store:
                ids[number, cell] = found
                p, g = crossing(f)
                vertices[found, 0] = ((a * SIDE + i) + p[0]) * voxel
                vertices[found, 1] = ((b * SIDE + j) + p[1]) * voxel
                vertices[found, 2] = ((c * SIDE + k) + p[2]) * voxel
                normals[found, 0], normals[found, 1], normals[found, 2] = g
                for m in range(3):
                    tints[found, m] = np.uint8(min(255.0, tint[m] / (8.0 * FIXED)))
            found += 1
    return found


@njit(cache=True)
def crossing(f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the surface lies in a cell, and its unit normal towards free space.

    The mean of the points where it cuts edges, then put onto the surface along the slope of the distance.
    """
    p, cuts = np.zeros(3), 0
    for n in range(8):
        for axis in range(3):
            bit = 4 >> axis
            if n & bit or (f[n] < 0.0) == (f[n | bit] < 0.0):
                continue
            t = f[n] / (f[n] - f[n | bit])
            p[0] += t if axis == 0 else float((n >> 2) & 1)
            p[1] += t if axis == 1 else float((n >> 1) & 1)
            p[2] += t if axis == 2 else float(n & 1)
            cuts += 1
    p /= cuts
    g = np.zeros(3)
    value = 0.0
    for n in range(8):
        sx = p[0] if n & 4 else 1.0 - p[0]
        sy = p[1] if n & 2 else 1.0 - p[1]
        sz = p[2] if n & 1 else 1.0 - p[2]
        value += f[n] * sx * sy * sz
        g[0] += f[n] * sy * sz * (1.0 if n & 4 else -1.0)
        g[1] += f[n] * sx * sz * (1.0 if n & 2 else -1.0)
        g[2] += f[n] * sx * sy * (1.0 if n & 1 else -1.0)
    size2 = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
    if size2 > 1e-12:
        for m in range(3):
            p[m] = min(1.0, max(0.0, p[m] - value * g[m] / size2))
        g /= np.sqrt(size2)
    return p, g


@njit(cache=True)
def faces(
    keys: np.ndarray,
    values: np.ndarray,
    voxels: np.ndarray,
    places: np.ndarray,
    count: int,
    ids: np.ndarray,
    triangles: np.ndarray,
) -> int:
    """Two triangles across every edge that the surface cuts; without room for them, count them."""
    found = 0
    store = len(triangles) > 0
    quad = np.empty(4, np.int64)
    for number in range(count):
        a, b, c = places[number, 0] * SIDE, places[number, 1] * SIDE, places[number, 2] * SIDE
        for cell in range(CELLS):
            if voxels[number, cell, 1] <= 0.0:
                continue
            here = voxels[number, cell, 0] < 0.0
            i, j, k = a + (cell >> 6), b + ((cell >> 3) & 7), c + (cell & 7)
            for axis in range(3):
                di, dj, dk = int(axis == 0), int(axis == 1), int(axis == 2)
                block, at = sample(keys, values, voxels, i + di, j + dj, k + dk)
                if block < 0 or voxels[block, at, 1] <= 0.0:
                    continue
                if (voxels[block, at, 0] < 0.0) == here:
                    continue
                complete = True
                for n in range(4):
                    s, t = ((n + 1) >> 1) & 1, n >> 1  # round the edge: 00, 10, 11, 01
                    if axis == 0:
                        block, at = sample(keys, values, voxels, i, j - s, k - t)
                    elif axis == 1:
                        block, at = sample(keys, values, voxels, i - t, j, k - s)
                    else:
                        block, at = sample(keys, values, voxels, i - s, j - t, k)
                    quad[n] = ids[block, at] if block >= 0 else -1
                    complete = complete and quad[n] >= 0
                if not complete:
                    continue
                if store:
                    one, three = (1, 3) if here else (3, 1)
                    triangles[found, 0] = quad[0]
                    triangles[found, 1], triangles[found, 2] = quad[one], quad[2]
                    triangles[found + 1, 0] = quad[0]
                    triangles[found + 1, 1], triangles[found + 1, 2] = quad[2], quad[three]
                found += 2
    return found
