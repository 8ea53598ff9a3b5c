"""Jobs of the blind benchmark: diagnosis of cases in chunks that can resume after being killed, and scoring of a tier."""

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
    """Diagnose one of `chunks` parts of the cases; findings stay in `state` until the whole part is done.

    Args:
        cases: Folder of the cases.
        chunk: Number of this chunk, from 0.
        chunks: Number of chunks.
        method: One of `gsbridge.gap.benchmark.baselines.METHODS`.
        bank: Folder of signatures.
        state: Folder of finished findings, which is kept if the job is killed.
        out: Folder of the findings, written when all are done.
        seed: Seed of replicates.
    """
    cases = Path(cases)
    # The digest of the manifest keeps findings of redrawn cases apart, since their names are the same.
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
        findings: Folders of findings: all chunks of the first method, then those of the second, and so on.
        methods: Names of the methods.
        chunks: Number of folders per method.
        out: File to write: `scores.json`.

    Raises:
        InputError: A truth was changed after the diagnosis, or a finding is missing.
    """
    folders = [Path(folder) for folder in findings]
    by_method = {method: folders[k * chunks : (k + 1) * chunks] for k, method in enumerate(methods)}
    write_json(out, score.score_findings(Path(cases), Path(truths), by_method))
