"""Interface of a diagnosis; joints, thrown bodies and pictures implement it, each with its own statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.amend import amend_model
from gsbridge.geometry import Array


class Backend(Protocol):
    """A checked case of one kind, with one method for each stage."""

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a case from its file and check it.

        Raises:
            InputError: Something in the case cannot be used.
        """

    @classmethod
    def load(cls, model: str | Path, data: str | Path, about: Mapping[str, Any]) -> Self:
        """Load a case from the results of `save` and `about`.

        Args:
            model: File of the model.
            data: File that `save` wrote (`.npz`).
            about: The return value of `about`, read back from `records.json`.

        Raises:
            InputError: A file is missing or damaged.
        """

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result is degraded."""

    def save(self, data: str | Path) -> None:
        """Write the measurements (`.npz`)."""

    def about(self) -> dict[str, Any]:
        """Return the content of `records.json`; its `mode` is the kind of case."""

    def compare(self) -> dict[str, Any]:
        """Return the content of `comparison.json`: residuals of the model as it is, and where they show."""

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """Fill the bank, and return the content of `screen.json`.

        It says which effects show in the records and which effects have similar signatures, before any fit.
        """

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """Return the content of `findings.json`: what is missing, tested on `verify`."""

    def amend(self, model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
        """Write the model with the effects that were found.

        Args:
            model: File of the model.
            findings: Content of `findings.json`.
            out: File of the amended model.
        """

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return the measurements and the replays without and with `effects` as arrays, and the content of `replays.json`."""


@dataclass(frozen=True)
class CaseBackend:
    """Parts that all backends share.

    Args:
        case: A checked case with its `model`, the `names` of effects to consider (None for all), and `reasons`.
    """

    case: Any

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result is degraded."""
        return self.case.reasons

    def described(
        self, digest: str, mode: str, parts: Mapping[str, Mapping[str, Any]], joints: Sequence[str] = (), **figures: Any
    ) -> dict[str, Any]:
        """Return the content of `records.json`.

        Args:
            digest: SHA-256 of all that a simulation depends on.
            mode: Kind of case, or how a mechanism is driven.
            parts: Summary of the measurements for a reader, by role.
            joints: Names of a mechanism's joints.
            figures: Further entries.
        """
        names = self.case.names
        about = {"model": str(self.case.model), "mechanism_digest": digest, "joints": list(joints), "mode": mode, **figures}
        return {**about, "effects": None if names is None else list(names), "records": dict(parts)}

    def amend(self, model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
        """Write the model with the named effects and the evidence for them.

        Args:
            model: File of the model.
            findings: Content of `findings.json`.
            out: File of the amended model.
        """
        amend_model(model, findings, out)


def stored_names(about: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the effects to consider, as `CaseBackend.described` stored them; None for all."""
    return None if about["effects"] is None else tuple(about["effects"])


def best_effects(findings: Mapping[str, Any]) -> tuple[Applied, ...]:
    """Return all effects of the account, named or not; without an account, those of the best explanation."""
    account = findings.get("account")
    return tuple(
        Applied(item["name"], item["joint"] or "", {name: row["value"] for name, row in item["parameters"].items()})
        for item in (account["entries"] if account else findings["effects"])
    )
