"""Tables of text cells as Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "−": r"$-$",
    "–": r"--",
    "±": r"$\pm$",
    "≥": r"$\geq$",
    "≤": r"$\leq$",
    "†": r"\textdagger{}",
    "…": r"\ldots{}",
    "→": r"$\rightarrow$",
    "·": r"$\cdot$",
}


@dataclass(frozen=True)
class Table:
    """A table ready to print.

    Args:
        title: Caption.
        columns: Headings.
        rows: Cells; as many per row as headings.
        notes: Lines below the table.
        best: (row, column) cells to emphasise.
        status: Status of each row (`pass`, `degraded`), or empty.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    best: frozenset[tuple[int, int]] = field(default=frozenset())
    status: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"{self.title}: a row has another number of cells than there are columns")


def markdown(table: Table) -> str:
    """The table in GitHub's Markdown."""
    lines = [f"### {table.title}", "", _pipe(table.columns), "|" + "---|" * len(table.columns)]
    for index, row in enumerate(table.rows):
        lines.append(_pipe([f"**{text}**" if (index, k) in table.best and text else text for k, text in enumerate(row)]))
    for note in table.notes:
        lines += ["", note]
    return "\n".join(lines) + "\n"


def _pipe(cells: Sequence[str]) -> str:
    """One line of a Markdown table."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in cells) + " |"


def latex_text(text: str) -> str:
    """Text with LaTeX's own characters escaped."""
    return "".join(_LATEX.get(character, character) for character in text)


def latex(table: Table, label: str) -> str:
    """A `table` environment with `booktabs` rules; wide tables shrink to the line."""
    head = " & ".join(latex_text(text) for text in table.columns) + r" \\"
    body = []
    for index, row in enumerate(table.rows):
        cells = [latex_text(text) for text in row]
        body.append(
            " & ".join(rf"\textbf{{{c}}}" if (index, k) in table.best and c else c for k, c in enumerate(cells)) + r" \\"
        )
    lines = [
        r"\begin{table}[t]",
        rf"\caption{{{latex_text(table.title)}}}",
        rf"\label{{tab:{label}}}",
        r"\centering",
        r"\small",
        r"\resizebox{\linewidth}{!}{%",
        r"\begin{tabular}{l" + "r" * (len(table.columns) - 1) + "}",
        r"\toprule",
        head,
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}}",
    ]
    if table.notes:
        lines.append(r"\par\smallskip\footnotesize " + " ".join(latex_text(note) for note in table.notes))
    return "\n".join([*lines, r"\end{table}"]) + "\n"
