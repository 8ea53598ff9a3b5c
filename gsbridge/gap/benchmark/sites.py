"""Where the cases of a tier come from: one mechanism, or several that the seeds of the courses choose from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.gap.benchmark import machines
from gsbridge.gap.benchmark.case_plan import MACHINES, PlannedCase
from gsbridge.gap.benchmark.mechanisms import MechanismSite, mechanism_site


class MechanismSites:
    """Mechanisms of a tier; their models are written below a folder when they are first needed.

    Args:
        tier: One of `gsbridge.gap.benchmark.case_plan.TIERS`, without photos and thrown bodies.
        split: One of `gsbridge.gap.benchmark.case_plan.SPLITS`: what is in no catalogue differs between them.
        folder: Gets the models.
    """

    def __init__(self, tier: str, split: str, folder: Path) -> None:
        self.split, self.folder = split, folder
        self._machines: dict[str, MechanismSite] = {}
        self._only = None if tier == MACHINES else mechanism_site(tier, folder, split)
        self.kind = "machine" if self._only is None else self._only.kind

    @property
    def names(self) -> tuple[str, ...]:
        """What may be hidden and is in the catalogue; of further machines without joints."""
        return machines.EFFECTS if self._only is None else self._only.names

    @property
    def strange(self) -> tuple[str, ...]:
        """What may be hidden and is not."""
        return tuple(machines.UNKNOWN_OF[self.split]) if self._only is None else self._only.strange

    def at(self, course_seed: int) -> MechanismSite:
        """The mechanism that moves along the courses of a seed."""
        if self._only is not None:
            return self._only
        logging = machines.drawn_logging(course_seed)
        if logging.machine not in self._machines:
            system, plant = machines.machine_plant(logging.machine, self.folder / logging.machine)
            known, strange = machines.names_of(plant, self.split)
            self._machines[logging.machine] = MechanismSite("machine", system, plant, known, strange, logging.machine)
        return replace(self._machines[logging.machine], rate=logging.rate)

    def placed(self, order: PlannedCase) -> PlannedCase:
        """A case of the mechanism that its courses belong to: joints for its effects, and how it is recorded."""
        if self._only is not None:
            return order
        site, logging = self.at(order.course_seed), machines.drawn_logging(order.course_seed)
        rng, pool = np.random.default_rng([order.seed, 3]), site.strange if order.kind == "unknown" else site.names
        names: list[str] = []
        for effect in order.names:
            taken = {name.split(":")[0] for name in names}
            options = [name for name in pool if name.split(":")[0] == effect]
            # What a machine cannot have gives way to something else that it can.
            options = options or [name for name in pool if name.split(":")[0] not in {*taken, *order.names}]
            names.append(str(rng.choice(options)))
        return replace(order, names=tuple(sorted(names)), channels=logging.channels, duration=logging.duration)
