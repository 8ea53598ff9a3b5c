"""A project that was moved, copied or cloned anew plans nothing on finished results; a changed file or script still does.

The rules, parameters and records are the real ones. Only the work is left out: every script writes small files in place of its
outputs, so that a whole preset is done in seconds.
"""

import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gsbridge.configuration.bindings import BINDINGS

ROOT = Path(__file__).resolve().parents[2]
PARTS = ["Snakefile", "config.yaml", "rules", "profiles", "models", "benchmarks", "envs", "gsbridge"]
WORK = '''"""Stands in for a job: what it makes depends on what it is given."""
import hashlib
from pathlib import Path

made = hashlib.sha256()
for name in map(str, snakemake.input):
    files = sorted(file for file in Path(name).rglob("*") if not file.name.startswith(".")) or [Path(name)]
    for file in files:
        made.update(file.read_bytes() if file.is_file() else b"")
for name in map(str, snakemake.output):
    path = Path(name)
    if path.suffix:
        path.write_text(f"{{name}} {{made.hexdigest()}} {script}")
    else:
        path.mkdir(exist_ok=True)
        (path / "0000.png").write_text(f"{{name}} {{made.hexdigest()}}")
'''
SCENES = {
    "pan": {"kind": "object", "source": {"video": "captures/pan.mp4"}},
    "cup": {"kind": "object", "source": {"images": "captures/cup"}},
    "jar": {"kind": "object", "source": {"colmap": "captures/jar/sparse/0"}},
    "jug": {"kind": "object", "source": {"nerfstudio": "captures/jug/transforms.json"}},
}
CAPTURES = {
    "pan.mp4": "film",
    "cup/a.jpg": "one",
    "cup/b.jpg": "two",
    "jar/sparse/0/cameras.bin": "cameras",
    "jar/sparse/0/images.bin": "poses",
    "jar/sparse/0/points3D.bin": "points",
    "jar/images/a.jpg": "one",
    "jug/transforms.json": '{"frames": [{"file_path": "images/a"}]}',
    "jug/images/a.jpg": "one",
}
RECORDS = [f"results/scenes/{name}/capture/keyframes.json" for name in SCENES]
TARGETS = ["all", "score_scenes", *RECORDS]


def snakemake(project, *arguments):
    """What a run says, with the code of the project that it is asked for."""
    command = [sys.executable, "-m", "snakemake", "--directory", "toy", "--config", "preset=toy", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    process = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert process.returncode == 0, process.stdout[-3000:] + process.stderr[-3000:]
    return process.stdout + process.stderr


def planned(project):
    """Number of jobs by rule that a dry run plans."""
    said = snakemake(project, "--dry-run", "--quiet", "rules", "--", *TARGETS)
    jobs = dict(re.findall(r"^(\w+) +(\d+)$", said.partition("Job stats:")[2], re.MULTILINE))
    assert jobs or "Nothing to be done" in said
    jobs.pop("total", None)
    return {rule: int(count) for rule, count in jobs.items()}


def copied(project, folder):
    """A copy whose dates say nothing, as after a clone, an unpacked archive or a careless `cp -r`."""
    shutil.copytree(project, folder, copy_function=shutil.copyfile)
    now, draw = (folder / "Snakefile").stat().st_mtime, random.Random(1)
    for path in folder.rglob("*"):
        date = now - draw.uniform(0, 1e6)
        os.utime(path, (date, date))
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A project with a finished toy preset and four captures of its owner."""
    project = tmp_path_factory.mktemp("first") / "project"
    project.mkdir()
    for name in PARTS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, project / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, project / name)
    (project / "scripts").mkdir()
    for script in (ROOT / "scripts").glob("*.py"):
        (project / "scripts" / script.name).write_text(WORK.format(script=script.stem))
    config = yaml.safe_load((project / "config.yaml").read_text())
    config["scenes"].update(SCENES)
    (project / "config.yaml").write_text(yaml.safe_dump(config))
    for name, content in CAPTURES.items():
        path = project / "captures" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    snakemake(project, "--cores", "2", "--", *TARGETS)
    return project


def test_nothing_is_left_to_do_where_it_ran(finished):
    assert planned(finished) == {}


def test_a_moved_project_plans_nothing(finished, tmp_path):
    assert planned(copied(finished, tmp_path / "elsewhere" / "renamed")) == {}


def test_what_was_changed_is_done_again_there(finished, tmp_path):
    """Changed to something as long as before: no size tells."""
    project = copied(finished, tmp_path / "elsewhere")
    changed = {name: str.swapcase for name in CAPTURES if not name.endswith("transforms.json")}
    files = {f"captures/{name}": change for name, change in changed.items()}
    files["scripts/draw_success.py"] = lambda text: text.replace("draw_success", "draw_SUCCESS")
    files["toy/results/scenes/foam_pad/mesh/visual.ply"] = str.swapcase
    for name, change in files.items():
        path = project / name
        before, text = path.stat(), path.read_text()
        path.write_text(change(text))
        assert change(text) != text
        assert path.stat().st_size == before.st_size
    jobs = planned(project)
    assert jobs["select_keyframes"] == len(SCENES)
    assert jobs["draw_success"] == 1
    # The preset has two scenes, and only the one whose mesh has changed is made again.
    assert (jobs["train_splats"], jobs["build_asset"]) == (len(BINDINGS), 1)
    assert not {"film_scene", "reconstruct_cameras", "align_scene", "mesh_object", "mesh_background"} & set(jobs)


def test_a_stage_that_makes_the_same_with_new_code_reruns_nothing_after_it(finished, tmp_path):
    project = copied(finished, tmp_path / "elsewhere")
    script = project / "scripts/mesh_object.py"
    script.write_text(script.read_text() + "made.digest()\n")
    said = snakemake(project, "--cores", "2", "--until", "mesh_object", "--", *TARGETS)
    assert re.search(r"^mesh_object +1$", said, re.MULTILINE)
    assert planned(project) == {}
