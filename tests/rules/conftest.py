"""Running snakemake as a user does."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.rules.prepared import PreparedSnakemake

ROOT = Path(__file__).resolve().parents[2]

REAL_DATA = ("GSBRIDGE_CAPTURES", "GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS")
"""Variables that name folders of real data; they add jobs to plans."""


@pytest.fixture(scope="session")
def prepared():
    """A process that forks for each call of snakemake, once the modules are there."""
    made = PreparedSnakemake()
    yield made
    made.close()


@pytest.fixture(scope="session")
def snakemake(prepared, tmp_path_factory):
    """Call snakemake in the project's root; returns the finished process.

    Folders of real data that the surroundings name are left out, so that a plan is the same on every machine: a test that wants
    one names it.
    """
    plain = {name: value for name, value in os.environ.items() if name not in REAL_DATA}

    def call(*arguments: str, check: bool = True, **environment: str) -> subprocess.CompletedProcess[str]:
        process = prepared.run(arguments, {**plain, **environment}, tmp_path_factory.mktemp("said"))
        if check:
            assert process.returncode == 0, process.stdout + process.stderr
        return process

    return call


@pytest.fixture
def config():
    """The project's own configuration, to be changed by a test."""
    import yaml

    return yaml.safe_load((ROOT / "config.yaml").read_text())


@pytest.fixture
def write_config(tmp_path):
    """Write a configuration and return the arguments that make snakemake use it alone."""
    import yaml

    def write(content: dict) -> list[str]:
        path = tmp_path / "config.yaml"
        path.write_text(yaml.safe_dump(content))
        return ["--snakefile", str(ROOT / "Snakefile"), "--configfile", str(path), "--replace-workflow-config"]

    return write
