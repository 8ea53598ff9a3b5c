"""Estimate what limits the time of a run of 100 scenes and 50 cells: `python -m benchmarks.scale`.

Snakemake plans the run; the estimate gives every job the time that jobs of its rule took when they were measured.
`--measured FOLDER` reads new times from the folder of benchmark files that snakemake leaves (`toy/results/benchmarks`), and
keeps them in `benchmarks/job_times.csv`. The table goes into docs/cluster.md, between two marks.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from gsbridge.files import atomic_file

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/cluster.md"
TIMES = ROOT / "benchmarks/job_times.csv"
BEGIN, END = "<!-- scale: `python -m benchmarks.scale` writes this block -->", "<!-- end of scale -->"
CORES = (2, 16, 100, 1000)
VIDEO = "film.mp4"
HEAVIEST = 10
"""Number of rules that have a row of their own; the others share one."""


def measured_times(folder: Path) -> pd.DataFrame:
    """Median wall time, s, and greatest memory, MB, of one job by rule, and the number of jobs that were measured.

    Args:
        folder: Files that snakemake's `benchmark:` wrote, one folder per rule.
    """
    rows = []
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        jobs = [json.loads(path.read_text().splitlines()[-1]) for path in sorted(place.rglob("*.jsonl"))]
        seconds = [float(job["s"]) for job in jobs]
        memory = [float(job["max_rss"]) for job in jobs if isinstance(job["max_rss"], (int, float))]
        if seconds:
            most = round(max(memory)) if memory else 0
            rows.append({"rule": place.name, "jobs": len(seconds), "s": round(statistics.median(seconds), 1), "mb": most})
    return pd.DataFrame(rows)


def large_configuration(scenes: int, cells: int) -> dict[str, Any]:
    """The toy preset on more scenes, filmed by a phone, half of them objects and half backgrounds, and a cell for each pair.

    Args:
        scenes: Number of scenes, even.
        cells: Number of cells, at most as many as there are pairs of scenes.
    """
    config = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
    preset = config["presets"]["toy"]
    objects = ["small_cube", *(f"object_{number}" for number in range(2, scenes // 2 + 1))]
    backgrounds = ["foam_pad", *(f"background_{number}" for number in range(2, scenes // 2 + 1))]
    for kind, names in (("object", objects[1:]), ("background", backgrounds[1:])):
        for name in names:
            config["scenes"][name] = {"kind": kind, "source": {"video": VIDEO}, "board": "a4", "require_scale": True}
    preset["scenes"] = [*objects, *backgrounds]
    pairs = list(zip(objects, backgrounds, strict=True))[:cells]
    preset["cells"] = [{"task": "grasp", "object": item, "background": background} for item, background in pairs]
    config["preset"] = "toy"
    return dict(config)


def planned_graph(config: dict[str, Any]) -> tuple[dict[str, str], list[tuple[str, str]]]:
    """Rule of each job that snakemake would run from nothing, and which job waits for which (first before second)."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "config.yaml")
        Path(folder, VIDEO).write_text("stands for the films of a phone: a plan opens none")
        file.write_text(yaml.safe_dump(config), encoding="utf-8")
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--configfile", str(file)]
        command += ["--replace-workflow-config", "--directory", folder, "--dag", "dot", "--", "all"]
        environment = {**os.environ, "GSBRIDGE_CAPTURES": folder}
        said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env=environment).stdout
    rules = dict(re.findall(r'^\s*(\d+)\[label = "(\w+)', said, re.MULTILINE))
    return rules, re.findall(r"^\s*(\d+) -> (\d+)", said, re.MULTILINE)


def longest_way(rules: dict[str, str], edges: list[tuple[str, str]], seconds: dict[str, float]) -> list[str]:
    """Jobs of the chain that takes longest (the critical path), in the order in which they run.

    Args:
        rules: Rule of each job.
        edges: Which job comes before which.
        seconds: Time of one job by rule, s; rules that are not listed count as 0 s.
    """
    before: dict[str, list[str]] = {job: [] for job in rules}
    for first, second in edges:
        before[second].append(first)
    ways: dict[str, tuple[float, list[str]]] = {}

    def way(job: str) -> tuple[float, list[str]]:
        if job not in ways:
            longest, jobs = max((way(other) for other in before[job]), key=lambda found: found[0], default=(0.0, []))
            ways[job] = longest + seconds.get(rules[job], 0.0), [*jobs, job]
        return ways[job]

    return max((way(job) for job in rules), key=lambda found: found[0])[1]


def block(scenes: int, cells: int) -> str:
    """The table, and the sentences about it."""
    times = pd.read_csv(TIMES).set_index("rule")
    seconds, memory = times.s.to_dict(), times.mb.to_dict()
    rules, edges = planned_graph(large_configuration(scenes, cells))
    counts = Counter(rules.values())
    work = {rule: count * seconds.get(rule, 0.0) / 3600 for rule, count in counts.items()}
    whole = sum(work.values())
    heavy = sorted(work, key=lambda rule: -work[rule])[:HEAVIEST]
    lines = ["| rule | jobs | one job, s | memory, MB | hours on one core | share |", "|---|---|---|---|---|---|"]
    for rule in heavy:
        row = f"{counts[rule]} | {seconds[rule]:.0f} | {memory[rule]:.0f} | {work[rule]:.1f} | {100 * work[rule] / whole:.0f} %"
        lines.append(f"| `{rule}` | {row} |")
    rest = set(counts) - set(heavy)
    hours = sum(work[rule] for rule in rest)
    lines.append(
        f"| {len(rest)} others | {sum(counts[rule] for rule in rest)} | | | {hours:.1f} | {100 * hours / whole:.0f} % |"
    )
    way = longest_way(rules, edges, seconds)
    chain = sum(seconds.get(rules[job], 0.0) for job in way) / 3600
    walls = ", ".join(f"{max(whole / cores, chain):.1f} h on {cores:,}" for cores in CORES)
    stations = " → ".join(f"`{rules[job]}`" for job in way if seconds.get(rules[job], 0.0) >= 1)
    unknown = sorted(set(counts) - set(seconds) - {"all"})
    return "\n".join(
        [
            f"{scenes} scenes and {cells} cells at the toy's budgets, planned by snakemake: {len(rules):,} jobs, "
            f"{whole:.0f} hours",
            "on one core. Every job takes the median of its rule in `benchmarks/job_times.csv`; other work ran beside those.",
            "",
            *lines,
            "",
            f"**What bounds it.** No number of cores ends it before its longest way, {chain:.2f} h: {stations}.",
            f"With ideal scheduling it takes at least {walls} cores; beyond {whole / chain:.0f} cores nothing is gained.",
            f"Rules that were not measured count as nothing: {', '.join(f'`{rule}`' for rule in unknown) or 'none'}.",
        ]
    )


def main() -> None:
    """Write the block into the page; with `--measured`, update the times first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measured", type=Path, help="folder of benchmark files whose times are kept")
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--cells", type=int, default=50)
    arguments = parser.parse_args()
    if arguments.measured:
        measured_times(arguments.measured).to_csv(TIMES, index=False)
    text = PAGE.read_text(encoding="utf-8")
    start, end = text.index(BEGIN), text.index(END)
    with atomic_file(PAGE) as temporary:
        written = f"{text[:start]}{BEGIN}\n\n{block(arguments.scenes, arguments.cells)}\n\n{text[end:]}"
        temporary.write_text(written, encoding="utf-8")


if __name__ == "__main__":
    main()
