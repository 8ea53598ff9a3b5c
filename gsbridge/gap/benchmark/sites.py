"""Mechanisms of a tier: a single one, or several from which the seed of a case's courses chooses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.gap.benchmark import machines
from gsbridge.gap.benchmark.case_plan import MACHINES, PlannedCase
from gsbridge.gap.benchmark.mechanisms import MechanismSite, mechanism_site


class MechanismSites:
    """Mechanisms of a tier; the model of each is written when it is first needed.

    Args:
        tier: One of `gsbridge.gap.benchmark.case_plan.TIERS`, except those of photos and thrown bodies.
        split: One of `gsbridge.gap.benchmark.case_plan.SPLITS`; the effects outside the catalogue depend on it.
        folder: Folder in which models are written.
    """

    def __init__(self, tier: str, split: str, folder: Path) -> None:
        self.split, self.folder = split, folder
        self._machines: dict[str, MechanismSite] = {}
        self._only = None if tier == MACHINES else mechanism_site(tier, folder, split)
        self.kind = "machine" if self._only is None else self._only.kind

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of the catalogue that may be hidden; without joints in the tier of further machines."""
        return machines.EFFECTS if self._only is None else self._only.names

    @property
    def strange(self) -> tuple[str, ...]:
        """Effects outside the catalogue that may be hidden."""
        return tuple(machines.UNKNOWN_OF[self.split]) if self._only is None else self._only.strange

    def at(self, course_seed: int) -> MechanismSite:
        """Return the mechanism that belongs to a seed of courses."""
        if self._only is not None:
            return self._only
        logging = machines.drawn_logging(course_seed)
        if logging.machine not in self._machines:
            system, plant = machines.machine_plant(logging.machine, self.folder / logging.machine)
            known, strange = machines.names_of(plant, self.split)
            self._machines[logging.machine] = MechanismSite("machine", system, plant, known, strange, logging.machine)
        return replace(self._machines[logging.machine], rate=logging.rate)

    def placed(self, order: PlannedCase) -> PlannedCase:
        """Complete a case for its mechanism: choose joints for its effects, and set how it is recorded."""
        if self._only is not None:
            return order
        site, logging = self.at(order.course_seed), machines.drawn_logging(order.course_seed)
        rng, pool = np.random.default_rng([order.seed, 3]), site.strange if order.kind == "unknown" else site.names
        names: list[str] = []
        for effect in order.names:
            taken = {name.split(":")[0] for name in names}
            options = [name for name in pool if name.split(":")[0] == effect]
            # Replace an effect that the machine cannot have.
            options = options or [name for name in pool if name.split(":")[0] not in {*taken, *order.names}]
            names.append(str(rng.choice(options)))
        return replace(order, names=tuple(sorted(names)), channels=logging.channels, duration=logging.duration)
