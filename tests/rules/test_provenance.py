"""Recorded figures say whether the tree would still make them."""

import re
from pathlib import Path

import pytest

from gsbridge.configuration.whole import read_configuration
from gsbridge.experiment.gap_benchmark import AREAS as GAP
from gsbridge.experiment.provenance import _OF_NOMINAL, RULES, provenance, provenances, settings_behind
from gsbridge.report.scores.results_page import AREAS, freshness, read_record

ROOT = Path(__file__).resolve().parents[2]
WITHOUT_FIGURES = {"compile_kernels", "copy_project_file"}
"""Jobs that make nothing that is measured: compiled code, and the floors themselves."""


@pytest.mark.parametrize("area", AREAS)
def test_the_rules_behind_an_area_are_those_that_are_planned(snakemake, tmp_path, area):
    call = ["--dry-run", "--quiet", "host", "--directory", str(tmp_path), "--", f"results/scores/{area}.json"]
    # Captures and logs of real things are planned only where their folders are.
    captures = tmp_path / "captures"
    for folder in ("banana/images", "flowerpot/images", "apple_video"):
        (captures / folder).mkdir(parents=True)
    (captures / "apple_video/apple.mp4").touch()
    folders = {"GSBRIDGE_MEASURED": "measured", "GSBRIDGE_ROBOTS": "robots", "GSBRIDGE_CAPTURES": str(captures)}
    plan = snakemake(*call, **folders).stdout
    planned = set(re.findall(r"(?m)^(\w+)\s+\d+$", plan)) - {"total"} - WITHOUT_FIGURES
    assert planned == set(RULES[area])
    assert len(RULES[area]) == len(planned)


def test_settings_of_other_presets_and_scenes_do_not_count(config):
    whole = read_configuration(config)
    before = settings_behind(whole)
    scene = next(iter(whole["scenes"]))
    other = next(name for name in whole["presets"] if name != whole["preset"])
    assert settings_behind({**whole, "presets": {**whole["presets"], other: {}}}) == before
    assert {name for name in settings_behind({**whole, "seed": whole["seed"] + 1}) if before[name] is not None} == set(before)
    changed = settings_behind({**whole, "scenes": {**whole["scenes"], scene: {}, "new": {}}})
    assert {name for name, digest in before.items() if changed[name] != digest} == {f"scenes.{scene}"}


def test_settings_of_the_gap_s_benchmark_count_where_they_are_read(config):
    whole = read_configuration(config)
    alone = {f"gap.{key}" for key in ("split", "benchmark", "methods", "contents", "chunks")}
    read = {area: {"gap.split", "gap.benchmark", "gap.chunks"} for area in ("gap", "gap_rivals", "gap_bodies", "gap_pictures")}
    read["gap_rivals"].add("gap.methods")
    read["gap_pictures"].add("gap.contents")
    for area in AREAS:
        found = {name for name in provenance(area, whole)["settings"] if name.startswith("gap.")}
        assert found == {"gap.cases", *read.get(area, ())}, area
    # Only these may read one of the settings: the benchmark's rules, which belong to no other area, and checks before any job.
    keys = "|".join(key.removeprefix("gap.") for key in alone)
    readers = {
        path.name for path in (ROOT / "rules").glob("*.smk") if re.search(rf'GAP\["({keys})"\]|\bBENCHMARK\.', path.read_text())
    }
    assert readers == {"common.smk", "gap_benchmark.smk"}
    assert not [path.name for path in (ROOT / "rules").glob("*.smk") if 'config["gap"]' in path.read_text()]
    rules = set(re.findall(r"(?m)^rule (\w+):", (ROOT / "rules/gap_benchmark.smk").read_text()))
    assert not rules & {rule for area in AREAS if area not in GAP for rule in RULES[area]}


