"""Running a list of cases, one after the other, resumably: seal, diagnose, note the verdict."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark.generate import Plant, draw_case
from gsbridge.gap.benchmark.score import Verdict
from gsbridge.gap.diagnose import Diagnosis, diagnose
from gsbridge.gap.system import System

logger = logging.getLogger("gsbridge")


@dataclass(frozen=True)
class Order:
    """A case to be drawn.

    Args:
        names: What is hidden.
        units: Its size.
        seed: Of signs and noise.
        course_seed: Of the courses; cases that share it share a bank.
        kinds: Logged channels.
        duration: Of each record, s.
    """

    names: tuple[str, ...]
    units: float
    seed: int
    course_seed: int
    kinds: tuple[str, ...] = ("position", "velocity", "effort")
    duration: float = 4.0

    @property
    def key(self) -> str:
        """Name of its files."""
        what = "+".join(self.names).replace(":", "@") or "nothing"
        return f"{what}-{self.units:g}-{self.seed}-{self.course_seed}-{len(self.kinds)}-{self.duration:g}"


def run_orders(
    system: System, plant: Plant, orders: Iterable[Order], truths: str | Path, verdicts: str | Path, bank: str | Path
) -> None:
    """Diagnose cases; those whose verdict is there already are left alone.

    Args:
        system: The model that is diagnosed.
        plant: Where records come from.
        orders: Cases.
        truths: Folder of the truths, which only the scoring reads; each is written before its diagnosis begins.
        verdicts: Folder of what was found, with the truth's seal.
        bank: Folder of signatures.
    """
    for order in orders:
        found = Path(verdicts) / f"{order.key}.json"
        if found.exists():
            continue
        case = draw_case(
            plant, order.names, order.units, order.seed, order.course_seed, duration=order.duration, kinds=order.kinds
        )
        write_json(Path(truths) / f"{order.key}.json", {"hidden": dict(case.hidden), "units": order.units, "seal": case.seal})
        diagnosis = diagnose(system, case.records, bank, seed=order.seed)
        write_json(found, {**_found(diagnosis), "seal": case.seal})
        logger.info("%s: %s", order.key, diagnosis.finding.verdict)


def _found(diagnosis: Diagnosis) -> dict[str, Any]:
    """The part of a diagnosis that is scored."""
    finding, checked = diagnosis.finding, diagnosis.verification
    return {
        "verdict": finding.verdict,
        "named": [] if finding.best is None else list(finding.best.names),
        "sets": [name.split(" + ") for name in finding.ambiguous],
        "simulations": finding.runs,
        "bank": diagnosis.bank_runs,
        "closure": None if checked is None else checked.closure,
        "seconds": diagnosis.seconds,
    }


def read_verdicts(truths: str | Path, verdicts: str | Path, joints: tuple[str, ...]) -> list[Verdict]:
    """Pair verdicts with their truths.

    Args:
        truths: As given to `run_orders`.
        verdicts: Likewise.
        joints: Of the mechanism; where there is one only, names go without it.

    Raises:
        ValueError: A seal is broken.
    """
    out = []
    for path in sorted(Path(verdicts).glob("*.json")):
        found, truth = read_json(path), read_json(Path(truths) / path.name)
        if found["seal"] != truth["seal"]:
            raise ValueError(f"{path.name}: the truth was changed after the diagnosis")
        plain = _plain(joints)
        out.append(
            Verdict(
                frozenset(truth["hidden"]),
                truth["units"],
                found["verdict"],
                frozenset(plain(name) for name in found["named"]),
                tuple(frozenset(plain(name) for name in names) for names in found["sets"]),
                found["simulations"],
                found["closure"],
            )
        )
    return out


def _plain(joints: tuple[str, ...]) -> Any:
    """Names without the joint where there is only one."""
    return (lambda name: name.split(":")[0]) if len(joints) == 1 else (lambda name: name)


def figures(content: Mapping[str, Any]) -> str:
    """A score as text, for logs."""
    return json.dumps({key: value for key, value in content.items() if key != "confusion"}, indent=2)
