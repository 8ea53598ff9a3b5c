"""What is learned, with which variants, and in which worlds it is judged."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from gsbridge.configuration.base import Distinct, Free, Given, Name, Number, OrNull, Samples, Settings, Whole, fault
from gsbridge.configuration.policy import PolicyOverride

Task = Literal["grasp", "pick_and_place"]
Offset = Annotated[Number, Field(ge=-0.2, le=0.2)]
Names = Distinct[str]


class Work(Settings):
    """A task with an object on a background."""

    task: Task
    """What is to be done."""
    object: str
    """Scene of the object."""
    background: str
    """Scene of the table."""


class Cell(Work):
    """What is to be learned and judged."""

    renderer: Literal["gs", "mesh", "mesh_vertex"] = "gs"
    """What the policy sees in training: `gs` splats, `mesh` meshes in one colour each (the paper's control, RL-sim),
    `mesh_vertex` meshes with vertex colours."""
    robot_trials: OrNull[str] = None
    """Table of trials on your robot, CSV with at least the columns `pose_set`, `index`, `success`; it fills the rows `robot` of
    the tables."""


class Variant(Settings):
    """What differs from the paper's way."""

    policy: PolicyOverride = Field(default_factory=PolicyOverride)
    """Settings of the training that go before `grasp_policy` and `pick_and_place_policy`."""
    model: OrNull[str] = None
    """Simulation model, YAML; null for `models/nominal.yaml`. One that begins with `results/` is made by the workflow."""
    controller_offset: tuple[Offset, Offset] = (0.0, 0.0)
    """Error of the baseline controller, which believes the object to stand so far off, x and y, m."""


def _with_default(variants: dict[str, Variant]) -> dict[str, Variant]:
    if "default" not in variants:
        raise fault("the key 'default' is missing", "Add default: {}, the paper's way")
    return variants


Variants = Annotated[dict[Name, Variant], AfterValidator(_with_default)]


class World(Settings):
    """A mirror in which policies are judged. Table and camera stand where the configuration's seed puts them."""

    seed: OrNull[Annotated[Whole, Field(ge=0)]] = None
    """Seed of what else is hidden; null for the configuration's."""
    hidden: dict[str, Free] = Field(default={})
    """Hidden parameters that this world sets, by name (docs/mirror.md)."""


def _no_other_world(name: str) -> str:
    if name in ("sim", "robot"):
        raise fault(f"'{name}' is a world already: the simulated one, or that of your arm", "Rename it")
    return name


Worlds = dict[Annotated[Name, AfterValidator(_no_other_world)], World]


class SightStudy(Settings):
    """What another camera does to policies: the cell's policies of some variants are tried in some worlds."""

    variants: Names = Field(default=[])
    """Names of variants."""
    worlds: Names = Field(default=[])
    """Names of worlds."""
    reference: str = "mirror"
    """World of the photos of the first day."""
    amended: dict[str, Names] = Field(default={})
    """By world, variants that learn with what its photos say has changed; an empty list where that is only said."""
    postures: Whole = Field(default=24, ge=12, le=100)
    """Postures from which the wrist camera is photographed."""
    repeats: Whole = Field(default=4, ge=1, le=50)
    """Further photos of each posture on the first day, from which the noise is learnt."""
    samples: Samples = 48
    """Samples per pixel of the mirror's photos, at least."""


class Study(Settings):
    """Ways of learning that are compared at equal environment steps."""

    cell: Work = Field(default_factory=lambda: Work(task="grasp", object="bear", background="foam_pad"))
    """Task, object and background on which they are compared."""
    variants: list[str] = Field(default=["default"], min_length=1)
    """Names of the variants; give them `stop_after: 0`, so that all take the same number of steps."""
    seeds: Whole = Field(default=3, ge=1, le=100)
    """Policies of each variant, each trained with its own seed."""
    worlds: Names = Field(default=[])
    """Further worlds in which the policies of all cells are tried that were trained on splats."""
    sight: SightStudy = Field(default_factory=SightStudy)
    """What else the camera may see (docs/gap_images.md)."""


class Loop(Settings):
    """The demonstration of the closed loop, on one cell."""

    cell: Work = Field(default_factory=lambda: Work(task="grasp", object="cake", background="foam_pad"))
    """Task, object and background of it; the mirror must film both."""
    reference: str = "mirror"
    """World in which the policy works and the arm is calibrated."""
    changed: str = "mirror"
    """World in which the policy fails and the arm is diagnosed."""
    variant: str = "default"
    """Variant that learns with the amended model; `default` demonstrates nothing."""


Tier = OrNull[Annotated[Whole, Field(ge=1, le=500)]]


class Tiers(Given):
    """Number of cases of each tier of the benchmark; a tier that is not named does not run."""

    t0: Tier = None
    """Cases of the analytic axis; null for all of the tier's."""
    t1: Tier = None
    """Cases of truths in PyBullet; null for all of the tier's."""
    t2: Tier = None
    """Cases of truths in MuJoCo; null for all of the tier's."""
    t4: Tier = None
    """Cases of photos; null for all of the tier's."""


class Contents(Settings):
    """Scenes whose pictures lie on the tables of the worlds that `t4` shows, in turn with paint."""

    photos: Names
    """Scenes whose photos do; those that the preset does not make are left out."""
    renders: Names
    """Scenes whose splats' renders do; those that the preset does not make are left out."""


Method = Literal["gsbridge", "largest_change", "training_bic", "cosine", "sparse", "cma_es"]


class GapBenchmark(Settings):
    """The blind benchmark of the gap's diagnosis."""

    split: Literal["development", "scored"] = "scored"
    """Cases of the benchmark; only the scored ones are reported."""
    benchmark: Tiers = Field(default_factory=lambda: Tiers(t0=None, t1=None, t2=None, t4=None))
    """Number of cases of each tier; a tier that is not named does not run."""
    methods: Distinct[Method] = Field(default_factory=lambda: list(get_args(Method)), min_length=1)
    """Ways of naming that the benchmark compares; ours is always the first."""
    contents: Contents = Field(default_factory=lambda: Contents(photos=["banana_photos"], renders=["tablecloth"]))
    """What lies on the tables of the worlds that `t4` shows, in turn with paint."""
    chunks: Whole = Field(default=4, ge=1, le=100)
    """Jobs into which the cases of a tier are split."""


class GapSettings(GapBenchmark):
    """Cases in which the gap is diagnosed, and the blind benchmark."""

    cases: dict[Name, str] = Field(default={})
    """Files of cases by name, YAML, relative to the folder in which snakemake runs or to the project's (docs/gap.md)."""
