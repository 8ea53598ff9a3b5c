"""A case's file and its model, which have to be there before anything of the case runs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.gap.formats.files import case_model, case_path
from gsbridge.reading import absent


def check_own_file(value: str | None, places: Sequence[Path]) -> None:
    """Refuse a case that is given by its file alone, and whose file is not there.

    Args:
        value: The file; None where no case is given.
        places: Folders that it may be relative to, in this order.

    Raises:
        InputError: It is in none of them.
    """
    if not value:
        return
    try:
        case_path("", value, places)
    except InputError as error:
        raise InputError("config: gap_case", error.problem, error.remedy) from error


def check_model(case: str | Path, made: Path) -> None:
    """Refuse a case whose model is not there; snakemake would only say that an input is missing.

    Records and photos that are not there are told by the stage that reads them, case by case.

    Args:
        case: The case's file.
        made: Folder of models that the workflow may make first.

    Raises:
        InputError: The model that the case names is neither there nor in that folder.
    """
    case, model = Path(case), case_model(case)
    if model != case and not os.path.isfile(model) and not Path(os.path.abspath(model)).is_relative_to(os.path.abspath(made)):
        problem = f"the model is a folder: {model}" if os.path.isdir(model) else f"the model is missing: {absent([model])}"
        raise InputError(case, problem, f"Correct the line `model:`, whose path starts from {case.parent}")
