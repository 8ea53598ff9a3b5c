"""Sizes and constants that all kernels of the rasteriser share.

A *record* is one visible splat after projection: a cache line of 16 float32. A *block* is 4x4 pixels, held as two `Lanes`, rows
0-1 and rows 2-3, or as one `WideLanes`. With `p(d) = log - (xx dx dx + xy dx dy + yy dy dy)`, a splat's alpha at an offset of
`d` px is `2**(8 p)`. Opacity and falloff share one exponent; an eighth of it is in -1..0, where a short polynomial suffices.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

BLOCK: Final = 4
"""Edge of a block, px."""

PIXELS: Final = BLOCK * BLOCK

STATE: Final = 5 * PIXELS
"""Number of float32 per block: red, green, blue, alpha and depth of its pixels."""

RECORD: Final = 16
"""Number of float32 per record and per row of gradient sums."""

LANES: Final = 14
"""Number of float32 per prepared splat: mean, largest scale, opacity, covariance (xx, xy, xz, yy, yz, zz), colour."""

GROUP: Final = 32
"""Number of splats that are drawn or left out together."""

NEAR: Final = 0.01
"""Smallest camera z that is drawn by default, m."""

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
"""Variance added on the screen, px^2, so that a splat is never much thinner than a pixel (as in 3D Gaussian splatting)."""

ALPHA_MAX: Final = 0.99
ALPHA_MIN: Final = 1.0 / 255.0
LIGHT_MIN: Final = 1e-4
"""Transmittance below which a pixel is finished."""

CUT: Final = math.log2(ALPHA_MIN) / 8.0
SCALE: Final = math.log2(math.e) / 8.0
"""Factor from a natural exponent to an eighth of a binary exponent."""

MARGIN: Final = 0.3
"""Margin around the image, as a share of half its width and height, beyond which the projection's Jacobian no longer changes
(as in gsplat)."""

TABLE: Final = np.array(
    [0.999999925, 0.693142253, 0.240172189, 0.0552797228, 0.00918861185, 0.000938788335, CUT, ALPHA_MAX, LIGHT_MIN],
    dtype=np.float32,
)
"""Constants of the blending kernels: the coefficients of a polynomial for 2**t with t in -1..0, constant term first (minimax,
relative error 1e-7), then `CUT`, `ALPHA_MAX` and `LIGHT_MIN`."""

LANE_X: Final = np.array([0, 1, 2, 3, 0, 1, 2, 3], dtype=np.float32)
LANE_Y: Final = np.array([0, 0, 0, 0, 1, 1, 1, 1], dtype=np.float32)
PIXEL_X: Final = np.tile(np.arange(BLOCK, dtype=np.float32), BLOCK)
PIXEL_Y: Final = np.repeat(np.arange(BLOCK, dtype=np.float32), BLOCK)
EIGHT: Final = np.arange(8, dtype=np.float32)
