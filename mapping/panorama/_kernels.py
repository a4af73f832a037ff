"""Compiled loops over the pixels of a panorama: drawing views, correlation, labelling of level sets."""

from __future__ import annotations

import numpy as np

from perception.primitives.compiled import njit

from ..pinhole import Pinhole


@njit(cache=True, nogil=True)
def draw(
    rays: np.ndarray,
    z: np.ndarray,
    sigma: np.ndarray,
    rotation: np.ndarray,
    centre: np.ndarray,
    camera: Pinhole,
    base: np.ndarray,
    out_range: np.ndarray,
    out_sigma: np.ndarray,
) -> None:
    """Draw one view on the sphere, as seen from the sphere's centre.

    For a camera off the centre, the parallax is resolved by four iterations of range and pixel.

    Args:
        rays: (h, w, 3) unit directions, base frame.
        z, sigma: (a, b) depth of the view and its standard deviation, m.
        rotation: (3, 3), base to camera.
        centre: (3,), position of the camera, base frame, m.
        camera: Intrinsics of the view.
        base: (3,), centre of the sphere, base frame, m.
        out_range, out_sigma: (h, w), m; written where the view has depth.
    """
    height, width = z.shape
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    sx, sy, sz = centre[0] - base[0], centre[1] - base[1], centre[2] - base[2]
    moved = abs(sx) + abs(sy) + abs(sz) > 1e-9
    for r in range(rays.shape[0]):
        for c in range(rays.shape[1]):
            dx, dy, dz = rays[r, c, 0], rays[r, c, 1], rays[r, c, 2]
            px = rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz
            py = rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz
            pz = rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz
            if pz <= 1e-3:
                continue
            qx = rotation[0, 0] * sx + rotation[0, 1] * sy + rotation[0, 2] * sz
            qy = rotation[1, 0] * sx + rotation[1, 1] * sy + rotation[1, 2] * sz
            qz = rotation[2, 0] * sx + rotation[2, 1] * sy + rotation[2, 2] * sz
            distance, known, off, deviation = 1e6, False, 0.0, np.float32(0.0)
            for _ in range(4 if moved else 1):
                x, y, depth = px * distance - qx, py * distance - qy, pz * distance - qz
                if depth <= 1e-3:
                    known = False
                    break
                u = int(np.floor(fx * x / depth + cx + 0.5))
                v = int(np.floor(fy * y / depth + cy + 0.5))
                if u < 0 or v < 0 or u >= width or v >= height or not z[v, u] > 0.0:
                    known = False
                    break
                found = (z[v, u] + qz) / pz
                off = abs(found - distance)
                distance, known, deviation = found, True, sigma[v, u]
            if known and distance > 0.0 and (not moved or off < 0.02 * distance + 0.02):
                out_range[r, c] = distance
                out_sigma[r, c] = deviation / pz


@njit(cache=True, nogil=True)
def fuse(
    ranges: np.ndarray,
    sigmas: np.ndarray,
    within: float,
    out_range: np.ndarray,
    out_sigma: np.ndarray,
    newest: np.ndarray,
) -> None:
    """Fuse several drawings: the nearest range, averaged with the ranges close behind it.

    Args:
        ranges, sigmas: (n, h, w), m; NaN where a view has no depth.
        within: Largest distance behind the nearest range, m; at least four standard deviations are used.
        out_range, out_sigma: (h, w), m, out.
        newest: (h, w), out: index of the last view that took part, -1 if none did.
    """
    count, height, width = ranges.shape
    for r in range(height):
        for c in range(width):
            nearest = np.inf
            for k in range(count):
                value = ranges[k, r, c]
                if value > 0.0 and value < nearest:
                    nearest = value
            if not nearest < np.inf:
                out_range[r, c], out_sigma[r, c], newest[r, c] = np.nan, np.nan, -1
                continue
            total, weights = 0.0, 0.0
            for k in range(count):
                value = ranges[k, r, c]
                if value > 0.0 and value <= nearest + max(within, 4.0 * sigmas[k, r, c]):
                    sigma = max(sigmas[k, r, c], np.float32(1e-6))  # exact depth has 0
                    weight = 1.0 / (sigma * sigma)
                    total += weight * value
                    weights += weight
                    newest[r, c] = k
            out_range[r, c] = total / weights
            out_sigma[r, c] = 1.0 / np.sqrt(weights)


