"""Reconstruction of a capture from its keyframes in quarter turns, up to the mesh. It should come out the same."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsbridge.align.stage import align_scene
from gsbridge.cameras import read_views
from gsbridge.capture.turned import turn_keyframes, turn_length
from gsbridge.configuration.align import AlignSettings
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json, write_json
from gsbridge.masks import segment_object
from gsbridge.mesh import mesh_object
from gsbridge.meshes import read_mesh
from gsbridge.photogrammetry.board import optional_board
from gsbridge.photogrammetry.standing import box_sides
from gsbridge.sfm.stage import reconstruct

STAGES = ("sfm", "align", "masks", "mesh")


@dataclass(frozen=True)
class Reconstruction:
    """What came out of a capture.

    Args:
        statuses: Status of each stage.
        reasons: Reasons that each stage gives for it.
        scale_source: What gave the scale; `unknown` where lengths have no unit.
        registered: Registered photos.
        sides: Sides of the upright box round the visual mesh: footprint, smaller side first, and height, m. [3].
        visual_volume: Volume of the visual mesh, m^3.
        collision_volume: Volume of the collision mesh, m^3.
    """

    statuses: Mapping[str, str]
    reasons: Mapping[str, list[str]]
    scale_source: str
    registered: int
    sides: list[float]
    visual_volume: float
    collision_volume: float

    @classmethod
    def read(cls, paths: Mapping[str, Path]) -> Reconstruction:
        """Read what the stages wrote.

        Args:
            paths: Records `sfm`, `align`, `masks` and `mesh`, and meshes `visual` and `collision`.

        Raises:
            InputError: A file is damaged.
        """
        records = {stage: read_json(paths[stage]) for stage in STAGES}
        visual, collision = read_mesh(paths["visual"]), read_mesh(paths["collision"])
        sides = box_sides(visual.vertices)
        return cls(
            {stage: record["status"] for stage, record in records.items()},
            {stage: list(record["reasons"]) for stage, record in records.items()},
            records["align"]["scale_source"],
            records["sfm"]["registered"],
            [float(side) for side in (*sorted(sides[:2]), sides[2])],
            visual.volume(),
            collision.volume(),
        )


@dataclass(frozen=True)
class StageSettings:
    """Settings of the stages from cameras to mesh, and what the scene says of its board and of a known length."""

    sfm: SfmSettings
    align: AlignSettings
    masks: MaskSettings
    mesh: MeshSettings
    board: str | None
    known_length: Mapping[str, Any] | None

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> StageSettings:
        """Read the settings from those of a rule, by the names of the fields."""
        return cls(
            SfmSettings(**settings["sfm"]),
            AlignSettings(**settings["align"]),
            MaskSettings(**settings["masks"]),
            MeshSettings(**settings["mesh"]),
            settings["board"],
            settings["known_length"],
        )


def write_turned_reconstruction(
    out: str | Path,
    *,
    usual: Mapping[str, Path],
    frames: Path,
    keyframes: Path,
    degrees: int,
    settings: StageSettings,
    work: Path,
    seed: int,
    threads: int,
) -> None:
    """Reconstruct a capture from turned photos, and write what came out beside what comes out of the photos as they are.

    That a stage refuses the turned photos is a result, too: the record then says why.

    Args:
        out: The record: `degrees`, `seed`, and two `Reconstruction`s, `usual` and `turned`; `turned` is null and `refused` the
            reason if a stage refused the turned photos.
        usual: Files of the photos as they are, see `Reconstruction.read`.
        frames: Folder of the keyframes.
        keyframes: Their record.
        degrees: Turn, counter-clockwise: 90, 180 or 270; or 0 for the same photos with another seed.
        settings: Settings of the stages.
        work: Folder for everything between; it is emptied before and removed after.
        seed: Random seed of the photos as they are.
        threads: Threads to use.

    Raises:
        InputError: The keyframes are damaged or cannot be turned.
    """
    shutil.rmtree(work, ignore_errors=True)
    turned, listed = work / "capture/frames", work / "capture/keyframes.json"
    turn_keyframes(frames, keyframes, degrees, turned, listed)
    length = turn_length(settings.known_length, degrees, frames)
    seed += degrees == 0
    found, refused = None, None
    try:
        found = asdict(Reconstruction.read(_run(turned, listed, length, settings, work, seed, threads)))
    except StageError as error:
        refused = str(error)
    write_json(
        out,
        {
            "degrees": degrees,
            "seed": seed,
            "usual": asdict(Reconstruction.read(usual)),
            "turned": found,
            "refused": refused,
        },
    )
    shutil.rmtree(work)


def _run(
    frames: Path,
    keyframes: Path,
    known_length: Mapping[str, Any] | None,
    settings: StageSettings,
    work: Path,
    seed: int,
    threads: int,
) -> dict[str, Path]:
    """Run the stages and return what they wrote, by name.

    Raises:
        StageError: A stage refuses the photos, or the photo of the known length does not register.
    """
    board = optional_board(settings.board)
    model, images, tags, points = work / "model", work / "images", work / "tags.json", work / "points.npz"
    paths = {stage: work / f"{stage}.json" for stage in STAGES}
    paths |= {name: work / f"{name}.ply" for name in ("visual", "collision")}
    reconstruct(
        frames=frames,
        keyframes_json=keyframes,
        out_model=model,
        out_images=images,
        out_json=paths["sfm"],
        out_tags=tags,
        settings=settings.sfm,
        camera=None,
        board=board,
        workspace=work / "colmap",
        seed=seed,
        threads=threads,
    )
    try:
        align_scene(
            sfm_json=paths["sfm"],
            model=model,
            tags=tags,
            out_json=paths["align"],
            out_views=work / "views.json",
            out_points=points,
            settings=settings.align,
            board=board,
            known_length=known_length,
            seed=seed,
        )
    except InputError as error:
        # The length is right in the photos as they are; it fails where its photo does not register, or shows no table, turned.
        if error.source != "known_length":
            raise
        raise StageError("align of turned photos", str(error), "See which photos register") from error
    views = read_views(work / "views.json", images)
    segment_object(views, points, work / "masks", paths["masks"], settings.masks, seed, threads)
    mesh_object(views, work / "masks", points, paths["visual"], paths["collision"], paths["mesh"], settings.mesh, seed, threads)
    return paths
