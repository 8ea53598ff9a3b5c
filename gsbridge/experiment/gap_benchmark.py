"""What the benchmark of the gap consists of: ways of naming, pictures on its tables, and the findings of each tier."""

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
"""This package's own method, the first of all."""

_TIERS = {"gap": ("t0", "t1", "t2", "t7"), "gap_rivals": ("t1", "t2"), "gap_bodies": ("t5",), "gap_pictures": ("t4",)}
"""Tiers of each area of recorded figures. An area is what can be measured anew in some hours of two cores: arms, thrown bodies
and pictures share little, and other ways of naming simulate far more than this package does."""

AREAS = (*_TIERS, "gap_real")
"""Areas of the figures about the gap."""

_SEARCHES = ("cma_es", "cma_es_tenfold")
"""Methods that need the package `cma`."""


def methods_of(tier: str, methods: Sequence[str]) -> list[str]:
    """Those of some ways of naming that can run in a tier.

    In photos a search would draw every photo for every guess, and a lasso's signatures would fill the memory. Thrown bodies
    have no other method than this package's own.
    """
    without: tuple[str, ...] = () if importlib.util.find_spec("cma") else _SEARCHES
    if tier == "t4":
        without = ("group_lasso", *_SEARCHES)
    return [name for name in methods if name not in without and (tier != "t5" or name == "gsbridge")]


MISMATCH = "results/benchmarks/gap_mismatch.json"
"""Figures of tier T6, whose truths follow laws of their own."""


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
        """Ways of naming in one tier; the page says which were left out."""
        return methods_of(tier, self.settings["methods"])

    def contents(self, tier: str, kind: str) -> list[str]:
        """Folders of pictures that lie on the tables of a tier's worlds: `photos` of scenes, or `renders` of their splats."""
        scenes = [name for name in self.settings["contents"][kind] if name in self.plan.scenes]
        return [f"results/scenes/{name}/{_PLACES[kind]}" for name in scenes if tier == "t4"]

    def scored(self, tier: str, scores: str) -> list[str]:
        """Ways of naming that a file of scores holds: `scores` this package's own, `compared` all."""
        return self.methods(tier) if scores == "compared" else [_OURS]

    def findings(self, tier: str, scores: str) -> list[str]:
        """Findings behind a file of scores of a tier, a folder per chunk: those of a way of naming lie side by side."""
        folder, chunks = f"results/gap-benchmark/{tier}/findings", self.settings["chunks"]
        return [f"{folder}/{name}-{chunk}" for name in self.scored(tier, scores) for chunk in range(chunks)]

    @property
    def shown(self) -> list[str]:
        """Scores of all tiers on the benchmark's page: with other ways of naming wherever any runs."""
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
        """Number that draws the cases, where GSBRIDGE_SEAL holds one."""
        return seal_of(os.environ)

    @property
    def real_logs(self) -> dict[str, str]:
        """What is said about real logs, where GSBRIDGE_MEASURED names their folder, and GSBRIDGE_ROBOTS that of the arm."""
        named = [name for name in ("GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS") if os.environ.get(name)]
        found = {"real": "results/benchmarks/gap_measured.json"} if "GSBRIDGE_MEASURED" in named else {}
        return found | ({"arm": "results/benchmarks/gap_so101.json"} if len(named) == 2 else {})
