"""Recording of a case of the gap about pictures: earlier, later and expected photos side by side, and maps of deviations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.geometry import Array
from gsbridge.images import to_u8
from gsbridge.report.recordings.gap_throws import summary
from gsbridge.report.recordings.recording import JPEG_QUALITY, recording

PHOTOS = {"before": "Earlier", "after": "Later", "expected": "As expected"}
APART = {"gap": "Apart before", "left": "Apart with the explanation"}

FULL = 6.0
"""Deviation that is drawn as white, in units of the noise."""


def record_photos(found: Mapping[str, Any], series: Mapping[str, Array], case: str, out: str | Path) -> None:
    """Record some views of `verify`.

    Entities on the timeline `view` (its number): `photos/before`, `/after`, `/expected`; `apart/gap` and `/left`, in units of
    the noise, white at `FULL` of them and black where nothing is compared; `summary`.

    Args:
        found: What `findings.json` holds.
        series: What `replays.npz` holds: photos [V, H, W, 3], and maps of their deviations [V, h, w].
        case: Name of the case.
        out: The `.rrd`.
    """
    views = [rrb.Spatial2DView(name=title, origin=f"photos/{name}") for name, title in PHOTOS.items()]
    views += [rrb.Spatial2DView(name=title, origin=f"apart/{name}") for name, title in APART.items()]
    layout = rrb.Vertical(rrb.Grid(*views, grid_columns=3), rrb.TextDocumentView(name="Summary", origin="summary"))
    with recording(out, "gap", case, layout) as stream:
        note = f"What is apart is white at {FULL:g} times the noise, black where nothing is compared."
        stream.log("summary", rr.TextDocument(summary(found, note), media_type="text/markdown"), static=True)
        for number, kept in enumerate(series["compared"]):
            stream.set_time("view", sequence=number)
            for name in PHOTOS:
                stream.log(f"photos/{name}", rr.Image(to_u8(series[name][number])).compress(jpeg_quality=JPEG_QUALITY))
            for name in APART:
                grey = np.where(kept > 0, series[name][number] / FULL, 0.0)
                stream.log(f"apart/{name}", rr.Image(to_u8(np.clip(grey, 0.0, 1.0))))
