"""Sizes and constants that all kernels of the rasteriser share.

A *record* is one visible splat after projection: a cache line of 16 float32. A *block* is 4x4 pixels, held as two `Lanes`, rows
0-1 and rows 2-3, or as one `WideLanes`. With `p(d) = log - (xx dx dx + xy dx dy + yy dy dy)` a splat's alpha at offset `d` px
is `2**(8 p)`: opacity and falloff share one exponent, and an eighth of it stays in -1..0, where a short polynomial does.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

BLOCK: Final = 4
"""Edge of a block, px."""

PIXELS: Final = BLOCK * BLOCK

STATE: Final = 5 * PIXELS
"""float32 per block of its pixels: red, green, blue, alpha, depth."""

RECORD: Final = 16
"""float32 per record and per row of gradient sums."""

LANES: Final = 14
"""float32 per prepared splat: mean, largest scale, opacity, covariance (xx, xy, xz, yy, yz, zz), colour."""

GROUP: Final = 32
"""Splats that are drawn or left out together."""

NEAR: Final = 0.01
"""Smallest camera z that is drawn, m, unless told otherwise."""

# Columns of a record.
X: Final = 0  # centre, px
Y: Final = 1
XX: Final = 2  # falloff, in eighths of a power of two per px^2
XY: Final = 3
YY: Final = 4
LOG: Final = 5  # log2(opacity) / 8
RED: Final = 6
GREEN: Final = 7
BLUE: Final = 8
DEPTH: Final = 9  # camera z, m
REACH: Final = 10  # falloff at which alpha meets the cut
LEFT: Final = 11  # blocks that the splat may touch: first, and one past the last
TOP: Final = 12
RIGHT: Final = 13
BOTTOM: Final = 14
MASK: Final = 15  # blocks that the ellipse meets, as bits of a 4x4 square from LEFT, TOP; negative: the box is larger than that

SQUARE: Final = 4
"""Edge, in blocks, of the square that `MASK` covers."""

BLUR: Final = 0.3
"""Variance added on the screen, px^2: a splat is never thinner than a pixel (3D Gaussian splatting)."""

ALPHA_MAX: Final = 0.99
ALPHA_MIN: Final = 1.0 / 255.0
LIGHT_MIN: Final = 1e-4
"""A pixel is finished once less than this share of the light behind it would pass."""

CUT: Final = math.log2(ALPHA_MIN) / 8.0
SCALE: Final = math.log2(math.e) / 8.0
"""Eighths of a power of two per unit of a natural exponent."""

MARGIN: Final = 0.3
"""Beyond this share of the field of view outside the image, the projection's slope is frozen (as in gsplat)."""

TABLE: Final = np.array(
    [0.999999925, 0.693142253, 0.240172189, 0.0552797228, 0.00918861185, 0.000938788335, CUT, ALPHA_MAX, LIGHT_MIN],
    dtype=np.float32,
)
"""Constants of the blending kernels: 2**t for t in -1..0 as a polynomial, constant term first (minimax, relative error 1e-7),
then the cut in eighths of a power of two, the clip of alpha, and the light at which a pixel is finished."""

LANE_X: Final = np.array([0, 1, 2, 3, 0, 1, 2, 3], dtype=np.float32)
LANE_Y: Final = np.array([0, 0, 0, 0, 1, 1, 1, 1], dtype=np.float32)
PIXEL_X: Final = np.tile(np.arange(BLOCK, dtype=np.float32), BLOCK)
PIXEL_Y: Final = np.repeat(np.arange(BLOCK, dtype=np.float32), BLOCK)
EIGHT: Final = np.arange(8, dtype=np.float32)
