"""The page of one scene: what the stages say of it, and pictures on which a wrong body is seen at a glance."""

# ruff: noqa: E501  (sentences for the page)

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.files import read_json
from gsbridge.images import read_image_u8
from gsbridge.meshes import read_mesh
from gsbridge.report.figures.mesh_sides import draw_sides
from gsbridge.report.pages.html import write_page
from gsbridge.report.pages.photo_pictures import jpeg_uri, masked_photo

PHOTOS = 8
"""Number of photos on the page, spread evenly over the capture."""
_LONGEST, _SIDE = 420, 300

STAGES = (
    ("capture/keyframes.json", "capture", "Film again as docs/capture.md shows: slowly, all round, at two heights, with light."),
    ("sfm/sfm.json", "cameras", "Photos that are farther than 10° from their neighbours, blurred or of a plain thing do not register; add photos between, or lay the board or a newspaper under the object."),
    ("align/align.json", "table and scale", "Lay the printed board beside the object, or give known_length or metres_per_unit (docs/capture.md)."),
    ("masks/masks.json", "masks", "Look at the outlines below. Where they are wrong, `gsbridge masks SCENE` helps by single pixels (docs/masks.md)."),
    ("mesh/mesh.json", "mesh", "Compare the mesh below with the photos. Where an opening is closed, photos from above are missing; where an undercut is filled, photos from low down."),
    ("splats/soft/splats.json", "splats", "Look at the held-out photos below; docs/splats.md#quality gives a larger budget."),
    ("asset/asset.json", "body", "docs/assets.md says what the body is tested for."),
)  # fmt: skip
"""Record of each stage, its name on the page, and what to do where it is degraded."""


@dataclass(frozen=True)
class StageLine:
    """What a stage says: its name, `pass`, `degraded` or `not made`, its figures in words, reasons, and what to do."""

    name: str
    status: str
    figures: str
    reasons: tuple[str, ...]
    advice: str


@dataclass(frozen=True)
class ScenePicture:
    """A picture: title, and a data URI."""

    title: str
    data: str


def write_scene_page(scene: str, folder: str | Path, out: str | Path) -> None:
    """Write the page of a scene from what its stages left; stages that have not run are named as such.

    Args:
        scene: Name of the scene.
        folder: Its results, `results/scenes/{scene}`.
        out: The HTML file.

    Raises:
        InputError: A record or a picture is damaged.
    """
    base = Path(folder)
    records = {path: read_json(base / path) for path, _, _ in STAGES if (base / path).is_file()}
    known = records.get("align/align.json", {}).get("scale_source", "unknown") not in (None, "unknown")
    sides = _upright_box(base / "mesh/visual.ply", records.get("mesh/mesh.json", {}))
    lines = [_line(name, records.get(path), advice.replace("SCENE", scene), known, sides) for path, name, advice in STAGES]
    kind = str(records.get("mesh/mesh.json", {}).get("kind", "scene"))
    write_page(
        out,
        "scene.html.j2",
        scene=scene,
        kind=kind,
        status=_worst(lines),
        lines=lines,
        photos=_photos(base),
        masked=(base / "masks/images").is_dir(),
        sides=_sides(base),
        held_out=_held_out(base, records.get("splats/soft/splats.json", {})),
    )


def _worst(lines: Sequence[StageLine]) -> str:
    """Status of the whole page: `not made` if no stage ran, `degraded` if any is, otherwise `pass`."""
    if all(line.status == "not made" for line in lines):
        return "not made"
    return "degraded" if any(line.status == "degraded" for line in lines) else "pass"


def _upright_box(path: Path, record: dict[str, Any]) -> list[float]:
    """Length, width and height of the smallest box that stands on the table round a mesh, m: what a ruler measures.

    Args:
        path: The mesh.
        record: Record of the mesh stage. Its extents along the table's axes are taken where there is no mesh, and always for
            a background, which has no height.
    """
    extents = [float(value) for value in record.get("visual", {}).get("extents", [])]
    if record.get("kind") == "background":
        return extents[:2]
    if not extents or not path.is_file():
        return extents
    vertices = read_mesh(path).vertices
    sides = cv2.minAreaRect(np.ascontiguousarray(vertices[:, :2], dtype=np.float32))[1]
    return [*sorted((float(side) for side in sides), reverse=True), float(np.ptp(vertices[:, 2]))]


def _line(name: str, record: dict[str, Any] | None, advice: str, known: bool, sides: Sequence[float]) -> StageLine:
    """Make the line of a stage from its record; `known`: lengths are metres; `sides`: lengths of the mesh's box."""
    if record is None:
        return StageLine(name, "not made", "", (), "")
    reasons = tuple(str(reason) for reason in record.get("reasons", []))
    status = str(record.get("status", "pass"))
    return StageLine(name, status, _figures(record, known, sides), reasons, advice if status == "degraded" else "")


def _figures(record: dict[str, Any], known: bool, sides: Sequence[float]) -> str:
    """State the main figures of a stage; without a known scale, lengths are shares of the longest."""
    said = []
    if "frames" in record:
        said.append(f"{len(record['frames'])} keyframes")
    if "registered" in record:
        said.append(
            f"{record['registered']} of {record['total']} photos placed, points off by {record['reprojection_px']:.2f} px"
        )
    if "scale_source" in record:
        said.append(f"metres from: {record['scale_source'] or 'unknown'}")
    if "consistency" in record:
        said.append(f"outlines of all photos agree to {record['consistency']['mean']:.2f} of 1")
    if "visual" in record and "extents" in record["visual"]:
        sizes = [f"{1e3 * value:.0f}" if known else f"{value / max(sides):.2f}" for value in sides]
        which = ("length × width × height", "length × width")[len(sizes) == 2]
        said.append(f"{which} {' × '.join(sizes)}" + (" mm" if known else ", relative to the longest"))
    if "metrics" in record:
        held = record["metrics"]["held_out"]["masked"]["psnr"]
        said.append(f"{record['splats']} splats" + ("" if held is None else f", {held:.1f} dB on held-out photos"))
    if record.get("body"):
        said.append(f"{record['body']['mass']:.2g} kg, from its volume and the density in the config")
    return "; ".join(said)


def _chosen(items: Sequence[Path], count: int) -> list[Path]:
    """Choose at most `count` of the items, spread evenly."""
    return (
        [items[i] for i in np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int))]
        if items
        else []
    )


def _photos(base: Path) -> list[ScenePicture]:
    """Draw photos with their masks."""
    found = sorted((base / "sfm/images").glob("*.png"))
    out = []
    for path in _chosen(found, PHOTOS):
        mask = base / "masks/images" / path.name
        out.append(ScenePicture(f"Photo {path.stem}", jpeg_uri(masked_photo(path, mask if mask.is_file() else None, _LONGEST))))
    return out


def _sides(base: Path) -> list[ScenePicture]:
    """Draw both meshes from all sides."""
    titles = {"visual": "Surface that the splats hang on", "collision": "Collision mesh: what touches and is touched"}
    paths = {title: base / f"mesh/{name}.ply" for name, title in titles.items()}
    return [
        ScenePicture(title, jpeg_uri(draw_sides(read_mesh(path), _SIDE))) for title, path in paths.items() if path.is_file()
    ]


def _held_out(base: Path, record: dict[str, Any]) -> list[ScenePicture]:
    """Photo, rendering and difference of the views that no training saw."""
    names = [str(name) for name in record.get("pictures", [])]
    paths = [path for name in names if (path := base / "splats/soft/views" / name).is_file()]
    return [ScenePicture(f"Held-out photo {path.stem}", jpeg_uri(read_image_u8(path))) for path in paths]
