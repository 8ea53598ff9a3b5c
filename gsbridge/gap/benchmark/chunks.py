"""Jobs of the blind benchmark that diagnose its cases, in chunks that can resume after being killed."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

from gsbridge.files import atomic_directory
from gsbridge.gap.benchmark import campaign


def diagnose_chunk(
    cases: str | Path,
    chunk: int,
    chunks: int,
    diagnose: campaign.Diagnose,
    method: str,
    bank: str | Path,
    state: str | Path,
    out: str | Path,
    seed: int,
) -> None:
    """Diagnose one of `chunks` parts of the cases; findings stay in `state` until the whole part is done.

    Args:
        cases: Folder of the cases.
        chunk: Number of this chunk, from 0.
        chunks: Number of chunks.
        diagnose: Diagnoses a case of this tier's kind.
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
    campaign.diagnose_cases(cases, keys, done, Path(bank), diagnose, method=method, seed=seed)
    with atomic_directory(out) as folder:
        for key in keys:
            shutil.copy(done / f"{key}.json", folder / f"{key}.json")
