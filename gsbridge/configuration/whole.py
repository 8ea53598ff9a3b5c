"""The configuration as a whole: all sections, the presets, and how it is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field, create_model

from gsbridge.configuration.align import AlignSection
from gsbridge.configuration.asset import AssetSection
from gsbridge.configuration.base import Distinct, Given, Name, OrNull, Settings, Whole, checked, override, plain
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.configuration.experiment import (
    CellSettings,
    GapBenchmark,
    GapSettings,
    LoopSettings,
    Study,
    Variant,
    Variants,
    Worlds,
    WorldSettings,
)
from gsbridge.configuration.films import BoardFilmSettings, DenseFilmSettings, FilmSettings
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.measuring import (
    ComparisonSettings,
    EditingSettings,
    EpisodeSettings,
    TrialSettings,
    ViewSettings,
)
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.configuration.policy import PolicySettings
from gsbridge.configuration.registration import RegistrationSettings
from gsbridge.configuration.scenes import Scene, SharedCamera, WorkspaceSettings
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.configuration.splats import SplatSettings
from gsbridge.errors import InputError

Area = Literal[
    "real2sim", "shapes", "photos", "simulator", "policies", "worlds", "severity", "worth", "study", "gap", "gap_rivals",
    "gap_bodies", "gap_pictures", "gap_real", "loops",
]  # fmt: skip


class Recipe(Settings):
    """Budget of the recipe for quality (docs/splats.md); all else is as in `object_splats`."""

    max_splats: Annotated[Whole, Field(ge=100, le=100_000_000)] | Literal["auto"] = "auto"
    """Upper limit of the number of splats."""
    steps: Whole = Field(default=5000, ge=1, le=10_000_000)
    """Optimiser steps."""
    max_pixels: Whole = Field(default=160_000, ge=1, le=1_000_000_000)
    """Pixels of an object's part of a photo in training."""
    sh_degree: Annotated[Whole, Field(ge=0, le=3)] | Literal["auto"] = "auto"
    """Degree of the spherical harmonics of colours, for things with sheen; `auto` takes what the photos determine."""


class Sections(Settings):
    """Settings of the stages, for all scenes, which a preset may override."""

    films: FilmSettings = Field(default_factory=FilmSettings)
    """The mirror's films."""
    dense_film: DenseFilmSettings = Field(default_factory=DenseFilmSettings)
    """The film of the scene `dense_pan`, at video rate, that tests the choice of keyframes."""
    board_film: BoardFilmSettings = Field(default_factory=BoardFilmSettings)
    """The mirror's photos of the board."""
    registration: RegistrationSettings = Field(default_factory=RegistrationSettings)
    """Limits on the errors of the registration of table and camera."""
    capture: KeyframeSettings = Field(default_factory=KeyframeSettings)
    """Choice of keyframes, and the size of the stored frames."""
    sfm: SfmSettings = Field(default_factory=SfmSettings)
    """Reconstruction of the cameras."""
    align: AlignSection = Field(default_factory=AlignSection)
    """Limits on the search for table and scale."""
    masks: MaskSettings = Field(default_factory=MaskSettings)
    """Segmentation of objects in photos."""
    mesh: MeshSettings = Field(default_factory=MeshSettings)
    """Meshes of objects and backgrounds."""
    object_splats: SplatSettings = Field(default_factory=SplatSettings)
    """Training of the splats of objects."""
    background_splats: SplatSettings = Field(default_factory=SplatSettings)
    """Training of the splats of backgrounds."""
    asset: AssetSection = Field(default_factory=AssetSection)
    """Rigid bodies for simulators, made from meshes."""
    views: ViewSettings = Field(default_factory=ViewSettings)
    """Pictures of the wrist camera that are compared between renderers."""
    trials: TrialSettings = Field(default_factory=TrialSettings)
    """Trials of the baseline controller and of policies."""
    grasp_policy: PolicySettings = Field(default_factory=PolicySettings)
    """Training of policies that grasp."""
    pick_and_place_policy: PolicySettings = Field(default_factory=PolicySettings)
    """Training of policies that pick and place."""
    episodes: EpisodeSettings = Field(default_factory=EpisodeSettings)
    """Recording of one episode."""
    comparison: ComparisonSettings = Field(default_factory=ComparisonSettings)
    """Further trainings of splats on the mirror's scenes, for the table of renderings."""
    editing: EditingSettings = Field(default_factory=EditingSettings)
    """The figure of non-rigid edits."""
    gap: GapBenchmark = Field(default_factory=GapBenchmark)
    """The blind benchmark of the gap's diagnosis."""


