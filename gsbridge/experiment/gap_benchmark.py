"""The benchmark of the gap: methods that name effects, pictures on the tables of its worlds, and the files of each tier."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.seals import seal_of

_PLACES = {"photos": "capture/frames", "renders": "splats/soft/views"}
"""Folder in which a scene keeps each kind of pictures."""


_OURS = "gsbridge"
"""This package's own method, which comes first in all lists of methods."""

_TIERS = {"gap": ("t0", "t1", "t2", "t7"), "gap_rivals": ("t1", "t2"), "gap_bodies": ("t5",), "gap_pictures": ("t4",)}
"""Tiers of each area of recorded figures. An area is small enough to be measured again in some hours on two cores: arms, thrown
bodies and pictures share little, and rival methods run far more simulations than this package's own."""

AREAS = (*_TIERS, "gap_real")
"""Areas of the figures about the gap."""

_PHOTOS, _THROWN = "t4", "t5"
"""Tiers of photos and of thrown bodies; all others are about joints."""

_SEARCHES = ("cma_es", "cma_es_tenfold")
"""Methods that search with CMA-ES and need the package `cma`."""


def methods_of(tier: str, methods: Sequence[str]) -> list[str]:
    """The given methods without those that cannot run in a tier.

    With photos (t4), a search would render every photo for every guess, and the signatures of a group lasso would fill the
    memory. For thrown bodies (t5) there is only this package's own method.
    """
    without: tuple[str, ...] = () if importlib.util.find_spec("cma") else _SEARCHES
    if tier == _PHOTOS:
        without = ("group_lasso", *_SEARCHES)
    return [name for name in methods if name not in without and (tier != _THROWN or name == _OURS)]


MISMATCH = "results/benchmarks/gap_mismatch.json"
"""Figures of tier T6, whose simulated truths follow laws that the diagnosis does not have."""


def _scores(tier: str, scores: str) -> str:
    return f"results/gap-benchmark/{tier}/{scores}.json"


@dataclass(frozen=True)
class BenchmarkPlan:
    """Paths and names of the benchmark, by tier.

    Args:
        plan: The experiment.
    """

    plan: Experiment

    @property
    def settings(self) -> dict[str, Any]:
        """The section `gap`."""
        return self.plan.settings("gap")

    def methods(self, tier: str) -> list[str]:
        """Methods that run in one tier; the benchmark's page says which were left out."""
        return methods_of(tier, self.settings["methods"])

    def contents(self, tier: str, kind: str) -> list[str]:
        """Folders of pictures that lie on the tables of a tier's worlds: `photos` of scenes, or `renders` of their splats."""
        scenes = [name for name in self.settings["contents"][kind] if name in self.plan.scenes]
        return [f"results/scenes/{name}/{_PLACES[kind]}" for name in scenes if tier == _PHOTOS]

    def tiers(self, kind: str) -> list[str]:
        """Tiers whose cases are of one kind: `joint`, `thrown` or `photo`. Each kind is diagnosed by a rule of its own."""
        kinds = {_PHOTOS: "photo", _THROWN: "thrown"}
        return [tier for tier in self.settings["benchmark"] if kinds.get(tier, "joint") == kind]

    def scored(self, tier: str, scores: str) -> list[str]:
        """Methods in a file of scores: this package's own in `scores`, all in `compared`."""
        return self.methods(tier) if scores == "compared" else [_OURS]

    def findings(self, tier: str, scores: str) -> list[str]:
        """Folders of findings behind a tier's file of scores, one per method and chunk; the chunks of a method are adjacent."""
        folder, chunks = f"results/gap-benchmark/{tier}/findings", self.settings["chunks"]
        return [f"{folder}/{name}-{chunk}" for name in self.scored(tier, scores) for chunk in range(chunks)]

    @property
    def shown(self) -> list[str]:
        """Files of scores of all tiers on the benchmark's page: `compared` wherever more than one method runs."""
        tiers = self.settings["benchmark"]
        return [_scores(tier, "compared" if len(self.methods(tier)) > 1 else "scores") for tier in tiers]

    def figures(self, area: str) -> dict[str, Any]:
        """Files from which the figures of an area are gathered, by the names that `score_gap` gives them.

        Args:
            area: One of `AREAS`.
        """
        if area == "gap_real":
            return dict(self.real_logs)
        tiers = [tier for tier in _TIERS[area] if tier in self.settings["benchmark"]]
        found = {"scores": [_scores(tier, "compared" if area == "gap_rivals" else "scores") for tier in tiers]}
        return {**found, "mismatch": MISMATCH} if area == "gap" else found

    @property
    def areas(self) -> list[str]:
        """Areas of the figures about the gap."""
        return list(AREAS)

    @property
    def seal(self) -> int | None:
        """Seed of the cases from GSBRIDGE_SEAL (see `gsbridge.experiment.seals`); None if it is not set."""
        return seal_of(os.environ)

    @property
    def real_logs(self) -> dict[str, str]:
        """Files of figures about real logs: `real` if GSBRIDGE_MEASURED is set, and `arm` if GSBRIDGE_ROBOTS is set, too."""
        named = [name for name in ("GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS") if os.environ.get(name)]
        found = {"real": "results/benchmarks/gap_measured.json"} if "GSBRIDGE_MEASURED" in named else {}
        return found | ({"arm": "results/benchmarks/gap_so101.json"} if len(named) == 2 else {})
