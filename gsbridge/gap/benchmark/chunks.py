"""The blind benchmark as jobs: drawn cases are diagnosed in chunks that go on where they were killed, and scored per tier."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path

from gsbridge.files import atomic_directory, write_json
from gsbridge.gap.benchmark import campaign, score


def diagnose_chunk(
    cases: str | Path, chunk: int, chunks: int, method: str, bank: str | Path, state: str | Path, out: str | Path, seed: int
) -> None:
    """Diagnose every `chunks`-th case; finished ones are kept in `state` until all are done.

    Args:
        cases: Folder of the cases.
        chunk: Number of this chunk, from 0.
        chunks: Number of chunks.
        method: One of `gsbridge.gap.benchmark.baselines.METHODS`.
        bank: Folder of signatures.
        state: Folder that outlives a killed job.
        out: Folder of the findings.
        seed: Seed of replicates.
    """
    cases = Path(cases)
    # Cases drawn anew have the same names; their manifest tells them apart.
    done = Path(state) / hashlib.sha256((cases / "manifest.json").read_bytes()).hexdigest()[:16]
    done.mkdir(parents=True, exist_ok=True)
    keys = campaign.case_keys(cases, chunk, chunks)
    campaign.diagnose_cases(cases, keys, done, Path(bank), method=method, seed=seed)
    with atomic_directory(out) as folder:
        for key in keys:
            shutil.copy(done / f"{key}.json", folder / f"{key}.json")


def score_tier(
    cases: str | Path, truths: str | Path, findings: Sequence[str | Path], methods: Sequence[str], chunks: int, out: str | Path
) -> None:
    """Score the findings of all methods in one tier.

    Args:
        cases: Folder of the cases.
        truths: Folder of the truths.
        findings: Folders of findings, the chunks of one method side by side.
        methods: Names of the methods.
        chunks: How many folders belong to each method.
        out: `scores.json`.

    Raises:
        InputError: A truth was changed after the diagnosis, or a finding is missing.
    """
    folders = [Path(folder) for folder in findings]
    by_method = {method: folders[k * chunks : (k + 1) * chunks] for k, method in enumerate(methods)}
    write_json(out, score.score_findings(Path(cases), Path(truths), by_method))
