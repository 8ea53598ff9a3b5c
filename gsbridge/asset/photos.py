"""Check that a bundle looks as the splats stage left it: compare its splats with the photos at the registered cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsbridge.cameras import Views
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array, Similarity
from gsbridge.meshes import read_mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.evaluate import evaluate_cloud
from gsbridge.splats.exposure import from_record
from gsbridge.splats.targets import background_targets, object_targets

LOSS_DB = 0.05
"""Loss of PSNR that rounding and the changes of frame may cause, dB."""


@dataclass(frozen=True)
class AssetPhotos:
    """Files and settings that the check of an asset's pictures needs.

    Args:
        views: Registered photos, table frame.
        masks: Folder of the masks; None for backgrounds.
        record: `splats.json` of the splats in the bundle.
        margin_px: Margin, as in the splats stage's settings, px.
    """

    views: Views
    masks: str | Path | None
    record: str | Path
    margin_px: int = 12


def compare_with_photos(
    cloud: Cloud, body_from_table: Array, photos: AssetPhotos, *, kind: str, visual: str | Path
) -> dict[str, Any]:
    """PSNR of the bundle's splats, moved back into the table frame, next to the PSNR that the splats stage recorded.

    Args:
        cloud: Splats, body frame.
        body_from_table: Transform from the table frame to the body frame. [4, 4].
        photos: See `AssetPhotos`.
        kind: `object` or `background`.
        visual: Mesh of the mesh stage; says which pixels of a background count.

    Returns:
        `split`, `views`, `psnr` and `stage_psnr`, dB, inside the mask or on the table, and `kept`: at most `LOSS_DB` was lost.

    Raises:
        InputError: The record does not hold the figures, or a photo or mask cannot be used.
    """
    stored = read_json(photos.record)
    try:
        split = "held_out" if stored["metrics"]["held_out"]["masked"]["views"] else "train"
        before = stored["metrics"][split]["masked"]["psnr"]
        exposures = from_record(stored.get("exposure"))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(photos.record, f"the record holds no metrics ({error})", "Run the splats stage again") from error
    if kind == "object":
        if photos.masks is None:
            raise InputError("asset", "an object's photos need masks", "Give the folder of the masks stage")
        targets = object_targets(photos.views, photos.masks, photos.margin_px)
    else:
        targets = background_targets(photos.views, read_mesh(visual))
    back = cloud.transformed(Similarity.from_matrix(body_from_table).inverse())
    chosen = [target for target in targets if target.split == split]
    found = evaluate_cloud(back, chosen, kind=kind, exposures=exposures)[split]["masked"]
    return {
        "split": split,
        "views": found["views"],
        "psnr": found["psnr"],
        "stage_psnr": before,
        "kept": found["psnr"] is not None and before is not None and found["psnr"] >= before - LOSS_DB,
    }