def test_figures_about_logs_depend_on_no_scene(config):
    whole = read_configuration(config)
    logs = [area for area in AREAS if "reconstruct_cameras" not in RULES[area]]
    assert set(logs) == {"gap", "gap_rivals", "gap_bodies", "gap_real"}
    for area in logs:
        found = {name.split(".")[0] for name in provenance(area, whole)["settings"]}
        assert found == {"gap", "preset", "presets", "seed"}, area
        assert provenance(area, {**whole, "worlds": {}, "scenes": {}}) == provenance(area, whole)
    changed = provenance("policies", {**whole, "worlds": {**whole["worlds"], "mirror": {"seed": 5}}})
    assert changed != provenance("policies", whole)
    # Their rules stand in one file. All that it reads of the settings is named in `_FOR_LOGS`, apart from the gap's own.
    text = (ROOT / "rules/gap_benchmark.smk").read_text()
    rules = set(re.findall(r"(?m)^rule (\w+):", text))
    assert all(set(RULES[area]) <= rules for area in logs)
    assert set(re.findall(r'config\["(\w+)"\]', text)) == {"preset"}
    capitals = set(re.findall(r"\b([A-Z]{3,}(?:_[A-Z]+)*)\b", text)) - {"GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS", "GSBRIDGE_SEAL"}
    assert capitals == {"BENCHMARK", "GAP", "GAP_BANK", "SEAL", "SEED"}


def test_an_edited_model_changes_the_areas_whose_rules_read_it(config, tmp_path):
    whole = read_configuration(config)
    variants = {**whole["variants"], "own": {**whole["variants"]["default"], "model": "models/own.yaml"}}
    whole = {**whole, "variants": variants}
    (tmp_path / "models").mkdir()
    found = {}
    for text in ("gravity: 9.81", "gravity: 9.82"):
        (tmp_path / "models/nominal.yaml").write_text(text)
        found[text] = {area: provenance(area, whole, tmp_path) for area in AREAS}
    (tmp_path / "models/own.yaml").write_text("gravity: 1.0")
    own = {area: provenance(area, whole, tmp_path) for area in AREAS}
    first, second = found.values()
    readers = {"shapes", "simulator", "policies", "worlds", "severity", "worth", "study", "loops"}
    assert {area for area in AREAS if first[area] != second[area]} == readers
    # What is known of real things is no model, but a file that figures depend on as on one.
    assert {area for area in AREAS if "models" in first[area]} == readers | {"photos"}
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks/photos.json").write_text("{}")
    assert provenance("photos", whole, tmp_path) != second["photos"]
    assert {area for area in AREAS if own[area] != second[area]} == readers - {"shapes", "simulator"}
    # As digests of the settings and of the rules are, those of the models are the tree's own by default.
    assert provenance("policies", whole)["models"]["models/own.yaml"] == "missing"


def test_the_rules_that_read_the_nominal_model_are_named():
    text = "".join(path.read_text() for path in sorted((ROOT / "rules").glob("*.smk")))
    blocks = dict(re.findall(r"(?ms)^(?:use )?rule (\w+)(.*?)(?=^(?:use )?rule |^def |\Z)", text))
    reading = {name for name, block in blocks.items() if re.search(r"nominal\.yaml|simulated_(world|scene)\b", block)}
    scored = {rule for rules in RULES.values() for rule in rules}
    assert reading & scored == set(_OF_NOMINAL)


def test_the_page_tells_which_figures_are_of_this_tree(config):
    """After a change of code or settings, `make results-page` writes the states anew."""
    page = (ROOT / "benchmarks/RESULTS.md").read_text()
    whole = read_configuration(config)
    assert set(RULES) == set(AREAS) == set(provenances(whole))
    for area in AREAS:
        record = read_record(ROOT / f"benchmarks/scores/{area}.json")
        state = freshness(area, record["provenance"], provenance(area, whole)) if record else "not recorded"
        line = next(line for line in page.splitlines() if line.startswith(f"| [{area}]"))
        assert ("| fresh |" in line) == (state == "fresh"), area
