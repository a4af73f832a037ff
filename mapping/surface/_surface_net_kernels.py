"""Compiled surface nets: the mesh of the zero level of the signed distance in voxel blocks.

Source: Gibson 1998.
"""

from __future__ import annotations

import numpy as np

from perception.primitives.compiled import njit

from ._tsdf_kernels import CELLS, FIXED, SIDE, Blocks, find


@njit(cache=True)
def sample(
    blocks: Blocks,
    i: int,
    j: int,
    k: int,
) -> tuple[int, int]:
    """(block, voxel in it) of a voxel of the map; block is -1 if it does not exist."""
    number = find(blocks.keys, blocks.values, i >> 3, j >> 3, k >> 3)
    return number, ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)


@njit(cache=True)
def corners(
    blocks: Blocks,
    count: int,
    least_weight: float,
    voxel: float,
    ids: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    tints: np.ndarray,
) -> int:
    """Create a vertex in every cell that the surface crosses; with empty outputs, count them only.

    Args:
        blocks: Storage.
        count: Blocks in use.
        least_weight: Voxels of less weight have no surface.
        voxel: Side of a voxel, m.
        ids: (count, CELLS) int32, out: vertex of each cell, -1 for none.
        vertices, normals: (n, 3) float32, out, m and unit vectors.
        tints: (n, 3) uint8, out, RGB.

    Returns:
        Number of vertices.
    """
    keys, values, voxels = blocks.keys, blocks.values, blocks.voxels
    colours, places = blocks.colours, blocks.places
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
    """Position of the surface in a cell, and its unit normal towards free space.

    The position is the mean of the edge crossings, then moved along the gradient onto the zero level.
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
    blocks: Blocks,
    count: int,
    ids: np.ndarray,
    triangles: np.ndarray,
) -> int:
    """Create two triangles across every edge that the surface crosses; with empty output, count them only."""
    voxels, places = blocks.voxels, blocks.places
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
                block, at = sample(blocks, i + di, j + dj, k + dk)
                if block < 0 or voxels[block, at, 1] <= 0.0:
                    continue
                if (voxels[block, at, 0] < 0.0) == here:
                    continue
                complete = True
                for n in range(4):
                    s, t = ((n + 1) >> 1) & 1, n >> 1  # around the edge: 00, 10, 11, 01
                    if axis == 0:
                        block, at = sample(blocks, i, j - s, k - t)
                    elif axis == 1:
                        block, at = sample(blocks, i - t, j, k - s)
                    else:
                        block, at = sample(blocks, i - s, j - t, k)
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
