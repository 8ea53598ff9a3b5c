"""What the pages ask snakemake for can be made: every target of theirs is planned, with the scenes that they suppose."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/unit"))

from doc_blocks import PAGES, commands  # noqa: E402

OPTIONS_WITH_VALUES = ("--config", "--configfile", "--snakefile", "--workflow-profile", "--report", "--directory")
BRACES = re.compile(r"^(.*)\{([\w,]+)\}(.*)$")


def targets():
    """Targets of the pages' calls of snakemake."""
    out = set()
    for words in (words for page in PAGES for words in commands(page)):
        if words[0] != "snakemake":
            continue
        passed = False
        for before, word in zip(words, words[1:], strict=False):
            passed = passed or word == "--"
            if word.startswith("-") or before in OPTIONS_WITH_VALUES or (not passed and re.match(r"^\w+=", word)):
                continue
            stem = BRACES.match(word)
            out |= {stem[1] + part + stem[3] for part in stem[2].split(",")} if stem else {word}
    return sorted(out)


def test_every_target_of_the_pages_is_planned(snakemake, config, write_config, tmp_path):
    asked = targets()
    assert {"simulator", "gap", "results/scenes/my_mug/report.html", "results/scenes/foam_pad/asset/asset.json"} <= set(asked)
    (tmp_path / "mug.mp4").write_bytes(b"")
    config["scenes"]["my_mug"] = {"kind": "object", "source": {"video": str(tmp_path / "mug.mp4")}, "board": "a4"}
    (tmp_path / "case.yaml").write_text("model: model.yaml\nrecords: {fit: a.csv, select: b.csv, verify: c.csv}\n")
    (tmp_path / "model.yaml").write_text("urdf: axis.urdf\ncontroller: {mode: free}\n")
    for name in ("a.csv", "b.csv", "c.csv", "axis.urdf"):
        (tmp_path / name).write_text("")
    config["gap"] = {"cases": dict.fromkeys(("my_axis", "my_cube"), str(tmp_path / "case.yaml"))}
    planned = snakemake("--dry-run", "--quiet", "--directory", str(tmp_path), *write_config(config), "--", *asked)
    assert "MissingRuleException" not in planned.stderr
