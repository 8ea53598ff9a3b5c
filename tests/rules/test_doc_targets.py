"""Targets in the documentation can be made: snakemake plans every one of them, with the scenes that the page supposes."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/unit"))

from doc_blocks import PAGES, commands, not_run  # noqa: E402

OPTIONS_WITH_VALUES = ("--config", "--configfile", "--snakefile", "--workflow-profile", "--report", "--directory", "--quiet")
BRACES = re.compile(r"^(.*)\{([\w,]+)\}(.*)$")


def targets():
    """Targets of the pages' calls of snakemake, and of `gsbridge run`, which takes the same arguments."""
    out = set()
    for words in (words for page in PAGES for words in commands(page)):
        if words[:2] == ["gsbridge", "run"]:
            words = words[1:]
        elif words[0] != "snakemake":
            continue
        passed = False
        for before, word in zip(words, words[1:], strict=False):
            passed = passed or word == "--"
            if word.startswith("-") or before in OPTIONS_WITH_VALUES or (not passed and re.match(r"^\w+=", word)):
                continue
            stem = BRACES.match(word)
            out |= {stem[1] + part + stem[3] for part in stem[2].split(",")} if stem else {word}
    return sorted(out)


def calls():
    """Arguments of the calls of the pages that say more than a target, but for those that `NOT_RUN` names."""
    found = [words for page in PAGES for words in commands(page) if not not_run(words)]
    arguments = [words[2:] if words[:2] == ["gsbridge", "run"] else words[1:] for words in found]
    return sorted({" ".join(words): words for words in arguments if any(word.startswith("-") for word in words)}.values())


def prepare(folder):
    """What the pages say that the reader has: a film, a case, and a file of settings."""
    (folder / "mug.mp4").write_bytes(b"")
    for case in ("case.yaml", "photos.yaml", "my_axis/case.yaml", "my_cube/case.yaml"):
        place = folder / case
        place.parent.mkdir(exist_ok=True)
        place.write_text("model: model.yaml\nrecords: {fit: a.csv, select: b.csv, verify: c.csv}\n")
        (place.parent / "model.yaml").write_text("urdf: axis.urdf\ncontroller: {mode: free}\n")
        for name in ("a.csv", "b.csv", "c.csv", "axis.urdf"):
            (place.parent / name).write_text("")
    (folder / "more.yaml").write_text("seed: 3\n")


@pytest.mark.parametrize("words", calls(), ids=" ".join)
def test_every_call_with_options_is_planned_as_it_stands(snakemake, tmp_path, words):
    """In a folder of its own, and with the files that the page supposes."""
    prepare(tmp_path)
    places = {"~/gsbridge/Snakefile": str(ROOT / "Snakefile"), "more.yaml": str(tmp_path / "more.yaml")}
    words = [places.get(word, word) for word in words]
    if "--directory" in words:
        folder = words.index("--directory") + 1
        words[folder] = str(tmp_path / words[folder])
    else:
        words = ["--directory", str(tmp_path), *words]
    planned = snakemake("--dry-run", *words)
    assert "Job stats:" in planned.stdout


def test_every_target_of_the_pages_is_planned(snakemake, config, write_config, tmp_path):
    asked = targets()
    assert {"simulator", "gap", "results/scenes/my_mug/report.html", "results/scenes/foam_pad/asset/asset.json"} <= set(asked)
    prepare(tmp_path)
    filmed = {"source": {"video": str(tmp_path / "mug.mp4")}, "board": "a4", "require_scale": True}
    config["scenes"] |= {"my_mug": {"kind": "object", **filmed}, "my_table": {"kind": "background", **filmed}}
    config["cells"].append({"task": "grasp", "object": "my_mug", "background": "my_table"})
    config["gap"] = {"cases": dict.fromkeys(("my_axis", "my_cube"), str(tmp_path / "case.yaml"))}
    planned = snakemake("--dry-run", "--quiet", "--directory", str(tmp_path), *write_config(config), "--", *asked)
    assert "MissingRuleException" not in planned.stderr
