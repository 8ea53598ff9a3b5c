"""Rows of the timing table, from the benchmark files that snakemake leaves."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.report.tables.rows import write_rows

logger = logging.getLogger("gsbridge")

COLUMNS = ("rule", "item", "wall_s", "cpu_s", "max_rss_mb")


def name_of(path: str | Path) -> tuple[str, str]:
    """Rule and item of a benchmark file: `benchmarks/{rule}/{item…}.jsonl` or `{item}/benchmarks/{rule}.jsonl`.

    Raises:
        InputError: The path has no `benchmarks` folder.
    """
    parts = Path(path).with_suffix("").parts
    if "benchmarks" not in parts[:-1]:
        raise InputError(path, "the rule cannot be told from this path", "Keep benchmark files below benchmarks/")
    index = len(parts) - 1 - parts[::-1].index("benchmarks")
    below = parts[index + 1 :]
    if len(below) > 1:
        return below[0], "/".join(below[1:])
    above = [parts[k + 1] for k in range(index) if parts[k] == "scenes" and k + 1 < index]
    return below[0], above[-1] if above else ""


def timing_rows(benchmarks: Sequence[str | Path]) -> list[dict[str, Any]]:
    """Make rows of all intact benchmark files; times are averaged over repeats of a job, memory is their maximum."""
    rows = []
    for path in benchmarks:
        rule, item = name_of(path)
        try:
            lines = [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines() if line.strip()]
            wall = [float(line["s"]) for line in lines]
            cpu = [_number(line.get("cpu_time")) for line in lines]
            memory = [_number(line.get("max_rss")) for line in lines]
        except (OSError, json.JSONDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
            # A job that is still running may be writing its file, and a killed one may have left half a line.
            logger.warning("%s is left out of the timing table: this is no whole benchmark (%r)", path, error)
            continue
        if not wall:
            continue
        known_cpu = [value for value in cpu if value is not None]
        known_memory = [value for value in memory if value is not None]
        rows.append(
            {
                "rule": lines[0].get("rule_name") or rule,
                "item": item,
                "wall_s": f"{sum(wall) / len(wall):.2f}",
                "cpu_s": f"{sum(known_cpu) / len(known_cpu):.2f}" if known_cpu else None,
                "max_rss_mb": f"{max(known_memory):.1f}" if known_memory else None,
            }
        )
    return sorted(rows, key=lambda row: (row["rule"], row["item"]))


def _number(value: Any) -> float | None:
    """Number of a benchmark entry; snakemake writes `NA`, `-` or null for jobs too short to be sampled."""
    if isinstance(value, str) and value.strip() in {"", "NA", "-"}:
        return None
    return None if value is None else float(value)


def write_timing_rows(benchmarks: Sequence[str | Path], out_csv: str | Path) -> None:
    """Write `rows/timing.csv`: rule, item, wall and CPU seconds, peak memory in MB."""
    write_rows(out_csv, COLUMNS, timing_rows(benchmarks))
