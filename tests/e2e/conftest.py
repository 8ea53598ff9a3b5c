"""The real workflow, run as a user runs it, once for all end-to-end tests."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def call_snakemake(
    folder: Path, *arguments: str, timeout: float = 2700, file_limit: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run snakemake with the project's Snakefile in a folder of its own; no file may outgrow `file_limit` bytes.

    Logs of real machines are left out, whoever names them: their diagnoses take a quarter of an hour, no test here asks about
    them, and recording `gap_real` makes them.
    """
    surroundings = {name: value for name, value in os.environ.items() if name not in ("GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS")}
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--directory", str(folder)]
    return subprocess.run(
        [*command, "--workflow-profile", str(ROOT / "profiles/default"), *arguments],
        cwd=ROOT,
        env=surroundings,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        preexec_fn=None if file_limit is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit)),
    )


@pytest.fixture(scope="session")
def toy(tmp_path_factory):
    """Folder of a finished toy run: every stage on one object and one background, scores included."""
    folder = tmp_path_factory.mktemp("toy")
    policy = "results/policies/grasp/small_cube+foam_pad/gs/default/seed1/policy.json"
    # As `make toy` does: the longest way first.
    targets = ["all", "score_scenes", "results/gap-benchmark/report.html"]
    process = call_snakemake(folder, "--config", "preset=toy", "--prioritize", policy, "--", *targets)
    assert process.returncode == 0, process.stdout[-4000:] + process.stderr[-8000:]
    return folder


@pytest.fixture(scope="session")
def captures():
    """Folder of the real captures."""
    folder = os.environ.get("GSBRIDGE_CAPTURES")
    if not folder or not Path(folder).is_dir():
        pytest.skip("GSBRIDGE_CAPTURES names no folder: the real captures banana/ and apple_video/ are not tested")
    return Path(folder)
