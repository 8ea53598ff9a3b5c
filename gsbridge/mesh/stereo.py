"""Multi-view depth of one photo: a plane sweep from the hull inwards, refined by PatchMatch. Compiled kernels.

Every lattice pixel holds a small plane (depth and normal). The plane maps the photo's patch into each source photo; its score
is the mean of the two best correlations between the patches. Only the best two count, because the other sources may not see
the place.

Source: Bleyer, Rhemann, Rother, BMVC 2011 (slanted planes, spatial propagation); Schoenberger et al., ECCV 2016.
"""

from __future__ import annotations

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import Real, njit

_WORST = -1.0
_MIN_COSINE = 0.15
"""Planes seen flatter than this (about 81 degrees) are not tried: their patches shrink to a line."""


# No fastmath: each compilation may order the sums differently, and the mesh would depend on the state of the kernels' cache.
@njit(nogil=True)
def _score(
    patch: Array,
    count: int,
    mean: float,
    spread: float,
    reach: Real,
    u0: float,
    v0: float,
    images: Array,
    maps: Array,
    shifts: Array,
    nx: float,
    ny: float,
    nz: float,
    offset: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
) -> Real:
    """Mean of the two best correlations of a patch under the plane `n . x = offset` (camera frame).

    `patch` [3, N] holds x and y from the patch's centre (`u0`, `v0`) and the grey value. Over so few pixels an affine map is as
    good as the plane's homography, and saves a division per sample.
    """
    views, height, width = images.shape
    first = np.float32(_WORST)
    second = np.float32(_WORST)
    # Row vector n^T K^-1 / offset of the plane's homography.
    qx = nx / (fx * offset)
    qy = ny / (fy * offset)
    qz = (nz - nx * cx / fx - ny * cy / fy) / offset
    for s in range(views):
        a = maps[s]
        b = shifts[s]
        h20 = a[2, 0] + b[2] * qx
        h21 = a[2, 1] + b[2] * qy
        w = h20 * u0 + h21 * v0 + a[2, 2] + b[2] * qz
        if w <= 1e-9:
            continue
        h00 = a[0, 0] + b[0] * qx
        h01 = a[0, 1] + b[0] * qy
        h10 = a[1, 0] + b[1] * qx
        h11 = a[1, 1] + b[1] * qy
        inverse = 1.0 / w
        u = (h00 * u0 + h01 * v0 + a[0, 2] + b[0] * qz) * inverse
        v = (h10 * u0 + h11 * v0 + a[1, 2] + b[1] * qz) * inverse
        j00 = np.float32((h00 - u * h20) * inverse)
        j01 = np.float32((h01 - u * h21) * inverse)
        j10 = np.float32((h10 - v * h20) * inverse)
        j11 = np.float32((h11 - v * h21) * inverse)
        wide = reach * (abs(j00) + abs(j01)) + 1.0
        tall = reach * (abs(j10) + abs(j11)) + 1.0
        if u < wide or v < tall or u >= width - wide - 1 or v >= height - tall - 1 or max(wide, tall) > 8 * reach:
            continue
        image = images[s]
        bu = np.float32(u - 0.5)
        bv = np.float32(v - 0.5)
        total = np.float32(0.0)
        squares = np.float32(0.0)
        cross = np.float32(0.0)
        for i in range(count):
            x = bu + j00 * patch[0, i] + j01 * patch[1, i]
            y = bv + j10 * patch[0, i] + j11 * patch[1, i]
            c = np.uint32(x)
            r = np.uint32(y)
            fu = x - np.float32(c)
            fv = y - np.float32(r)
            upper = image[r, c] + fu * (image[r, c + np.uint32(1)] - image[r, c])
            r1 = r + np.uint32(1)
            lower = image[r1, c] + fu * (image[r1, c + np.uint32(1)] - image[r1, c])
            g = upper + fv * (lower - upper)
            total += g
            squares += g * g
            cross += g * patch[2, i]
        mean_other = total / count
        other = squares / count - mean_other * mean_other
        if other < 1e-6:
            continue
        value = np.float32((cross / count - mean * mean_other) / math.sqrt(other * spread))
        if value > first:
            second = first
            first = value
        elif value > second:
            second = value
    return np.float32(0.5) * (first + second)


