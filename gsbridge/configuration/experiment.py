"""What is learned, with which variants, and in which worlds it is judged."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from gsbridge.configuration.base import Distinct, Free, Given, Name, Number, OrNull, Samples, Settings, Switch, Whole, fault
from gsbridge.configuration.policy import PolicyOverride
from gsbridge.configuration.renderers import RendererName

Task = Literal["grasp", "pick_and_place"]
Offset = Annotated[Number, Field(ge=-0.2, le=0.2)]
Names = Distinct[str]


class Work(Settings):
    """A task with an object on a background."""

    task: Task
    """Task of the policy."""
    object: str
    """Scene of the object."""
    background: str
    """Scene of the table."""


class CellSettings(Work):
    """A policy to be trained and judged."""

    renderer: RendererName = "gs"
    """What the policy sees in training: `gs` splats, `gs_soft` splats of the soft binding, `mesh` meshes in one colour each
    (the paper's control, RL-sim), `mesh_vertex` meshes with vertex colours; `mesh_shaded` and `mesh_vertex_shaded` draw the
    shadows that splats are drawn with, too, and so differ from splats in one thing."""
    robot_trials: OrNull[str] = None
    """Your own trials on a robot, a CSV table with at least the columns `pose_set`, `index` and `success`. They fill the rows
    `robot` of the tables."""


class Variant(Settings):
    """A way of learning, by its differences from the paper's."""

    policy: PolicyOverride = Field(default_factory=PolicyOverride)
    """Settings of the training that override those of `grasp_policy` and `pick_and_place_policy`."""
    model: OrNull[str] = None
    """Simulation model, YAML; null for `models/nominal.yaml`. One that begins with `results/` is made by the workflow."""
    controller_offset: tuple[Offset, Offset, Offset, Offset] = (0.0, 0.0, 0.0, 0.0)
    """Error of the baseline controller: how far from its true place, in x, y and z, it believes the object to be, m, and by how
    much it believes it turned about the vertical, rad."""
    registered_in: OrNull[str] = None
    """World in which the work place is registered anew for this variant; null for the registration that all others have."""
    calibrated_in: OrNull[str] = None
    """World in which the colours of the wrist camera are calibrated anew for this variant; null likewise."""
    unchanged_teacher: Switch = False
    """Learn from the controller as it is for the unchanged model, however late the model's commands act."""


def _with_default(variants: dict[str, Variant]) -> dict[str, Variant]:
    if "default" not in variants:
        raise fault("the key 'default' is missing", "Add default: {}, the paper's way")
    return variants


Variants = Annotated[dict[Name, Variant], AfterValidator(_with_default)]


Level = Annotated[Whole, Field(ge=0, le=4)]


class SeveritySettings(Settings):
    """Severity of a world, look and physics apart."""

    look: Level = 0
    """Severity of camera, light, surfaces and surroundings."""
    physics: Level = 0
    """Severity of arm and object."""


class WorldSettings(Settings):
    """A mirror in which policies are judged. Table and camera stand where the configuration's seed puts them."""

    seed: OrNull[Annotated[Whole, Field(ge=0, le=2**32 - 1)]] = None
    """Seed of the hidden parameters that `hidden` does not set; null takes the configuration's seed."""
    severity: Level | SeveritySettings = 0
    """Severity of the world's surprises, from 0 to 4 for both or for `look` and `physics` apart (docs/mirror.md)."""
    hidden: dict[str, Free] = Field(default={})
    """Hidden parameters that this world sets, by name (docs/mirror.md)."""


def _no_other_world(name: str) -> str:
    if name in ("sim", "robot"):
        raise fault(f"'{name}' is a world already: the simulated one, or that of your arm", "Rename it")
    return name


Worlds = dict[Annotated[Name, AfterValidator(_no_other_world)], WorldSettings]


class PictureStudy(Settings):
    """Study of other cameras: the cell's policies of some variants are tried in some worlds."""

    variants: Names = Field(default=[])
    """Names of variants."""
    worlds: Names = Field(default=[])
    """Names of worlds."""
    reference: str = "mirror"
    """World in which the photos of the first day are taken."""
    amended: dict[str, Names] = Field(default={})
    """Variants that train with the changes found in the photos of a world, by world. For a world with an empty list the changes
    are only reported."""
    controls: dict[str, Names] = Field(default={})
    """Variants that those of `amended` are compared with in a world, by world: what else might have helped."""
    trainings: Whole = Field(default=1, ge=1, le=100)
    """Number of policies of each variant, each trained with its own seed."""
    postures: Whole = Field(default=24, ge=12, le=100)
    """Postures from which the wrist camera is photographed."""
    repeats: Whole = Field(default=4, ge=1, le=50)
    """Further photos of each posture on the first day, from which the noise is learnt."""
    samples: Samples = 48
    """Samples per pixel of the mirror's photos, at least."""


class SeverityTrials(Settings):
    """Trials in worlds of different severity: `results/worth.md`, `graded.md` and `severity_controller.md`."""

    cells: list[Work] = Field(
        default_factory=lambda: [Work(task="grasp", object="small_cube", background="foam_pad")], min_length=1
    )
    """Tasks, objects and backgrounds of the trials. The controller and graded policies are tried on the first."""
    renderers: Distinct[RendererName] = Field(default=["gs", "gs_soft", "mesh_vertex_shaded", "mesh_shaded"])
    """Renderers that the policies learned with. The first is what the others are compared with."""
    variants: Names = Field(default=["default"])
    """Names of the policies' variants."""
    worlds: Names = Field(default=[])
    """Names of the worlds."""
    seeds: Whole = Field(default=3, ge=1, le=100)
    """Number of policies of each cell, renderer and variant, each trained with its own seed."""
    graded: Names = Field(default=[])
    """Names of variants from poor to good, one policy each, that tell how well simulation foretells each world."""


class Study(Settings):
    """Comparison of ways of learning at equal numbers of environment steps."""

    cell: Work = Field(default_factory=lambda: Work(task="grasp", object="bear", background="foam_pad"))
    """Task, object and background on which the ways of learning are compared."""
    variants: list[str] = Field(default=["default"], min_length=1)
    """Names of the variants to compare. Give them `stop_after: 0`, so that all train for the same number of steps."""
    seeds: Whole = Field(default=3, ge=1, le=100)
    """Number of policies of each variant, each trained with its own seed."""
    worlds: Names = Field(default=[])
    """Further worlds in which every policy that was trained on splats is tried."""
    picture_gap: PictureStudy = Field(default_factory=PictureStudy)
    """Study of changes that only the camera sees (docs/gap_images.md)."""
    severity: SeverityTrials = Field(default_factory=SeverityTrials)
    """Trials that show success against severity (docs/mirror.md)."""


class LoopSettings(Settings):
    """The demonstration of the closed loop, on one cell."""

    cell: Work = Field(default_factory=lambda: Work(task="grasp", object="cake", background="foam_pad"))
    """Task, object and background of the demonstration; the mirror must film both scenes."""
    reference: str = "mirror"
    """World in which the policy works and the arm is calibrated."""
    changed: str = "mirror"
    """World in which the policy fails and the arm is diagnosed."""
    variant: str = "default"
    """Variant that learns with the amended model; `default` demonstrates nothing."""
    controls: Names = Field(default=[])
    """Variants that the amended one is compared with in the changed world: what else might have helped."""
    trainings: Whole = Field(default=1, ge=1, le=100)
    """Number of policies of each variant, each trained with its own seed."""


Tier = OrNull[Annotated[Whole, Field(ge=1, le=500)]]


class Tiers(Given):
    """Number of cases of each tier of the benchmark; a tier that is not named does not run."""

    t0: Tier = None
    """Number of cases of the analytic axis; null for all that the tier holds."""
    t1: Tier = None
    """Number of cases of arms that PyBullet simulates as the truth; null for all that the tier holds."""
    t2: Tier = None
    """Number of cases of arms that MuJoCo simulates as the truth; null for all that the tier holds."""
    t4: Tier = None
    """Number of cases of photos; null for all that the tier holds."""
    t5: Tier = None
    """Number of cases of thrown bodies that MuJoCo simulates as the truth; null for all that the tier holds."""
    t7: Tier = None
    """Number of cases of further machines, lengths and rates, with truths of MuJoCo; null for all that the tier holds."""


class Contents(Settings):
    """Scenes whose pictures lie on the tables of the worlds that `t4` shows, in turn with paint."""

    photos: Names
    """Scenes whose photos lie there; scenes that the preset does not make are left out."""
    renders: Names
    """Scenes whose renderings lie there; scenes that the preset does not make are left out."""


Method = Literal["gsbridge", "largest_change", "training_bic", "cosine", "sparse", "group_lasso", "cma_es", "cma_es_tenfold"]


class GapBenchmark(Settings):
    """The blind benchmark of the gap's diagnosis."""

    split: Literal["development", "scored"] = "scored"
    """Which cases of the benchmark are drawn; only scored ones are reported."""
    benchmark: Tiers = Field(default_factory=lambda: Tiers(t0=None, t1=None, t2=None, t4=None, t5=None, t7=None))
    """Number of cases of each tier; a tier that is not named does not run."""
    methods: Distinct[Method] = Field(default_factory=lambda: list(get_args(Method)), min_length=1)
    """Methods that the benchmark compares; `gsbridge` must be the first."""
    contents: Contents = Field(default_factory=lambda: Contents(photos=["banana_photos"], renders=["tablecloth"]))
    """Pictures that lie on the tables of the worlds that `t4` shows, in turn with painted ones."""
    chunks: Whole = Field(default=4, ge=1, le=100)
    """Number of jobs into which the cases of a tier are split."""


class GapSettings(GapBenchmark):
    """Cases in which the gap is diagnosed, and the blind benchmark."""

    cases: dict[Name, str] = Field(default={})
    """Files of cases by name, YAML, relative to the folder in which snakemake runs or to the project's (docs/gap.md)."""
