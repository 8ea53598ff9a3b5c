"""Kernels that project splats to the screen, eight at a time, and that propagate gradients back through the projection.

They use EWA splatting: the covariance of a 3D Gaussian is mapped by the Jacobian of the projection at its centre.

Source: Zwicker et al., "EWA volume splatting", 2001; Kerbl et al., "3D Gaussian splatting", 2023; for antialiasing: Yu et al.,
"Mip-Splatting", 2024, section 5.2.
"""

from __future__ import annotations

from gsbridge.kernels import Real, njit  # isort: skip  (first: it sets numba's cache folder)

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import (
    WIDTH,
    LaneValues,
    bits_between,
    exponent_and_mantissa,
    larger,
    lowest_bit,
    mask_bits,
    round_down,
    select,
    smaller,
    square_root,
)
from gsbridge.splats.rasterize.memory import at, load, put, store, store_rows, store_whole
from gsbridge.splats.rasterize.preparing import axes_of

RECORD, GROUP = layout.RECORD, layout.GROUP
BLUR = layout.BLUR
CUT = layout.CUT
SCALE = layout.SCALE
_FALLOFF_PER_SIGMA2 = 2.0 / SCALE
_BOUND = 1.002 * _FALLOFF_PER_SIGMA2  # slightly wider, against rounding errors
_FARTHEST = 1e9  # px: a splat with a larger extent is dropped, because a float32 of that size cannot resolve a pixel


@njit(error_model="numpy", forceinline=True)
def _log2(value: LaneValues) -> LaneValues:
    """Return the binary logarithm of positive lanes by a series of atanh, with an absolute error of about 1e-7."""
    exponent, mantissa = exponent_and_mantissa(value)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    t = s * s
    return exponent + s * (2.88539008 + t * (0.961796694 + t * (0.577078016 + t * (0.412198583 + t * 0.320598898))))


@njit(error_model="numpy", forceinline=True)
def row_span(
    near: LaneValues,
    tilt: LaneValues,
    level: LaneValues,
    curve: LaneValues,
    xy: LaneValues,
    scale: LaneValues,
    origin: LaneValues,
) -> tuple[LaneValues, LaneValues]:
    """Return the first block that an ellipse meets in a row of blocks, and one past the last, both before rounding down.

    Within the row of blocks, the ellipse extends furthest to the side at its tip, or, if the tip is not within the row, at the
    first or last row of pixel centres.

    Args:
        near: y of the first row of pixel centres, from the splat's centre, px.
        tilt: dy of the ellipse's right tip, px; the left tip is opposite.
        level, curve: `4 xx reach` and `4 xx yy - xy^2`, for the ellipse `xx dx dx + xy dx dy + yy dy dy = reach`.
        xy: Coefficient of `dx dy` in the ellipse's equation.
        scale: `1 / (8 xx)`, which converts half widths to blocks.
        origin: x of the splat's centre from the first pixel centre of block 0, in blocks.
    """
    far = near + 3.0
    dy = smaller(larger(tilt, near), far)
    end = origin + (square_root(larger(level - curve * dy * dy, 0.0)) - xy * dy) * scale + 1.0
    dy = smaller(larger(-tilt, near), far)
    # The last pixel centre of a block, 3 px after the first, decides; with rounding down this adds 1/4, less a small margin.
    begin = origin - (square_root(larger(level - curve * dy * dy, 0.0)) + xy * dy) * scale + 0.2475
    return begin, end


@njit(error_model="numpy", forceinline=True)
def _bits_of_row(
    near: LaneValues,
    tilt: LaneValues,
    level: LaneValues,
    curve: LaneValues,
    xy: LaneValues,
    scale: LaneValues,
    origin: LaneValues,
    wide: LaneValues,
) -> LaneValues:
    """Return the blocks that an ellipse meets in one row of blocks, as bits."""
    begin, end = row_span(near, tilt, level, curve, xy, scale, origin)
    return bits_between(smaller(larger(begin, 0.0), wide), smaller(larger(end, 0.0), wide))