@njit(nogil=True)
def patch_match(
    photo: Array,
    mask: Array,
    images: Array,
    maps: Array,
    shifts: Array,
    intrinsics: Array,
    near: Array,
    far: Array,
    normals: Array,
    window: int,
    stride: int,
    hypotheses: int,
    passes: int,
    texture: float,
    seed: int,
) -> tuple[Array, Array, Array]:
    """Depth, normal and score of the lattice pixels of one photo.

    Args:
        photo: Grey photo, 0..1. [H, W] float32.
        mask: Pixels that belong to the surface. [H, W] bool.
        images: Grey source photos. [S, H', W'] float32.
        maps, shifts: Homographies from photo to source pixels at infinite depth; shift per inverse depth. [S, 3, 3], [S, 3].
        intrinsics: fx, fy, cx, cy of the photo, px. [4].
        near, far: Depth range per lattice pixel, m; `near` is not finite where there is nothing to find. [h, w] float32.
        normals: First guess of the normals, camera frame. [h, w, 3] float32.
        window: Patch radius, px.
        stride: Lattice step, px: lattice pixel (i, j) is photo pixel (i * stride + stride // 2, ...).
        hypotheses: Depths tried in the first pass.
        passes: Passes over the lattice, alternately forwards and backwards.
        texture: Least standard deviation of a patch.
        seed: Random seed.

    Returns:
        depth [h, w] (0 where nothing was found), normal [h, w, 3], score [h, w].
    """
    np.random.seed(seed)
    height, width = photo.shape
    rows, columns = near.shape
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    depth = np.zeros((rows, columns), np.float32)
    normal = normals.copy()
    score = np.full((rows, columns), np.float32(_WORST))
    side = (2 * (window // 2) + 1) ** 2
    patch = np.empty((3, side), np.float32)
    reach = np.float32(window)
    for number in range(passes):
        forwards = number % 2 == 0
        wobble = 0.5 ** (number + 1)
        for line in range(rows):
            i = line if forwards else rows - 1 - line
            for place in range(columns):
                j = place if forwards else columns - 1 - place
                if not math.isfinite(near[i, j]):
                    continue
                y0 = i * stride + stride // 2
                x0 = j * stride + stride // 2
                count = 0
                mean = 0.0
                squares = 0.0
                for dy in range(-(window // 2) * 2, window + 1, 2):
                    for dx in range(-(window // 2) * 2, window + 1, 2):
                        y = y0 + dy
                        x = x0 + dx
                        if y < 0 or x < 0 or y >= height or x >= width or not mask[y, x]:
                            continue
                        patch[0, count] = dx
                        patch[1, count] = dy
                        patch[2, count] = photo[y, x]
                        mean += photo[y, x]
                        squares += photo[y, x] ** 2
                        count += 1
                if count < side // 2:
                    continue
                mean /= count
                spread = squares / count - mean * mean
                if spread < texture * texture:
                    continue
                u0 = x0 + 0.5
                v0 = y0 + 0.5
                rx = (x0 + 0.5 - cx) / fx
                ry = (y0 + 0.5 - cy) / fy
                low = near[i, j]
                high = far[i, j]
                best = score[i, j]
                d = depth[i, j]
                n0, n1, n2 = normal[i, j, 0], normal[i, j, 1], normal[i, j, 2]
                if number == 0:
                    step = (high - low) / hypotheses
                    for k in range(hypotheses):
                        z = low + (k + np.random.random()) * step
                        offset = z * (n0 * rx + n1 * ry + n2)
                        value = _score(
                            patch, count, mean, spread, reach, u0, v0, images, maps, shifts, n0, n1, n2, offset, fx, fy, cx, cy
                        )
                        if value > best:
                            best, d = value, z
                # Try the planes of neighbours that this pass has visited already, extended to this pixel.
                back = -1 if forwards else 1
                for k in range(4):
                    hop = 1 if k < 2 else 4
                    a = i + back * hop if k % 2 == 0 else i
                    b = j + back * hop if k % 2 == 1 else j
                    if a < 0 or b < 0 or a >= rows or b >= columns or depth[a, b] <= 0:
                        continue
                    m0, m1, m2 = normal[a, b, 0], normal[a, b, 1], normal[a, b, 2]
                    ax = (b * stride + stride // 2 + 0.5 - cx) / fx
                    ay = (a * stride + stride // 2 + 0.5 - cy) / fy
                    facing = m0 * rx + m1 * ry + m2
                    if facing > -_MIN_COSINE:
                        continue
                    offset = depth[a, b] * (m0 * ax + m1 * ay + m2)
                    z = offset / facing
                    if z < low or z > high:
                        continue
                    value = _score(
                        patch, count, mean, spread, reach, u0, v0, images, maps, shifts, m0, m1, m2, offset, fx, fy, cx, cy
                    )
                    if value > best:
                        best, d, n0, n1, n2 = value, z, m0, m1, m2
                if d <= 0:
                    continue
                for k in range(4):
                    z = d
                    m0, m1, m2 = n0, n1, n2
                    if k != 1:
                        z = d + (2 * np.random.random() - 1) * wobble * (high - low) * (0.3 if k < 3 else 0.05)
                    if k != 0:
                        m0 += (2 * np.random.random() - 1) * wobble
                        m1 += (2 * np.random.random() - 1) * wobble
                        m2 += (2 * np.random.random() - 1) * wobble
                        length = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
                        m0, m1, m2 = m0 / length, m1 / length, m2 / length
                    facing = m0 * rx + m1 * ry + m2
                    if z < low or z > high or facing > -_MIN_COSINE * math.sqrt(rx * rx + ry * ry + 1):
                        continue
                    offset = z * facing
                    value = _score(
                        patch, count, mean, spread, reach, u0, v0, images, maps, shifts, m0, m1, m2, offset, fx, fy, cx, cy
                    )
                    if value > best:
                        best, d, n0, n1, n2 = value, z, m0, m1, m2
                depth[i, j] = d
                score[i, j] = best
                normal[i, j, 0], normal[i, j, 1], normal[i, j, 2] = n0, n1, n2
    return depth, normal, score


@njit(nogil=True)
def confirm(
    points: Array, depth: Array, others: Array, poses: Array, intrinsics: Array, strides: int, tolerance: float, least: int
) -> tuple[Array, Array]:
    """Average each point with those of other depth maps that agree with it.

    Args:
        points: Points of the lattice pixels, table frame, m. [h, w, 3].
        depth: Depths of these pixels, m; 0 for none. [h, w].
        others: Depth maps of the other views, m; 0 for none. [V, h', w'] float32.
        poses: `cam_from_table` of the other views. [V, 4, 4].
        intrinsics: fx, fy, cx, cy of the other views' photos, px. [V, 4].
        strides: Lattice step of the depth maps, px.
        tolerance: Largest difference of depth, as a share of the depth.
        least: Number of other views that must agree.

    Returns:
        The averaged points [h, w, 3] and the number of agreeing views [h, w] (0 where fewer than `least`).
    """
    rows, columns = depth.shape
    out = np.zeros_like(points)
    agree = np.zeros((rows, columns), np.int32)
    for i in range(rows):
        for j in range(columns):
            if depth[i, j] <= 0:
                continue
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            sx, sy, sz = x, y, z
            count = 0
            for v in range(others.shape[0]):
                p = poses[v]
                cz = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                if cz <= 1e-6:
                    continue
                cx = p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]
                cy = p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]
                k = intrinsics[v]
                u = int(math.floor((k[0] * cx / cz + k[2] - strides // 2 - 0.5) / strides + 0.5))
                w = int(math.floor((k[1] * cy / cz + k[3] - strides // 2 - 0.5) / strides + 0.5))
                if u < 0 or w < 0 or u >= others.shape[2] or w >= others.shape[1]:
                    continue
                other = others[v, w, u]
                if other <= 0 or abs(other - cz) > tolerance * cz:
                    continue
                # The other map's point is its own depth along the same pixel's line of sight.
                t = other / cz
                ox, oy, oz = cx * t - p[0, 3], cy * t - p[1, 3], other - p[2, 3]
                sx += p[0, 0] * ox + p[1, 0] * oy + p[2, 0] * oz
                sy += p[0, 1] * ox + p[1, 1] * oy + p[2, 1] * oz
                sz += p[0, 2] * ox + p[1, 2] * oy + p[2, 2] * oz
                count += 1
            if count >= least:
                agree[i, j] = count
                out[i, j, 0], out[i, j, 1], out[i, j, 2] = sx / (count + 1), sy / (count + 1), sz / (count + 1)
    return out, agree
