"""Files whose rows lie behind the recorded figures of each area, and which `benchmarks/evidence` keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from gsbridge.experiment.gap_benchmark import AREAS as GAP_AREAS
from gsbridge.experiment.gap_benchmark import BenchmarkPlan
from gsbridge.experiment.loops import JointLoop, PictureLoop
from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.severity_study import SeverityStudy
from gsbridge.experiment.tables import Tables

Kinds = Mapping[str, list[str]]
"""Files by the name of the table that they fill."""


@dataclass(frozen=True)
class EvidencePlan:
    """Raw files of an experiment, by area and table.

    Args:
        plan: Scenes, cells and settings.
    """

    plan: Experiment

    def kinds(self, area: str) -> Kinds:
        """Tables of an area with the files that fill them; empty for an area of which only the figures are kept."""
        found: Mapping[str, Callable[[], Kinds]] = {
            "real2sim": self._real2sim,
            "shapes": self._shapes,
            "photos": self._photos,
            "simulator": self._simulator,
            "policies": self._policies,
            "worlds": lambda: {"trials": Tables(self.plan).table_trials("worlds", "csv")},
            "severity": lambda: self._compared("severity"),
            "worth": lambda: self._compared("worth", "graded"),
            "study": self._study,
            **{name: partial(self._gap, name) for name in GAP_AREAS},
            "loops": lambda: {"trials": sorted({*JointLoop(self.plan).tables, *PictureLoop(self.plan).tables})},
        }
        return found[area]() if area in found else {}

    def files(self, area: str) -> list[str]:
        """All files of an area, each once."""
        return list(dict.fromkeys(path for paths in self.kinds(area).values() for path in paths))

    @staticmethod
    def _scene_scores(scenes: list[str]) -> list[str]:
        return [f"results/scores/scenes/{scene}.json" for scene in scenes]

    def _real2sim(self) -> Kinds:
        return {
            "scenes": self._scene_scores(self.plan.mirrored),
            "films": [f"results/films/{scene}/film.json" for scene in self.plan.mirrored],
            "rendering": ["results/rows/rendering.csv"],
            "captures": [path for paths in self.plan.real_records.values() for path in paths.values()],
            "rasterizer": ["results/benchmarks/rasterizer.json"],
        }

    def _shapes(self) -> Kinds:
        vessels = [found for world in ("sim", "mirror") for found in self.plan.vessel_trials(world).values()]
        return {
            "scenes": self._scene_scores(self.plan.shapes),
            "longest": ["results/scores/longest_sides.json"],
            "controllers": [found["trials"] for found in vessels],
        }

    def _photos(self) -> Kinds:
        records = [self.plan.photo_records(scene) for scene in self.plan.photos]
        stages = [str(record[name]) for record in records for name in ("sfm", "align", "masks", "mesh")]
        splats = [
            str(path)
            for record in records
            for path in (*record["soft"], *record["games"], *record["games_vertices"], record["refined"], record["recipe"])
        ]
        turned = [path for record in records for path in record["turned"]]
        return {"stages": stages, "splats": splats, "turned": turned}

    def _simulator(self) -> Kinds:
        return {
            "controllers": self.plan.controller_trials("sim") + self.plan.controller_trials("mirror"),
            "eye_in_hand": ["results/rows/eye_in_hand.csv"],
            "checks": [
                "results/robot/simulator.json",
                "results/scores/workspace/registration.json",
                "results/benchmarks/environment.json",
                *(f"results/views/{pair}/drawn.json" for pair in self.plan.pairs),
            ],
        }

    def _policies(self) -> Kinds:
        tables = Tables(self.plan)
        if not tables.policies:
            return {}
        trials = [path for table in tables.successes for path in tables.table_trials(table, "csv")]
        return {"trials": sorted(set(trials)), "training": ["results/rows/training.csv"]}

    def _compared(self, *names: str) -> Kinds:
        """Trials at different severities, and the rows that say how severe each world is."""
        study = SeverityStudy(self.plan)
        found = [who for who in names if study.compares(who)]
        trials = {who if len(names) > 1 else "trials": study.trials(who, "csv") for who in found}
        return {**trials, "rows": [f"results/rows/{who}.csv" for who in found]}

    def _study(self) -> Kinds:
        tables = Tables(self.plan)
        return {"trials": tables.study_files("csv", trials=True), "study": ["results/rows/study.csv"]}

    def _gap(self, area: str) -> Kinds:
        files = BenchmarkPlan(self.plan).figures(area)
        names = {"mismatch": ("mismatch",), "measured": ("real", "arm")}
        found = {kind: [files[name] for name in given if name in files] for kind, given in names.items()}
        return {"tiers": files.get("scores", []), **found}
