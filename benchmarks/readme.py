"""Quote in README.md the recorded figures that this tree would still make: `python -m benchmarks.readme` (`--check` to
check)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import yaml

from gsbridge.configuration.whole import read_configuration
from gsbridge.experiment.provenance import provenances
from gsbridge.report.scores.readme_block import write_readme_block

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """Write or check the block of figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where the block is not as it should be")
    arguments = parser.parse_args()
    config = read_configuration(yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8")))
    good = write_readme_block(ROOT / "README.md", ROOT / "benchmarks/scores", provenances(config), check=arguments.check)
    if arguments.check and not good:
        sys.exit("README.md quotes figures that are not those of this tree: run `make results-page`")


if __name__ == "__main__":
    main()
