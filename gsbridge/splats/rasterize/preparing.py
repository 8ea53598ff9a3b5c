"""The kernel that converts splats to the input of their projection, once per scene or once per step of training."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import WIDTH, LaneValues, larger, square_root
from gsbridge.splats.rasterize.memory import load, load_quads, load_triples, store


@njit(error_model="numpy", forceinline=True)
def axes_of(w: LaneValues, x: LaneValues, y: LaneValues, z: LaneValues) -> tuple[LaneValues, ...]:
    """Return the rotation matrix of a unit quaternion, row by row.

    Args:
        w, x, y, z: Components of the quaternion; `Lanes` each, for eight quaternions at once.

    Returns:
        The nine elements of the matrix, `Lanes` each.
    """
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@njit(error_model="numpy")
def prepare(means: Array, quats: Array, scales: Array, opacities: Array, colours: Array, lanes: Array) -> None:
    """Compute the covariances of splats and store all that `project` reads, interleaved for eight splats at a time.

    Args:
        means, quats, scales, opacities, colours: Flat arrays of splats, m; N is a multiple of eight. [N * 3], [N * 4],
            [N * 3], [N], [N * 3].
        lanes: Output. [N * `LANES`].
    """
    for number in range(opacities.shape[0] // WIDTH):
        first, base = number * WIDTH, number * layout.LANES * WIDTH
        qw, qx, qy, qz = load_quads(quats, 4 * first)
        norm = 1.0 / square_root(qw * qw + qx * qx + qy * qy + qz * qz)
        m00, m01, m02, m10, m11, m12, m20, m21, m22 = axes_of(qw * norm, qx * norm, qy * norm, qz * norm)
        s0, s1, s2 = load_triples(scales, 3 * first)
        m00, m01, m02 = m00 * s0, m01 * s1, m02 * s2
        m10, m11, m12 = m10 * s0, m11 * s1, m12 * s2
        m20, m21, m22 = m20 * s0, m21 * s1, m22 * s2
        mx, my, mz = load_triples(means, 3 * first)
        store(lanes, base, mx)
        store(lanes, base + WIDTH, my)
        store(lanes, base + 2 * WIDTH, mz)
        store(lanes, base + 3 * WIDTH, larger(larger(s0, s1), s2))
        store(lanes, base + 4 * WIDTH, load(opacities, first))
        store(lanes, base + 5 * WIDTH, m00 * m00 + m01 * m01 + m02 * m02)
        store(lanes, base + 6 * WIDTH, m00 * m10 + m01 * m11 + m02 * m12)
        store(lanes, base + 7 * WIDTH, m00 * m20 + m01 * m21 + m02 * m22)
        store(lanes, base + 8 * WIDTH, m10 * m10 + m11 * m11 + m12 * m12)
        store(lanes, base + 9 * WIDTH, m10 * m20 + m11 * m21 + m12 * m22)
        store(lanes, base + 10 * WIDTH, m20 * m20 + m21 * m21 + m22 * m22)
        red, green, blue = load_triples(colours, 3 * first)
        store(lanes, base + 11 * WIDTH, red)
        store(lanes, base + 12 * WIDTH, green)
        store(lanes, base + 13 * WIDTH, blue)