class _PresetHead(Given):
    """Scenes and budgets of a preset. What it says of a section goes before the section itself."""

    scenes: Distinct[str] = Field(min_length=1)
    """Scenes that this preset runs."""
    cells: list[CellSettings] = Field(default=[])
    """Cells of this preset, in place of the configuration's."""


if TYPE_CHECKING:
    Preset = _PresetHead
else:
    Preset = create_model(
        "Preset",
        __base__=_PresetHead,
        __doc__=_PresetHead.__doc__,
        **{
            name: (override(section.annotation), Field(default=None, description=section.description))
            for name, section in Sections.model_fields.items()
        },
    )


class Configuration(Sections):
    """What `config.yaml` may say."""

    preset: Literal["toy", "desktop", "paper"]
    """Name of the preset that sets budgets and the scenes to run."""
    seed: Whole = Field(ge=0, le=2**32 - 1)
    """The one random seed; same seed, same machine, same tables."""
    captures: str = "captures"
    """Folder that relative paths of captures start from, itself relative to the project's folder; a capture that is not there
    is looked for in the project's folder. The environment variable `GSBRIDGE_CAPTURES` overrides this key."""
    cameras: dict[Name, SharedCamera] = Field(default={})
    """Cameras that several captures share."""
    scenes: dict[Name, Scene] = Field(min_length=1)
    """The captures, by name."""
    workspace: WorkspaceSettings = Field(default_factory=WorkspaceSettings)
    """Source of the registration: where the table stands before the robot, and where the wrist camera sits
    (docs/registration.md)."""
    cells: list[CellSettings] = Field(default=[])
    """Policies to train; each learns a task with one object on one background."""
    variants: Variants = Field(default_factory=lambda: {"default": Variant()})
    """Ways of learning that are compared with the paper's, by name."""
    worlds: Worlds = Field(default_factory=lambda: {"mirror": WorldSettings()})
    """Mirrors, by name, in which policies are judged besides the simulation (docs/mirror.md)."""
    study: Study = Field(default_factory=Study)
    """Comparison of ways of learning at equal numbers of environment steps."""
    loop: LoopSettings = Field(default_factory=LoopSettings)
    """The demonstration of the closed loop (docs/gap_loop.md)."""
    shapes: Distinct[str] = Field(default=[])
    """The mirror's objects, beside those of the presets, whose masks and meshes the area `shapes` of `benchmarks/RESULTS.md`
    measures; and how well the longest side of each, and of the preset's objects, gives the scale."""
    vessels: Distinct[str] = Field(default=[])
    """Objects of the mirror on which the area `shapes` tries the baseline controller; it takes them by the wall."""
    photos: Distinct[str] = Field(default=[])
    """Objects with a capture of a real thing, whose splats, meshes and scale the area `photos` of `benchmarks/RESULTS.md`
    measures; and, where nothing but the photos and a length between two pixels is given, whether turned photos come out the
    same."""
    recipe: Recipe = Field(default_factory=Recipe)
    """Budget with which `results/scenes/{scene}/recipe/soft/splats.json` trains the splats of an object."""
    areas: Distinct[Area] = Field(default_factory=lambda: list(get_args(Area)), min_length=1)
    """Areas that `make results` measures anew for `benchmarks/RESULTS.md`; figures of the other areas stay as they were
    recorded last."""
    gap: GapSettings = Field(default_factory=GapSettings)
    """Cases in which the gap is diagnosed, and the blind benchmark (docs/gap.md)."""
    gap_case: OrNull[str] = None
    """File of one case of the gap besides those of `gap.cases`. The case is named after the file, or after its folder where the
    file is `case.yaml`."""
    presets: dict[str, Preset]
    """Scenes and budgets of each preset."""


def read_configuration(config: Mapping[str, Any]) -> dict[str, Any]:
    """Check a configuration as the user wrote it.

    Args:
        config: The configuration; numbers may be given as text.

    Returns:
        The same with all defaults, and with numbers where numbers are wanted.

    Raises:
        InputError: A key is misspelt or missing, or a value has a wrong type or range; names the key.
    """
    _refuse_zero_bytes(config, "config: ")
    return plain(checked(Configuration, config, "config"))


def _refuse_zero_bytes(value: Any, place: str) -> None:
    """Refuse text with a zero byte, which no path and no name can hold; it may stand in any key."""
    if isinstance(value, str) and "\0" in value:
        raise InputError(place, f"{value[:80]!r} holds a zero byte", "Remove it")
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        _refuse_zero_bytes(item, f"{place.removesuffix(': ')}{': ' if place.endswith(': ') else '.'}{key}")