@njit(cache=True, nogil=True, fastmath=True)
def correlate(
    panorama: np.ndarray,
    known: np.ndarray,
    template: np.ndarray,
    shown: np.ndarray,
    top: int,
    left: int,
    row_step: int,
    least: float,
    out: np.ndarray,
) -> None:
    """Normalised cross correlation of a template over a window of offsets, on pixels known in both.

    Args:
        panorama, known: (H, W) float32, values (0 where unknown) and 1 where known.
        template, shown: (h, w), likewise.
        top, left: First position of the template's corner, px.
        row_step: Every how many rows are compared.
        least: Fewest common pixels.
        out: (rows, columns) float32, out; -2 where fewer pixels are common.
    """
    height, width = template.shape
    for dr in range(out.shape[0]):
        for dc in range(out.shape[1]):
            n, sf, st = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            sff, stt, sft = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            first = max(0, -(left + dc))
            count = min(width, panorama.shape[1] - left - dc) - first
            for r in range(0, height, row_step):
                y = top + dr + r
                if y < 0 or y >= panorama.shape[0] or count <= 0:
                    continue
                f, k = panorama[y, left + dc + first :], known[y, left + dc + first :]
                t, s = template[r, first:], shown[r, first:]
                for c in range(count):
                    n += k[c] * s[c]
                    sf += f[c] * s[c]
                    st += t[c] * k[c]
                    sff += f[c] * f[c] * s[c]
                    stt += t[c] * t[c] * k[c]
                    sft += f[c] * t[c]
            out[dr, dc] = np.float32(-2.0)
            if n >= least:
                vf, vt = sff - sf * sf / n, stt - st * st / n
                if vf > 1e-6 * n and vt > 1e-6 * n:
                    out[dr, dc] = (sft - sf * st / n) / np.sqrt(vf * vt)


@njit(cache=True, nogil=True)
def label(levels: np.ndarray, labels: np.ndarray, parent: np.ndarray) -> int:
    """Label 8-connected pixels of equal level in one pass, then number the labels from 1.

    Args:
        levels: (h, w) int, 0 for none.
        labels: (h, w) int32, out.
        parent: (h w + 2,) int32, scratch.

    Returns:
        Number of labels.
    """
    height, width = levels.shape
    used = 0
    for r in range(height):
        row, mine = levels[r], labels[r]
        above, theirs = levels[r - 1 if r else 0], labels[r - 1 if r else 0]
        for c in range(width):
            level = row[c]
            if level == 0:
                mine[c] = 0
                continue
            left = c > 0 and row[c - 1] == level
            if r > 0 and above[c] == level:
                # left and above are already connected if the corner between them has the same level
                if left and above[c - 1] != level:
                    mine[c] = _join(parent, mine[c - 1], theirs[c])
                else:
                    mine[c] = theirs[c]
                continue
            found = 0
            if left:
                found = mine[c - 1]
            elif r > 0 and c > 0 and above[c - 1] == level:
                found = theirs[c - 1]
            if r > 0 and c + 1 < width and above[c + 1] == level:
                found = theirs[c + 1] if found == 0 else _join(parent, found, theirs[c + 1])
            if found == 0:
                used += 1
                parent[used] = used
                found = used
            mine[c] = found
    count = 0
    for k in range(1, used + 1):
        if parent[k] == k:
            count += 1
            parent[k] = -count  # a root holds its final number, negative
        else:
            root = parent[k]
            parent[k] = parent[root]  # roots come before their members
    for r in range(height):
        row = labels[r]
        for c in range(width):
            if row[c] > 0:
                row[c] = -parent[row[c]]
    return count


