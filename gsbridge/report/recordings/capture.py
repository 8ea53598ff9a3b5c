"""Recording of the capture stage: keyframes on the time line, with their sharpness and motion."""

from __future__ import annotations

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.recordings.recording import log_photo, recording, small_image
from gsbridge.report.tables.result_paths import scene_of


def record_capture(keyframes_json: str | Path, frames: str | Path, out: str | Path) -> None:
    """Record the keyframes of one scene.

    Entities: `keyframe/photo`, `keyframe/name`, `plots/sharpness` (variance of the Laplacian, grey levels squared) and
    `plots/motion_px` on the timelines `keyframe` (number) and, for a video, `time` (s).

    Args:
        keyframes_json: Record of the capture stage.
        frames: Folder of the keyframes.
        out: The `.rrd`.

    Raises:
        InputError: The record or an image is damaged.
    """
    record = read_json(keyframes_json)
    layout = rrb.Horizontal(
        rrb.Spatial2DView(origin="keyframe", name="Keyframe"),
        rrb.Vertical(
            rrb.TimeSeriesView(origin="plots/sharpness", name="Sharpness (grey levels squared)"),
            rrb.TimeSeriesView(origin="plots/motion_px", name="Motion since the keyframe before (px)"),
        ),
    )
    with recording(out, "capture", scene_of(keyframes_json), layout) as stream:
        try:
            for index, frame in enumerate(record["frames"]):
                stream.set_time("keyframe", sequence=index)
                if frame.get("time_s") is not None:
                    stream.set_time("time", duration=float(frame["time_s"]))
                log_photo(stream, "keyframe/photo", small_image(Path(frames) / frame["name"]))
                stream.log("keyframe/name", rr.TextLog(f"{frame['name']}, frame {frame['index']}, {frame['split']}"))
                for name in ("sharpness", "motion_px"):
                    if frame.get(name) is not None:
                        stream.log(f"plots/{name}", rr.Scalars(float(frame[name])))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(keyframes_json, f"a keyframe is damaged ({error!r})", "Run the capture stage again") from error
