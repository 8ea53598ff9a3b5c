"""Files of `--configfile` are looked at before snakemake reads them: it would show a traceback, or run what they hold."""

import itertools

import pytest
from snakemake.cli import get_argument_parser

from gsbridge.cli import main
from gsbridge.errors import InputError
from gsbridge.workflow_files import check_configuration_files, check_targets, check_workflow, configuration_files

BOMB = "a: &a [1]\n" + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in itertools.pairwise("abcdefgh"))
BROKEN = {
    "missing": (None, "does not exist"),
    "broken": ("seed: [1\nboard: }\n", "line 2, column 6"),
    "list": ("- 1\n- 2\n", "no keys at its top level"),
    "number": ("3\n", "no keys at its top level"),
    "empty": ("", "no keys at its top level"),
    "double": ("seed: 1\nseed: 2\n", "stands twice, in lines 1 and 2"),
    "tag": ("seed: !!python/object:os.system x\n", "line 1, column 7"),
    "bytes": (b"\xff\xfe\x00", "cannot be read"),
    "bomb": (BOMB, "aliases"),
    "program": ("__use_yte__: true\nseed: ?__import__('os').mkdir('made')\n", "snakemake would run code"),
}  # fmt: skip


@pytest.fixture(params=BROKEN)
def broken(request, tmp_path, monkeypatch):
    """A configuration that cannot be used, and words of the sentence that tells why."""
    monkeypatch.chdir(tmp_path)
    text, words = BROKEN[request.param]
    path = tmp_path / f"{request.param}.yaml"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path, words


def test_a_run_with_a_broken_file_ends_in_one_line(broken, tmp_path, capfd):
    path, words = broken
    with pytest.raises(SystemExit) as ended:
        main(["run", "--dry-run", "--configfile", str(path)])
    assert str(ended.value).startswith(f"ERROR {path}: ")
    assert words in str(ended.value)
    assert "\n" not in str(ended.value)
    assert capfd.readouterr() == ("", "")
    assert not (tmp_path / ".snakemake").exists()
    assert not (tmp_path / "made").exists()


def test_the_status_of_such_a_run_is_told_in_one_line(broken, capsys):
    path, words = broken
    assert main(["status", "--configfile", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"gsbridge: {path}: ")
    assert words in line


def test_a_folder_is_no_configuration(tmp_path):
    with pytest.raises(InputError, match="a folder, a device or a pipe"):
        check_configuration_files([tmp_path])


def test_what_snakemake_can_read_passes(tmp_path):
    (tmp_path / "tabs.json").write_text('{\n\t"seed": 1\n}')
    (tmp_path / "more.yaml").write_text("seed: 3\n")
    check_configuration_files([tmp_path / "tabs.json", tmp_path / "more.yaml"])


@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        (["-n", "--config", "seed=1", "--", "all"], []),
        (["--configfile", "a.yaml", "b.yaml", "--", "all"], ["a.yaml", "b.yaml"]),
        (["--configfiles=a.yaml", "-n"], ["a.yaml"]),
        (["--configfile", "a.yaml", "--directory", "toy"], ["a.yaml"]),
        (["--configfile", "a.yaml", "--configfiles", "b.yaml"], ["b.yaml"]),
        (["-n", "--", "--configfile", "a.yaml"], []),
    ],
)
def test_files_are_found_as_snakemake_finds_them(arguments, files):
    assert [str(path) for path in configuration_files(arguments)] == files
    snakemake = get_argument_parser().parse_known_args(arguments)[0].configfile
    assert [str(path) for path in snakemake or []] == files


@pytest.mark.parametrize(
    ("arguments", "taken"),
    [
        (["-n", "--config", "gap_case=a.yaml", "gap"], "gap"),
        (["-n", "-C", "seed=1", "all"], "all"),
        (["-n", "--quiet", "rules", "results/tables"], "results/tables"),
        (["-n", "--quiet", "rules", "--", "results/tables"], None),
        (["--config", "seed=1", "--quiet", "--", "gap"], None),
        (["--quiet=rules", "results/tables"], None),
        (["--config", "editing={scene: bear}", "-n"], None),
        (["gap", "--config", "seed=1"], None),
    ],
)
def test_no_option_swallows_a_target(arguments, taken, capfd):
    if taken is None:
        check_targets(arguments)
        get_argument_parser().parse_args(arguments)
        return
    with pytest.raises(SystemExit) as ended:
        main(["run", *arguments])
    assert f"Write -- before targets: -- {taken}" in str(ended.value)
    assert capfd.readouterr() == ("", "")


def test_a_folder_without_a_workflow_is_told_where_to_go(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    advice = "Snakefile: there is no such file here. Go to the project's folder, or name it with --snakefile"
    with pytest.raises(SystemExit) as ended:
        main(["run", "results/tables"])
    assert str(ended.value) == f"ERROR {advice}"
    assert main(["status"]) == 1
    assert capsys.readouterr().err == f"gsbridge: {advice}\n"
    assert not (tmp_path / ".snakemake").exists()


@pytest.mark.parametrize("arguments", [["--snakefile", "a"], ["--snakefile=a"], ["-s", "a"], ["--profile", "a"], ["--version"]])
def test_a_workflow_may_lie_elsewhere(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_workflow(arguments)
    (tmp_path / "workflow").mkdir()
    (tmp_path / "workflow/Snakefile").touch()
    check_workflow(["results/tables"])
