"""The configuration as a whole: all sections, the presets, and how it is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

from pydantic import Field, create_model

from gsbridge.configuration.align import AlignSection
from gsbridge.configuration.asset import AssetSection
from gsbridge.configuration.base import Distinct, Given, Name, OrNull, Settings, Whole, checked, override, plain
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.configuration.experiment import Cell, GapBenchmark, GapSettings, Loop, Study, Variant, Variants, World, Worlds
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
from gsbridge.configuration.scenes import Scene, SharedCamera, Workspace
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.configuration.splats import SplatSettings

Area = Literal["real2sim", "simulator", "policies", "worlds", "study", "gap", "loops"]


class Sections(Settings):
    """Settings of the stages, for all scenes, which a preset may override."""

    films: FilmSettings = Field(default_factory=FilmSettings)
    """The mirror's films."""
    dense_film: DenseFilmSettings = Field(default_factory=DenseFilmSettings)
    """The film of the scene `dense_pan`, at video rate, that tests the choice of keyframes."""
    board_film: BoardFilmSettings = Field(default_factory=BoardFilmSettings)
    """The mirror's photos of the board."""
    registration: RegistrationSettings = Field(default_factory=RegistrationSettings)
    """Where the table stands before the robot."""
    capture: KeyframeSettings = Field(default_factory=KeyframeSettings)
    """Choice of keyframes."""
    sfm: SfmSettings = Field(default_factory=SfmSettings)
    """Reconstruction of the cameras."""
    align: AlignSection = Field(default_factory=AlignSection)
    """Table and scale."""
    masks: MaskSettings = Field(default_factory=MaskSettings)
    """How objects are cut out."""
    mesh: MeshSettings = Field(default_factory=MeshSettings)
    """Surfaces."""
    object_splats: SplatSettings = Field(default_factory=SplatSettings)
    """Splats of objects."""
    background_splats: SplatSettings = Field(default_factory=SplatSettings)
    """Splats of backgrounds."""
    asset: AssetSection = Field(default_factory=AssetSection)
    """Bodies for simulators."""
    views: ViewSettings = Field(default_factory=ViewSettings)
    """What the wrist camera sees."""
    trials: TrialSettings = Field(default_factory=TrialSettings)
    """The baseline controller, and policies, in both worlds."""
    grasp_policy: PolicySettings = Field(default_factory=PolicySettings)
    """How policies learn to grasp."""
    pick_and_place_policy: PolicySettings = Field(default_factory=PolicySettings)
    """How policies learn to pick and place."""
    episodes: EpisodeSettings = Field(default_factory=EpisodeSettings)
    """An episode to look at."""
    comparison: ComparisonSettings = Field(default_factory=ComparisonSettings)
    """Extra trainings for the table, on the mirror's scenes."""
    editing: EditingSettings = Field(default_factory=EditingSettings)
    """The figure of non-rigid edits."""
    gap: GapBenchmark = Field(default_factory=GapBenchmark)
    """The blind benchmark of the gap's diagnosis."""


class _PresetHead(Given):
    """Scenes and budgets of a preset. What it says of a section goes before the section itself."""

    scenes: Distinct[str] = Field(min_length=1)
    """Scenes that this preset runs."""
    cells: list[Cell] = Field(default=[])
    """Cells instead of the configuration's."""


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
    seed: Whole = Field(ge=0)
    """The one random seed; same seed, same machine, same tables."""
    captures: str = "captures"
    """Folder that relative capture paths start from, relative to the project's folder, which is looked in next; the environment
    variable `GSBRIDGE_CAPTURES` goes before it."""
    cameras: dict[Name, SharedCamera] = Field(default={})
    """Cameras that several captures share."""
    scenes: dict[Name, Scene] = Field(min_length=1)
    """The captures, by name."""
    workspace: Workspace = Field(default_factory=Workspace)
    """Where the table stands before the robot, and where the wrist camera sits (docs/registration.md)."""
    cells: list[Cell] = Field(default=[])
    """What is to be learned, a task with an object on a background each."""
    variants: Variants = Field(default_factory=lambda: {"default": Variant()})
    """What is compared with the paper's way, by name."""
    worlds: Worlds = Field(default_factory=lambda: {"mirror": World()})
    """Worlds in which policies are judged beside the simulated one, each a mirror, by name (docs/mirror.md)."""
    study: Study = Field(default_factory=Study)
    """Ways of learning that are compared at equal environment steps."""
    loop: Loop = Field(default_factory=Loop)
    """The demonstration of the closed loop (docs/gap_loop.md)."""
    areas: Distinct[Area] = Field(default_factory=lambda: list(get_args(Area)), min_length=1)
    """Areas that `benchmarks/RESULTS.md` measures; the others stand there as they were recorded last. `make results` measures
    anew."""
    gap: GapSettings = Field(default_factory=GapSettings)
    """Cases in which the gap is diagnosed, and the blind benchmark (docs/gap.md)."""
    gap_case: OrNull[str] = None
    """A case beside those of `gap.cases`, by its file; it is called by that file, or by its folder where the file is
    `case.yaml`."""
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
    return plain(checked(Configuration, config, "config"))