@njit(cache=True, nogil=True)
def measure(levels: np.ndarray, labels: np.ndarray, table: np.ndarray) -> None:
    """Box, area and level of every part; table: (n, 6) int32 left, top, right, bottom, area, level, out."""
    height, width = levels.shape
    for k in range(table.shape[0]):
        table[k, 0], table[k, 1], table[k, 2], table[k, 3] = width, height, -1, -1
        table[k, 4], table[k, 5] = 0, 0
    for r in range(height):
        c = 0
        row = labels[r]
        while c < width:
            part = row[c]
            first = c
            while c < width and row[c] == part:
                c += 1
            if part == 0:
                continue
            line = table[part - 1]
            line[0], line[2] = min(line[0], first), max(line[2], c - 1)
            line[1], line[3] = min(line[1], r), r
            line[4] += c - first
            line[5] = levels[r, first]


@njit(cache=True, nogil=True, inline="always")
def _join(parent: np.ndarray, one: int, other: int) -> int:
    """Merge two labels of a union-find forest; returns their root."""
    while parent[one] != one:
        parent[one] = parent[parent[one]]
        one = parent[one]
    while parent[other] != other:
        parent[other] = parent[parent[other]]
        other = parent[other]
    if one < other:
        parent[other] = one
        return one
    parent[one] = other
    return other


@njit(cache=True, nogil=True)
def depths_seen(
    flat: np.ndarray,
    height: np.ndarray,
    labels: np.ndarray,
    columns: np.ndarray,
    label: int,
    drop: np.ndarray,
    top_m: float,
    camera_m: float,
    px_rad: float,
    limits: tuple[float, float, float, float, float],
    out_seen: np.ndarray,
    out_most: np.ndarray,
) -> None:
    """How deep an obstacle is seen to be in each column, and how deep it can be at most.

    Args:
        flat: (h, w) horizontal range, m; NaN where unknown.
        height: (h, w) above the floor, m.
        labels: (h, w) obstacle of each pixel.
        columns: Columns of the obstacle.
        label: Its number.
        drop: (h,) tangent of the angle by which the upper border of each row looks down.
        top_m: Height of the obstacle.
        camera_m: Height of the sphere's centre.
        px_rad: Angle of a pixel.
        limits: Height error of a top; height error of a pixel of the top face; tangent of the flattest angle at
            which a surface is seen; depth beyond its front that shows a top face; greatest depth. m.
        out_seen, out_most: (columns,), horizontal range, m.
    """
    error_m, face_m, graze, shown_m, deepest_m = limits
    for k in range(columns.size):
        c = columns[k]
        top, front, far = -1, np.inf, 0.0
        for row in range(labels.shape[0]):
            if labels[row, c] == label:
                top = row if top < 0 else top
                front, far = min(front, flat[row, c]), max(far, flat[row, c])
        edge = height[top, c]
        on_face = (
            flat[top, c] - front <= shown_m
        )  # else on the top face, whose pixels have its height
        if on_face and top_m - edge < flat[top, c] * px_rad + error_m:
            edge = top_m
        last, now, faces = top, flat[top, c], 0
        most = np.inf
        for row in range(top - 1, -1, -1):
            r = flat[row, c]
            unknown = not np.isfinite(r)
            if unknown and not ((now - front > shown_m or faces >= 2) and last - row >= 2):
                continue  # it may be the obstacle, too dark
            own = not unknown and (labels[row, c] == 0 or labels[row, c] == label)
            as_high = own and height[row, c] >= edge - face_m and r <= front + deepest_m
            own = own and r <= now * (1.0 + px_rad / graze * min(last - row, 2))
            if (own or as_high) and height[row, c] <= edge + face_m:  # not yet the background
                if abs(height[row, c] - edge) <= min(face_m, (camera_m - edge) / 3.0):
                    last, now, faces = row, max(now, r), faces + 1
                continue
            if not unknown:
                most = r
            if drop[row] > 0.0:
                most = min(most, (camera_m - edge + error_m) / drop[row])
            break
        if faces >= 2:
            far = max(far, now)
        out_seen[k] = far
        out_most[k] = max(min(most, front + deepest_m), far)
