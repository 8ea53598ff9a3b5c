"""Checks, before any stage of a case runs, that the case's file, its model and its records exist."""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.gap.formats.files import case_content, case_model, case_path
from gsbridge.gap.formats.logs import split_part
from gsbridge.reading import absent
from gsbridge.tasks.views import ROLES


def check_own_file(value: str | None, places: Sequence[Path]) -> None:
    """Refuse a case that is given only by its file if that file does not exist.

    Args:
        value: Path of the file; None or empty if no case is given.
        places: Folders that the path may be relative to, in order of preference.

    Raises:
        InputError: None of the folders contains the file.
    """
    if not value:
        return
    try:
        case_path("", value, places)
    except InputError as error:
        raise InputError("config: gap_case", error.problem, error.remedy) from error


def check_named(case: str | Path, made: Path) -> None:
    """Refuse a case whose model or records do not exist.

    Args:
        case: The case's file.
        made: Folder of models and records that the workflow may make first.

    Raises:
        InputError: For the reasons listed at `check_model` and `check_records`.
    """
    check_model(case, made)
    check_records(case, made)


def check_model(case: str | Path, made: Path) -> None:
    """Refuse a case whose model does not exist; snakemake would only say that an input is missing.

    Args:
        case: The case's file.
        made: Folder of models that the workflow may make first.

    Raises:
        InputError: The model that the case names neither exists nor belongs into that folder.
    """
    case, model = Path(case), case_model(case)
    if model != case and not os.path.isfile(model) and not _below(model, made):
        problem = f"the model is a folder: {model}" if os.path.isdir(model) else f"the model is missing: {absent([model])}"
        raise InputError(case, problem, f"Correct the line `model:`, whose path starts from {case.parent}")


def check_records(case: str | Path, made: Path) -> None:
    """Refuse a case with a record that does not exist or whose role is unknown; the workflow's plan would not notice it.

    Missing photos and the content of records are checked later, by the stage that reads them.

    Args:
        case: The case's file.
        made: Folder of records that the workflow may make first.

    Raises:
        InputError: A record's role is unknown, or the record neither exists nor belongs into that folder.
    """
    case = Path(case)
    for section in ("records", "repeats"):
        named = case_content(case).get(section)
        for role, files in named.items() if isinstance(named, dict) else ():
            if role not in ROLES:
                near = difflib.get_close_matches(str(role), ROLES, 1)
                hint = f"Did you mean '{near[0]}'? " if near else ""
                raise InputError(
                    case, f"'{role}' under '{section}' is no role of a record", f"{hint}The roles are {', '.join(ROLES)}"
                )
            for name in files if isinstance(files, list) else [files]:
                file = split_part(case.parent / str(name))[0]
                if not os.path.exists(file) and not _below(file, made):
                    raise InputError(
                        case, f"the record '{role}' is missing: {absent([file])}"[:500],
                        f"Correct its line under `{section}:`, whose path starts from {case.parent}",
                    )  # fmt: skip


def _below(file: Path, folder: Path) -> bool:
    """Whether a path lies below a folder; neither has to exist."""
    return Path(os.path.abspath(file)).is_relative_to(os.path.abspath(folder))
