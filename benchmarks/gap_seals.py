"""Score one seal of the gap's benchmark, or a part of it, and record its first score.

    GSBRIDGE_SEAL=12345 python benchmarks/gap_seals.py --tiers t0 t1 --cases 10 --methods training_bic --folder work

The seal alone draws the cases (`gsbridge.experiment.seals`). What is scored is kept in `benchmarks/seals/{seal}.json`, where a
later run of the same part changes nothing. Cases that were diagnosed before in the same folder are not diagnosed again, so a
run that was stopped goes on.

Scores that the workflow has made with a seal are recorded with

    python benchmarks/gap_seals.py --scored results/gap-benchmark/*/scores.json

and, if other methods were scored beside this package's own, with `*/compared.json`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge import logs
from gsbridge.digests import code_digest
from gsbridge.errors import InputError
from gsbridge.experiment.gap_benchmark import methods_of
from gsbridge.experiment.seals import VARIABLE, record_seal, seal_of
from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark import drawing
from gsbridge.gap.benchmark.baselines import METHODS
from gsbridge.gap.benchmark.campaign import OURS, Diagnose, case_keys, diagnose_cases
from gsbridge.gap.benchmark.case_plan import BODIES, IMAGES, SPLITS, TIERS
from gsbridge.gap.benchmark.joint_diagnosis import diagnose_joint_case
from gsbridge.gap.benchmark.photo_diagnosis import diagnose_photo_case
from gsbridge.gap.benchmark.score import score_findings
from gsbridge.gap.benchmark.throw_diagnosis import diagnose_thrown_case
from gsbridge.report.scores.risk_coverage import answered, risk_at

REGISTER = Path(__file__).parent / "seals"

SHOWN = ("named_right", "named_or_covered", "named_wrong", "false_alarm", "unknown_wrong", "interval_coverage")
"""Rates that are recorded."""


def diagnosis(tier: str) -> Diagnose:
    """Way of diagnosing the kind of case that a tier holds."""
    kinds: dict[str, Diagnose] = {BODIES: diagnose_thrown_case, IMAGES: diagnose_photo_case}
    return kinds.get(tier, diagnose_joint_case)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the cases, diagnose and score them, and record the scores."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiers", nargs="+", choices=TIERS, default=list(TIERS))
    parser.add_argument("--cases", type=int, help="of each tier; all without it")
    parser.add_argument("--methods", nargs="+", choices=METHODS[1:], default=[], help="other ways of naming beside")
    parser.add_argument("--folder", type=Path, help="keeps cases, truths and findings")
    parser.add_argument(
        "--scored", type=Path, nargs="+", default=[], help="scores of tiers that are there already; nothing runs"
    )
    parser.add_argument("--register", type=Path, default=REGISTER, help="folder of the seals' scores")
    options = parser.parse_args(arguments)
    logs.start(1, None)
    if options.scored:
        _register(options.scored, options.register)
        return 0
    if options.folder is None:
        parser.error("--folder is missing: it keeps cases, truths and findings")
    seal = seal_of(os.environ)
    if seal is None:
        raise InputError(VARIABLE, "no seal is set", "Set it to a whole number above 10000 that was never scored")
    for tier in options.tiers:
        ways = methods_of(tier, options.methods)
        if set(ways) != set(options.methods):
            left = ", ".join(name for name in options.methods if name not in ways)
            raise InputError("--methods", f"{left} cannot run in tier {tier}", "Score that tier in a call without them")
    for tier in options.tiers:
        folder = options.folder / str(seal) / tier
        cases, truths = folder / "cases", folder / "truths"
        if not (cases / "manifest.json").exists():
            drawing.generate_cases(tier, SPLITS[1], cases, truths, count=options.cases, seal=seal)
        findings = {OURS: folder / "findings", **{name: folder / name for name in options.methods}}
        for method, found in findings.items():
            diagnose_cases(cases, case_keys(cases), found, options.folder / "bank", diagnosis(tier), method=method)
        scores = score_findings(cases, truths, {method: [found] for method, found in findings.items()})
        write_json(folder / "scores.json", scores)
        record_seal(options.register, seal, {tier: _told(scores)})
    return 0


def _register(paths: Sequence[Path], register: Path) -> None:
    """Record the scores of tiers whose cases a seal has drawn.

    Raises:
        InputError: A file is damaged, or holds scores that no seal has drawn.
    """
    found = [read_json(path) for path in paths]
    for path, scores in zip(paths, found, strict=True):
        if not scores.get("seal"):
            raise InputError(path, "no seal has drawn these cases", f"Run the benchmark with {VARIABLE} set to a fresh number")
    for scores in found:
        # This package's own method is scored in a tier, and recorded, before any other.
        part = scores["tier"] if len(scores["methods"]) == 1 else f"{scores['tier']}, all ways of naming"
        record_seal(register, scores["seal"], {part: _told(scores)})


def _told(scores: Mapping[str, Any]) -> dict[str, Any]:
    """Entry of a tier in the register."""
    found = scores["methods"][OURS]
    figures = {key.replace("_", " "): _share(found[key]) for key in SHOWN if found[key]["n"]}
    lists = {method: content["list"] for method, content in scores["methods"].items()}
    coverage = answered(lists[OURS])
    risks = {method: risk_at(rows, coverage) for method, rows in lists.items()} if len(lists) > 1 else {}
    told = [f"{method} {'none' if risk is None else f'{100 * risk:.0f} %'}" for method, risk in risks.items()]
    figures |= {f"wrong among the {100 * coverage:.0f} % of cases that each is surest of:": "; ".join(told)} if told else {}
    code = code_digest(diagnosis(scores["tier"]).__module__, "gsbridge.gap.benchmark.score")
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    ).stdout.strip()
    return {"code": code[:12], "commit": commit, "cases": scores["cases"], "figures": figures}


def _share(rate: Mapping[str, Any]) -> str:
    return f"{round(rate['value'] * rate['n'])} of {rate['n']}"


if __name__ == "__main__":
    sys.exit(main())