@njit(error_model="numpy")
def project(
    lanes: Array,
    count: int,
    groups: Array,
    owners: Array,
    views: Array,
    near: Real,
    width: int,
    height: int,
    antialiased: bool,
    records: Array,
    sources: Array,
    depths: Array,
    boxes: Array,
    capacity: Array,
) -> int:
    """Project splats, drop those outside the view, and write a record for each of the others.

    Args:
        lanes: Output of `gsbridge.splats.rasterize.preparing.prepare`. [N * `LANES`].
        count: Number of splats.
        groups: Indices of the groups of `GROUP` splats to project. [G] int64.
        owners: Row in `views` of each of these groups. [G] int64.
        views: One row per frame of splats: fx, fy, cx, cy, then rotation (row by row) and translation of `cam_from_frame`.
            [F * 16].
        near: Smallest camera z, m.
        width, height: Size of the image, px.
        antialiased: Whether to lower a splat's opacity by the factor by which the screen blur enlarges its area.
        records: Filled with one record per visible splat, in the order of the splats. [N * RECORD].
        sources: Filled with the index of the splat of each record. [N].
        depths: Filled with the camera z of each record, m. [N].
        boxes: Filled, per record, with the first block of its box (high half) and its `MASK` (low half). [N] int64.
        capacity: The records are added to this: an upper bound of the entries in each block's list, stored as a second
            difference over rows and columns of blocks. [(rows + 1) * (columns + 1)].

    Returns:
        Number of visible splats.
    """
    fx, fy, cx, cy = views[0], views[1], views[2], views[3]
    margin_x, margin_y = np.float32(0.5 * layout.MARGIN) * width / fx, np.float32(0.5 * layout.MARGIN) * height / fy
    right, left = (width - cx) / fx + margin_x, -cx / fx - margin_x
    bottom, top = (height - cy) / fy + margin_y, -cy / fy - margin_y
    # Upper bounds of the squared length of the Jacobian's rows times the squared distance z^2.
    widest_x = fx * fx * (np.float32(1.0) + max(left * left, right * right))
    widest_y = fy * fy * (np.float32(1.0) + max(top * top, bottom * bottom))
    columns = (width + layout.BLOCK - 1) // layout.BLOCK + 1
    rows, cells = np.empty(RECORD * WIDTH, np.float32), np.empty(6 * WIDTH, np.int32)
    visible = 0
    for number in range(groups.shape[0] * (GROUP // WIDTH)):
        place = number // (GROUP // WIDTH)
        first = groups[place] * GROUP + number % (GROUP // WIDTH) * WIDTH
        if first >= count:
            continue
        view = 16 * owners[place]
        r00, r01, r02 = at(views, view + 4), at(views, view + 5), at(views, view + 6)
        r10, r11, r12 = at(views, view + 7), at(views, view + 8), at(views, view + 9)
        r20, r21, r22 = at(views, view + 10), at(views, view + 11), at(views, view + 12)
        t0, t1, t2 = at(views, view + 13), at(views, view + 14), at(views, view + 15)
        start = first * layout.LANES
        mx, my, mz = load(lanes, start), load(lanes, start + WIDTH), load(lanes, start + 2 * WIDTH)
        z = mx * r20 + my * r21 + mz * r22 + t2
        inverse = 1.0 / z
        u = (mx * r00 + my * r01 + mz * r02 + t0) * inverse
        v = (mx * r10 + my * r11 + mz * r12 + t1) * inverse
        x, y = u * fx + cx, v * fy + cy
        # Bound the extent by that of a sphere with the splat's largest scale; log2(a) <= (a - 1) / ln 2. If all eight splats
        # are outside, as most of a scene is, nothing more is computed for them.
        widest, opacity = load(lanes, start + 3 * WIDTH) * inverse, load(lanes, start + 4 * WIDTH)
        room = (larger(opacity - 1.0, 0.0) * 0.181 - CUT) * _BOUND
        aside, above = larger(larger(-x, x - width), 0.0), larger(larger(-y, y - height), 0.0)
        inside = aside * aside <= room * (widest * widest * widest_x + BLUR)
        inside = inside & (above * above <= room * (widest * widest * widest_y + BLUR)) & (z >= near)
        if mask_bits(inside) == 0:
            continue

        ju, jv = inverse * fx, inverse * fy
        su, sv = ju * smaller(larger(u, left), right), jv * smaller(larger(v, top), bottom)
        a0, a1, a2 = ju * r00 - su * r20, ju * r01 - su * r21, ju * r02 - su * r22
        b0, b1, b2 = jv * r10 - sv * r20, jv * r11 - sv * r21, jv * r12 - sv * r22
        xx, xy, xz = load(lanes, start + 5 * WIDTH), load(lanes, start + 6 * WIDTH), load(lanes, start + 7 * WIDTH)
        yy, yz, zz = load(lanes, start + 8 * WIDTH), load(lanes, start + 9 * WIDTH), load(lanes, start + 10 * WIDTH)
        u0, u1, u2 = a0 * xx + a1 * xy + a2 * xz, a0 * xy + a1 * yy + a2 * yz, a0 * xz + a1 * yz + a2 * zz
        cxx = a0 * u0 + a1 * u1 + a2 * u2 + BLUR
        cxy = b0 * u0 + b1 * u1 + b2 * u2
        u0, u1, u2 = b0 * xx + b1 * xy + b2 * xz, b0 * xy + b1 * yy + b2 * yz, b0 * xz + b1 * yz + b2 * zz
        cyy = b0 * u0 + b1 * u1 + b2 * u2 + BLUR
        factor = SCALE / (cxx * cyy - cxy * cxy)

        if antialiased:
            own = larger((cxx - BLUR) * (cyy - BLUR) - cxy * cxy, 0.0)
            opacity = opacity * square_root(own * factor * (1.0 / SCALE))
        log = _log2(larger(opacity, 1e-6)) * 0.125
        reach = log - CUT
        half_x = square_root(reach * cxx * _FALLOFF_PER_SIGMA2)
        half_y = square_root(reach * cyy * _FALLOFF_PER_SIGMA2)
        # Pixels whose centres are in the ellipse's box, 0.001 px wider against rounding errors; ceil(v) = -floor(-v).
        x0, x1 = larger(-round_down(half_x - x + 0.499), 0.0), smaller(round_down(x + half_x - 0.499), width - 1.0)
        y0, y1 = larger(-round_down(half_y - y + 0.499), 0.0), smaller(round_down(y + half_y - 0.499), height - 1.0)
        red, green = load(lanes, start + 11 * WIDTH), load(lanes, start + 12 * WIDTH)
        blue = load(lanes, start + 13 * WIDTH)
        # Comparisons with NaN are false, and 0 * inf is NaN, so a splat with a value that is not finite is dropped here.
        seen = (x0 <= x1) & (y0 <= y1) & (z >= near) & (reach > 0.0) & (half_x < _FARTHEST) & (half_y < _FARTHEST)
        seen = seen & ((red + green + blue + x + y + z) * 0.0 >= 0.0) & (factor > 0.0) & (opacity < 1e6)
        bits = mask_bits(seen)
        if bits == 0:
            continue

        block_left, block_top = round_down(x0 * 0.25), round_down(y0 * 0.25)
        block_right, block_bottom = round_down(x1 * 0.25) + 1.0, round_down(y1 * 0.25) + 1.0
        xx, xy, yy = cyy * factor * 0.5, -(cxy * factor), cxx * factor * 0.5
        # The reach is enlarged by a thousandth against rounding errors; spans are counted from the left block.
        tilt, level, curve, scale = cxy / cxx * half_x, 4.004 * xx * reach, 4.0 * xx * yy - xy * xy, 0.125 / xx
        origin, wide, high = (x - 0.5) * 0.25 - block_left, smaller(block_right - block_left, 4.0), block_bottom - block_top
        above = block_top * 4.0 + 0.5 - y
        mask = _bits_of_row(above, tilt, level, curve, xy, scale, origin, wide)
        # Most splats are at most two rows of blocks high, and neighbouring splats are similar, so these branches save time.
        if mask_bits(seen & (high > 1.0)) != 0:
            second = _bits_of_row(above + 4.0, tilt, level, curve, xy, scale, origin, wide)
            mask = mask + select(high > 1.0, second, 0.0) * 16.0
        if mask_bits(seen & (high > 2.0)) != 0:
            third = _bits_of_row(above + 8.0, tilt, level, curve, xy, scale, origin, wide)
            fourth = _bits_of_row(above + 12.0, tilt, level, curve, xy, scale, origin, wide)
            mask = mask + select(high > 2.0, third, 0.0) * 256.0 + select(high > 3.0, fourth, 0.0) * 4096.0
        mask = select((block_right - block_left <= 4.0) & (high <= 4.0), mask, -1.0)
        store_rows(rows, 0, RECORD, x, y, xx, xy, yy, log, red, green)
        store_rows(rows, 8, RECORD, blue, z, reach, block_left, block_top, block_right, block_bottom, mask)
        # Integers below 2**24 are exact in float32.
        store_whole(cells, 0, block_top * columns + block_left)
        store_whole(cells, 8, block_top * columns + block_right)
        store_whole(cells, 16, block_bottom * columns + block_left)
        store_whole(cells, 24, block_bottom * columns + block_right)
        store_whole(cells, 32, block_top * (columns - 1.0) + block_left)
        store_whole(cells, 40, mask)
        while bits:
            lane = lowest_bit(bits)
            bits &= bits - 1
            base = visible * RECORD
            store(records, base, load(rows, lane * RECORD))
            store(records, base + 8, load(rows, lane * RECORD + 8))
            put(sources, visible, first + lane)
            put(depths, visible, at(rows, lane * RECORD + layout.DEPTH))
            put(boxes, visible, (np.int64(at(cells, 32 + lane)) << 32) | np.int64(np.uint32(at(cells, 40 + lane))))
            visible += 1
            corner = at(cells, lane)
            put(capacity, corner, at(capacity, corner) + 1)
            corner = at(cells, 8 + lane)
            put(capacity, corner, at(capacity, corner) - 1)
            corner = at(cells, 16 + lane)
            put(capacity, corner, at(capacity, corner) - 1)
            corner = at(cells, 24 + lane)
            put(capacity, corner, at(capacity, corner) + 1)
    return visible


@njit(error_model="numpy")
def project_backward(
    means: Array,
    quats: Array,
    scales: Array,
    opacities: Array,
    view: Array,
    width: int,
    height: int,
    records: Array,
    sources: Array,
    visible: int,
    sums: Array,
    g_means: Array,
    g_quats: Array,
    g_scales: Array,
    g_opacities: Array,
    g_colours: Array,
) -> None:
    """Compute the gradients of the splats from the sums over their pixels.

    Args:
        means, quats, scales, opacities: As in `gsbridge.splats.rasterize.preparing.prepare`. [N * 3], [N * 4], [N * 3], [N].
        view: fx, fy, cx, cy, then the rotation and the translation `cam_from_table`. [16].
        width, height: As in `project`.
        records, sources, visible: Output of `project`. [N * RECORD], [N].
        sums: For each record, sums over its pixels: with `g = alpha * dL/dalpha`, those of g, g dx, g dy, g dx dx, g dx dy and
            g dy dy, then the gradients of red, green, blue and depth. [N * RECORD].
        g_means, g_quats, g_scales, g_opacities, g_colours: Filled for the visible splats; must be zero on entry.
            [N * 3], [N * 4], [N * 3], [N], [N * 3].
    """
    fx, fy, cx, cy = view[0], view[1], view[2], view[3]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = (
        view[4],
        view[5],
        view[6],
        view[7],
        view[8],
        view[9],
        view[10],
        view[11],
        view[12],
    )
    t0, t1, t2 = view[13], view[14], view[15]
    margin_x, margin_y = np.float32(0.5 * layout.MARGIN) * width / fx, np.float32(0.5 * layout.MARGIN) * height / fy
    right, left = (width - cx) / fx + margin_x, -cx / fx - margin_x
    bottom, top = (height - cy) / fy + margin_y, -cy / fy - margin_y
    gathered = np.zeros(24 * WIDTH, np.float32)
    for start in range(0, visible, WIDTH):
        lanes = min(WIDTH, visible - start)
        for lane in range(lanes):
            source, base = np.int64(at(sources, start + lane)), (start + lane) * RECORD
            for k in range(3):
                put(gathered, k * WIDTH + lane, at(means, 3 * source + k))
                put(gathered, (7 + k) * WIDTH + lane, at(scales, 3 * source + k))
                put(gathered, (18 + k) * WIDTH + lane, at(records, base + layout.XX + k))
                put(g_colours, 3 * source + k, at(sums, base + 6 + k))
            for k in range(4):
                put(gathered, (3 + k) * WIDTH + lane, at(quats, 4 * source + k))
            for k in range(6):
                put(gathered, (11 + k) * WIDTH + lane, at(sums, base + k))
            put(gathered, 10 * WIDTH + lane, at(opacities, source))
            put(gathered, 17 * WIDTH + lane, at(sums, base + 9))
        mx, my, mz = load(gathered, 0), load(gathered, 8), load(gathered, 16)
        x, y = mx * r00 + my * r01 + mz * r02 + t0, mx * r10 + my * r11 + mz * r12 + t1
        inverse = 1.0 / (mx * r20 + my * r21 + mz * r22 + t2)
        u, v = x * inverse, y * inverse
        uc, vc = smaller(larger(u, left), right), smaller(larger(v, top), bottom)
        ju, jv = inverse * fx, inverse * fy
        su, sv = ju * uc, jv * vc
        a0, a1, a2 = ju * r00 - su * r20, ju * r01 - su * r21, ju * r02 - su * r22
        b0, b1, b2 = jv * r10 - sv * r20, jv * r11 - sv * r21, jv * r12 - sv * r22
        qw, qx, qy, qz = load(gathered, 24), load(gathered, 32), load(gathered, 40), load(gathered, 48)
        norm = 1.0 / square_root(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw * norm, qx * norm, qy * norm, qz * norm
        m00, m01, m02, m10, m11, m12, m20, m21, m22 = axes_of(qw, qx, qy, qz)
        s0, s1, s2 = load(gathered, 56), load(gathered, 64), load(gathered, 72)
        u00, u01, u02 = a0 * m00 + a1 * m10 + a2 * m20, a0 * m01 + a1 * m11 + a2 * m21, a0 * m02 + a1 * m12 + a2 * m22
        u10, u11, u12 = b0 * m00 + b1 * m10 + b2 * m20, b0 * m01 + b1 * m11 + b2 * m21, b0 * m02 + b1 * m12 + b2 * m22

        # Gradient through the falloff q = (A dx dx + 2 B dx dy + C dy dy) / 2 with the inverse covariance Q = (A B; B C).
        unit = 1.0 / SCALE
        ca, cb, cc = load(gathered, 144) * (2.0 * unit), load(gathered, 152) * unit, load(gathered, 160) * (2.0 * unit)
        g, gx, gy = load(gathered, 88), load(gathered, 96), load(gathered, 104)
        gxx, gxy, gyy = load(gathered, 112) * 0.5, load(gathered, 120) * 0.5, load(gathered, 128) * 0.5
        dx, dy = ca * gx + cb * gy, cb * gx + cc * gy
        # dL/dcov = Q S Q with S, half the second moments; the signs of the falloff and of the inverse's derivative cancel.
        h00, h01 = ca * gxx + cb * gxy, ca * gxy + cb * gyy
        h10, h11 = cb * gxx + cc * gxy, cb * gxy + cc * gyy
        k00, k01, k11 = h00 * ca + h01 * cb, h00 * cb + h01 * cc, h10 * cb + h11 * cc

        # cov = V V^T + blur, V = U diag(s), U = (a; b) M.
        v00, v01, v02, v10, v11, v12 = u00 * s0, u01 * s1, u02 * s2, u10 * s0, u11 * s1, u12 * s2
        d00, d10 = 2.0 * (k00 * v00 + k01 * v10), 2.0 * (k01 * v00 + k11 * v10)
        d01, d11 = 2.0 * (k00 * v01 + k01 * v11), 2.0 * (k01 * v01 + k11 * v11)
        d02, d12 = 2.0 * (k00 * v02 + k01 * v12), 2.0 * (k01 * v02 + k11 * v12)
        gs0, gs1, gs2 = d00 * u00 + d10 * u10, d01 * u01 + d11 * u11, d02 * u02 + d12 * u12
        d00, d01, d02, d10, d11, d12 = d00 * s0, d01 * s1, d02 * s2, d10 * s0, d11 * s1, d12 * s2
        n00, n01, n02 = a0 * d00 + b0 * d10, a0 * d01 + b0 * d11, a0 * d02 + b0 * d12
        n10, n11, n12 = a1 * d00 + b1 * d10, a1 * d01 + b1 * d11, a1 * d02 + b1 * d12
        n20, n21, n22 = a2 * d00 + b2 * d10, a2 * d01 + b2 * d11, a2 * d02 + b2 * d12
        gw = 2.0 * (qx * (n21 - n12) + qy * (n02 - n20) + qz * (n10 - n01))
        gqx = 2.0 * (qy * (n01 + n10) + qz * (n02 + n20) + qw * (n21 - n12) - 2.0 * qx * (n11 + n22))
        gqy = 2.0 * (qx * (n01 + n10) + qz * (n12 + n21) + qw * (n02 - n20) - 2.0 * qy * (n00 + n22))
        gqz = 2.0 * (qx * (n02 + n20) + qy * (n12 + n21) + qw * (n10 - n01) - 2.0 * qz * (n00 + n11))
        along = gw * qw + gqx * qx + gqy * qy + gqz * qz

        # Gradient through the Jacobian of the projection, and through the centre.
        ga0, ga1, ga2 = d00 * m00 + d01 * m01 + d02 * m02, d00 * m10 + d01 * m11 + d02 * m12, d00 * m20 + d01 * m21 + d02 * m22
        gb0, gb1, gb2 = d10 * m00 + d11 * m01 + d12 * m02, d10 * m10 + d11 * m11 + d12 * m12, d10 * m20 + d11 * m21 + d12 * m22
        gju, gsu = ga0 * r00 + ga1 * r01 + ga2 * r02, -(ga0 * r20 + ga1 * r21 + ga2 * r22)
        gjv, gsv = gb0 * r10 + gb1 * r11 + gb2 * r12, -(gb0 * r20 + gb1 * r21 + gb2 * r22)
        gju, gjv = gju + gsu * uc, gjv + gsv * vc
        gu = dx * fx + select((u >= left) & (u <= right), gsu * ju, 0.0)
        gv = dy * fy + select((v >= top) & (v <= bottom), gsv * jv, 0.0)
        g_inverse = gju * fx + gjv * fy + gu * x + gv * y
        gcx, gcy, gcz = gu * inverse, gv * inverse, load(gathered, 136) - g_inverse * inverse * inverse

        store(gathered, 0, gcx * r00 + gcy * r10 + gcz * r20)
        store(gathered, 8, gcx * r01 + gcy * r11 + gcz * r21)
        store(gathered, 16, gcx * r02 + gcy * r12 + gcz * r22)
        store(gathered, 24, (gw - along * qw) * norm)
        store(gathered, 32, (gqx - along * qx) * norm)
        store(gathered, 40, (gqy - along * qy) * norm)
        store(gathered, 48, (gqz - along * qz) * norm)
        store(gathered, 56, gs0)
        store(gathered, 64, gs1)
        store(gathered, 72, gs2)
        store(gathered, 80, g / load(gathered, 80))
        for lane in range(lanes):
            source = np.int64(at(sources, start + lane))
            for k in range(3):
                put(g_means, 3 * source + k, at(gathered, k * WIDTH + lane))
                put(g_scales, 3 * source + k, at(gathered, (7 + k) * WIDTH + lane))
            for k in range(4):
                put(g_quats, 4 * source + k, at(gathered, (3 + k) * WIDTH + lane))
            put(g_opacities, source, at(gathered, 10 * WIDTH + lane))
