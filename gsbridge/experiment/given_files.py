"""Contents of the files that a user gives: captures, logs and trials. Snakemake goes by dates, which tell less.

A file may take the place of a newer one, as where the second of two takes is moved over the first, and a folder's date changes
with every copy.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from gsbridge.experiment.capture_files import capture_files, content_digests
from gsbridge.experiment.plan import Experiment

Listing = list[tuple[str, str]]
"""Names and digests of files."""


@dataclass(frozen=True)
class GivenFiles:
    """Listings of the user's files of an experiment, which rules take as parameters.

    Args:
        plan: The experiment.
    """

    plan: Experiment

    def scene(self, scene: str) -> Listing:
        """Files of a scene's capture; none for a film, which a rule makes.

        Raises:
            InputError: The folder holds so many files that it cannot be a capture.
        """
        kind, value = self.plan.source(scene)
        return [] if kind == "film" else self._capture(kind, value, f"captures/{scene}")

    @property
    def board(self) -> Listing:
        """Files of the board capture that registers the workspace; none where a rule makes it, or poses are typed.

        Raises:
            InputError: The folder holds so many files that it cannot be a capture.
        """
        kind, value = next(iter(self.plan.config["workspace"]["source"].items()))
        return self._capture("images", value, "captures/board") if kind == "capture" else []

    def case(self, name: str, case: str | Path, files: Iterable[str | Path]) -> Listing:
        """A case of the gap, and the files that it names.

        Args:
            name: Name of the case.
            case: Its file.
            files: The files that it names.
        """
        return self.files([case, *files], Path(case).parent, f"gap/{name}")

    def trials(self, table: str, files: Iterable[str]) -> Listing:
        """Trials on a robot that a table shows.

        Args:
            table: Name of the table.
            files: Its tables of trials.
        """
        return self.files(files, ".", f"trials/{table}")

    def _capture(self, kind: str, value: str, store: str) -> Listing:
        path = self.plan.working / self.plan.capture_path(value)
        folder = path if path.is_dir() else path.parent
        return self.files([path, *capture_files(kind, path)], folder, store)

    def files(self, files: Iterable[str | Path], folder: str | Path, store: str) -> Listing:
        """Names and digests of files.

        Args:
            files: The files, below the working folder or absolute; what is not there does not count, nor do results.
            folder: Folder that the names are relative to.
            store: Name of the file that remembers the digests, below `results/.state` and without its suffix.
        """
        working = self.plan.working
        results = (working / "results").resolve()
        places = [working / file for file in files]
        given = [place for place in places if place.is_file() and not place.resolve().is_relative_to(results)]
        return content_digests(given, working / folder, working / f"results/.state/{store}.json")
