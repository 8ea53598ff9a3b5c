"""Arrays for rendering on the CPU, which are reused from one rendering to the next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize.lanes import WIDTH
from gsbridge.splats.rasterize.layout import RECORD, STATE

_KEYS = 2 * 4096


@dataclass
class Workspace:
    """Arrays of one rendering. They grow when needed. Two renderings that may still need gradients never share them."""

    records: Array = field(default_factory=lambda: np.empty(0, np.float32))
    sources: Array = field(default_factory=lambda: np.empty(0, np.int32))
    depths: Array = field(default_factory=lambda: np.empty(0, np.float32))
    order: Array = field(default_factory=lambda: np.empty(0, np.int32))
    pairs: Array = field(default_factory=lambda: np.empty(0, np.int64))
    more_pairs: Array = field(default_factory=lambda: np.empty(0, np.int64))
    boxes: Array = field(default_factory=lambda: np.empty(0, np.int64))
    counts: Array = field(default_factory=lambda: np.empty(_KEYS, np.int32))
    capacity: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    running: Array = field(default_factory=lambda: np.empty(0, np.int32))
    starts: Array = field(default_factory=lambda: np.empty(0, np.int32))
    ends: Array = field(default_factory=lambda: np.empty(0, np.int32))
    entries: Array = field(default_factory=lambda: np.empty(0, np.int32))
    states: Array = field(default_factory=lambda: np.empty(0, np.float32))
    targets: Array = field(default_factory=lambda: np.empty(0, np.int32))
    owners: Array = field(default_factory=lambda: np.empty(0, np.int32))
    first_band: Array = field(default_factory=lambda: np.empty(0, np.int32))
    sums: Array = field(default_factory=lambda: np.empty(0, np.float32))

    def fit(self, splats: int, rows: int, columns: int) -> None:
        """Make room for a number of splats and blocks.

        Args:
            splats, rows, columns: Number of splats that may become visible; numbers of rows and columns of blocks in the image.
        """
        if len(self.sources) < splats:
            size = splats + splats // 8 + WIDTH
            self.records = aligned(size * RECORD)
            self.depths = np.empty(size, np.float32)
            self.sources, self.order = np.empty(size, np.int32), np.empty(size, np.int32)
            self.pairs, self.more_pairs, self.boxes = (np.empty(size, np.int64) for _ in range(3))
        if len(self.capacity) != (rows + 1) * (columns + 1) or len(self.running) != columns + 1:
            self.capacity = np.zeros((rows + 1) * (columns + 1), np.int32)
            self.running = np.empty(columns + 1, np.int32)
            self.states = aligned(rows * columns * STATE)
            # One extra row of blocks: `binning.fill` also touches the blocks to the right and below, needed or not.
            self.starts, self.ends = (np.empty((rows + 1) * columns + 1, np.int32) for _ in range(2))

    def fit_entries(self, entries: int) -> None:
        """Make room for a number of entries in the lists.

        Raises:
            ValueError: The number exceeds an int32.
        """
        if entries >= 2**31:
            raise ValueError("the splats cover the image too many times over; are their scales in metres?")
        if len(self.entries) < entries + 1:
            self.entries = np.empty(entries + entries // 4 + 1, np.int32)

    def fit_bands(self, visible: int) -> tuple[Array, Array, Array]:
        """Return arrays for `gradients.share_entries` to fill: first bands, targets and owners."""
        if len(self.targets) < len(self.entries):
            self.targets, self.owners = (np.empty(len(self.entries), np.int32) for _ in range(2))
        if len(self.first_band) < visible:
            self.first_band = np.empty(visible + visible // 8, np.int32)
        return self.first_band[:visible], self.targets, self.owners

    def zero_sums(self, count: int) -> Array:
        """Return zeroed gradient sums. [count * RECORD]."""
        if self.sums.size < count * RECORD:
            self.sums = aligned((count + count // 8) * RECORD)
        out = self.sums[: count * RECORD]
        out.fill(0.0)
        return out


def aligned(size: int) -> Array:
    """Return an uninitialised float32 array that begins at a cache line, so that each record is one line."""
    raw = np.empty(4 * size + 64, np.uint8)
    offset = -raw.ctypes.data % 64
    return raw[offset : offset + 4 * size].view(np.float32)
