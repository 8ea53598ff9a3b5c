"""Recording of the splats stage: the Gaussians, their pictures beside the photos, training curves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.recordings.recording import IMAGE_SIDE_PX, log_photo, log_scene_axes, recording, small_image
from gsbridge.report.tables.result_paths import scene_of
from gsbridge.splats.ply import read_ply


def record_splats(splats_ply: str | Path, splats_json: str | Path, views_dir: str | Path, out: str | Path) -> None:
    """Record the Gaussian model of one scene and binding.

    Entities: `table/axes`, `table/splats` (rerun's Gaussian splats), `table/centres` (the same as points, for viewers
    that do not draw splats), `pictures/*` (photo, rendering, difference side by side),
    `curve/loss` and `curve/psnr` on the timeline `step`, `summary`.

    Args:
        splats_ply: Trained splats.
        splats_json: Record of the stage.
        views_dir: Folder of pictures.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    cloud, record = read_ply(splats_ply), read_json(splats_json)
    rgb = np.clip(cloud.colours, 0, 1)
    rgba = np.rint(np.c_[rgb, cloud.opacities] * 255).astype(np.uint8)
    pictures = sorted(Path(views_dir).glob("*.png"))
    shown = [(path.stem, f"pictures/{rr.escape_entity_path_part(path.stem)}") for path in pictures]
    layout = rrb.Horizontal(
        rrb.Tabs(
            rrb.Spatial3DView(origin="table", name="Splats", contents=["table/axes", "table/splats"]),
            rrb.Spatial3DView(origin="table", name="Centres", contents=["table/axes", "table/centres"]),
        ),
        rrb.Vertical(
            rrb.Tabs(
                *(rrb.Spatial2DView(origin=entity, name=f"Photo, rendering, difference: {name}") for name, entity in shown)
            ),
            rrb.Horizontal(
                rrb.TimeSeriesView(origin="curve/loss", name="Loss"), rrb.TimeSeriesView(origin="curve/psnr", name="PSNR (dB)")
            ),
            rrb.TextDocumentView(origin="summary", name="Summary"),
        ),
    )
    with recording(out, "splats", f"{scene_of(splats_json)}-{record['binding']}", layout) as stream:
        log_scene_axes(stream, 0.05)
        stream.log(
            "table/splats",
            # rerun wants quaternions as xyzw.
            rr.GaussianSplats3D(cloud.means, scales=cloud.scales, quaternions=cloud.quats[:, [1, 2, 3, 0]], colors=rgba),
            static=True,
        )
        radii = np.clip(np.sort(cloud.scales, axis=1)[:, 1], 2e-4, 5e-3)
        stream.log("table/centres", rr.Points3D(cloud.means, colors=rgba[:, :3], radii=radii), static=True)
        stream.log("summary", rr.TextDocument(_summary(record), media_type="text/markdown"), static=True)
        for path, (_, entity) in zip(pictures, shown, strict=True):
            log_photo(stream, entity, small_image(path, 3 * IMAGE_SIDE_PX), static=True)
        _log_curve(stream, record, splats_json)


def _log_curve(stream: rr.RecordingStream, record: dict, source: str | Path) -> None:
    """Log loss and PSNR over the training steps."""
    try:
        rows = [(int(row[0]), row[1], row[2]) for row in record["curve"]]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(source, f"the training curve is damaged ({error!r})", "Run the splats stage again") from error
    for step, loss, psnr in rows:
        stream.set_time("step", sequence=step)
        for name, value in (("loss", loss), ("psnr", psnr)):
            if value is not None:
                stream.log(f"curve/{name}", rr.Scalars(float(value)))


def _summary(record: dict) -> str:
    """The record's figures as a small table."""
    lines = [f"**{record['binding']}**, {record['splats']} splats, status **{record['status']}**", ""]
    lines += ["| split | region | views | PSNR dB | SSIM |", "|---|---|---|---|---|"]
    for split, regions in record["metrics"].items():
        for region, figures in regions.items():
            shown = ["–" if figures[name] is None else f"{figures[name]:.3f}" for name in ("psnr", "ssim")]
            lines.append(f"| {split} | {region} | {figures['views']} | {shown[0]} | {shown[1]} |")
    return "\n".join([*lines, "", *record["reasons"]])
