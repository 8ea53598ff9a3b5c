"""CPU seconds of each rule before and after, as a table: `python -m benchmarks.time_per_rule BEFORE AFTER`.

BEFORE and AFTER are each a folder of benchmark files that snakemake leaves (`results/benchmarks`), or the file that
`record_timings` makes from one (`timings.csv.gz`). Jobs that only one of the two has are left out, since otherwise a run with
fewer scenes would look fast.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from gsbridge.report.tables.timing import COLUMNS, timing_rows


def jobs(source: Path) -> pd.Series:
    """CPU time of each job, s, by rule and item."""
    if source.is_dir():
        table = pd.DataFrame(timing_rows(sorted(source.rglob("*.jsonl"))), columns=COLUMNS)
    else:
        table = pd.read_csv(source)
    table = table.fillna({"item": ""})
    return pd.to_numeric(table.set_index(["rule", "item"]).cpu_s).dropna()


def main() -> None:
    """Print the table, the heaviest rule first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="folder or file of the earlier run")
    parser.add_argument("after", type=Path, help="folder or file of the later run")
    arguments = parser.parse_args()
    both = pd.concat({"before": jobs(arguments.before), "after": jobs(arguments.after)}, axis=1).dropna()
    rules = both.groupby("rule").agg(jobs=("before", "size"), before=("before", "sum"), after=("after", "sum"))
    rules.loc["together"] = rules.sum()
    print("| rule | jobs | before, CPU s | after, CPU s | ratio |\n|---|---|---|---|---|")
    for rule, row in rules.sort_values("before", ascending=False).iterrows():
        ratio = f"{row.after / row.before:.2f}" if row.before else "–"
        print(f"| {rule} | {row.jobs:.0f} | {row.before:.1f} | {row.after:.1f} | {ratio} |")


if __name__ == "__main__":
    main()
