"""Errors about misspelt targets name the nearest target that exists."""

import re
from dataclasses import dataclass

import pytest
from snakemake.cli import get_argument_parser

from gsbridge.errors import InputError
from gsbridge.workflow_faults import told
from gsbridge.workflow_targets import check_targets, targets_of


@dataclass
class Made:
    """A rule, as far as it is looked at: its files as snakemake writes their patterns."""

    name: str
    output: list[str]

    def is_producer(self, requested_output: str) -> bool:
        patterns = (re.sub(r"\{\w+,([^{}]*)\}", r"(?:\1)", file.replace(".", r"\.")) for file in self.output)
        return any(re.fullmatch(pattern.replace("+", r"\+"), requested_output) for pattern in patterns)


RULES = [
    Made("simulator", []),
    Made("assemble_tables", ["results/tables"]),
    Made("mesh_object", ["results/scenes/{scene,mug|bowl}/mesh/visual.ply", "results/scenes/{scene,mug|bowl}/mesh/mesh.json"]),
    Made("write_scene_page", ["results/scenes/{scene,mug|bowl}/report.html"]),
    Made("write_study", ["results/study.md", "results/{who}.md"]),
    Made("record_splats", ["results/rerun/splats/{scene,mug|bowl}-{binding,soft|refined}.rrd"]),
    Made("train", ["results/policies/{object,mug|bowl}+{background,table|plate}/seed{seed,[0-9]}/policy.json"]),
    Made("copy", ["results/project/{file,benchmarks/floors.yaml|models/nominal.yaml}"]),
]


@pytest.mark.parametrize(
    ("asked", "advice"),
    [
        ("results/tabels", "Did you mean 'results/tables'?"),
        ("tabels", "Did you mean 'results/tables'?"),
        ("simulater", "Did you mean 'simulator'?"),
        ("results/scenes/mug/mesh.json", "Did you mean 'results/scenes/mug/mesh/mesh.json'?"),
        ("results/scenes/bwol/mesh/mesh.json", "Did you mean 'results/scenes/bowl/mesh/mesh.json'?"),
        ("results/scenes/mug/report.htm", "Did you mean 'results/scenes/mug/report.html'?"),
        # A proposal with a wildcard could not be asked for, and what only lies in the same folder was not meant.
        ("results/scenes/teapot/mesh/mesh.json", "no rule makes this. docs/stages.md lists"),
        ("results/foo", "no rule makes this. docs/stages.md lists"),
        ("results/nosuch", "no rule makes this. docs/stages.md lists"),
        ("results/rerun/splats/mug-sofd.rrd", "Did you mean 'results/rerun/splats/mug-soft.rrd'?"),
        ("results/policies/mug+tabel/seed1/policy.json", "Did you mean 'results/policies/mug+table/seed1/policy.json'?"),
        ("results/project/models/nominel.yaml", "no rule makes this. docs/stages.md lists"),
        ("results/tables/index.html", "It lies in results/tables, which is made as a whole: ask for that."),
        ("zzz", "no rule makes this. docs/stages.md lists"),
    ],
)
def test_a_misspelt_target_is_told_with_what_may_be_meant(asked, advice):
    with pytest.raises(InputError, match=re.escape(advice)) as told_error:
        check_targets([asked], RULES)
    assert str(told_error.value).startswith(f"{asked}: no rule makes this")


def test_a_rule_for_many_files_is_told_with_one_of_them():
    with pytest.raises(InputError, match=r"Ask for one of them: results/scenes/\{scene\}/mesh/mesh\.json$"):
        check_targets(["mesh_object"], RULES)


def test_an_absolute_path_is_told_as_the_run_knows_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"Name it from the folder of the run: results/tables\. "):
        check_targets([str(tmp_path / "results/tables")], RULES)


def test_what_can_be_made_is_not_refused():
    check_targets(
        [
            "simulator",
            "assemble_tables",
            "results/tables/",
            "./results/scenes/mug/mesh/mesh.json",
            "results/project/models/nominal.yaml",
        ],
        RULES,
    )


@pytest.mark.parametrize(
    ("arguments", "targets"),
    [
        (["-n", "--config", "preset=toy", "seed=2", "--", "all", "results/tables"], ["all", "results/tables"]),
        (["results/tables", "--directory", "toy", "--quiet", "rules"], ["results/tables"]),
        (["--forcerun", "record_scores", "--cores", "2"], []),
    ],
)
def test_targets_are_what_snakemake_takes_for_them(arguments, targets):
    assert targets_of(["/bin/snakemake", *arguments], get_argument_parser) == targets
    assert targets_of(["/lib/snakemake/__main__.py", *arguments], get_argument_parser) == targets


def test_arguments_of_another_program_are_no_targets():
    assert targets_of(["/bin/pytest", "-q", "--no-such-option", "tests"], get_argument_parser) == []


def test_an_error_ends_the_run_with_one_line():
    @told()
    def broken():
        raise InputError("mug.mp4", "it is no video", "Film it again")

    with pytest.raises(SystemExit) as stop:
        broken()
    assert stop.value.code == "ERROR mug.mp4: it is no video. Film it again"
