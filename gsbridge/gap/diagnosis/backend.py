"""What a diagnosis asks of whatever was measured: joints, thrown bodies and pictures answer it, each by its own statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.amend import amend_model
from gsbridge.geometry import Array


class Backend(Protocol):
    """A checked case of one kind, and what the stages do with it."""

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """A case from its file, checked.

        Raises:
            InputError: Something in it cannot be used.
        """

    @classmethod
    def load(cls, model: str | Path, data: str | Path, about: Mapping[str, Any]) -> Self:
        """Make a case again from what `save` and `about` have left.

        Args:
            model: File of the model.
            data: File that `save` wrote (`.npz`).
            about: What `about` gave, read from `records.json`.

        Raises:
            InputError: A file is missing or damaged.
        """

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result is degraded."""

    def save(self, data: str | Path) -> None:
        """Write the measurements (`.npz`)."""

    def about(self) -> dict[str, Any]:
        """Content of `records.json`; `mode` tells the kind of case."""

    def compare(self) -> dict[str, Any]:
        """Content of `comparison.json`: residuals of the model as it is, and where they show."""

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """Content of `screen.json`: which effects show, and which have similar signatures, before any fit. Fills the bank."""

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """Content of `findings.json`: what is missing, proven on `verify`."""

    def amend(self, model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
        """Write the model with what was found.

        Args:
            model: File of the model.
            findings: Content of `findings.json`.
            out: File of the amended model.
        """

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Measurements and replays before and after, as arrays, and the content of `replays.json` about them."""


@dataclass(frozen=True)
class CaseBackend:
    """Parts that all backends share.

    Args:
        case: A checked case with its `model`, the `names` of effects that may be the reason, and `reasons`.
    """

    case: Any

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result is degraded."""
        return self.case.reasons

    def described(
        self, digest: str, mode: str, parts: Mapping[str, Mapping[str, Any]], joints: Sequence[str] = (), **figures: Any
    ) -> dict[str, Any]:
        """Content of `records.json`.

        Args:
            digest: SHA-256 of all that a simulation depends on.
            mode: Kind of case, or how a mechanism is driven.
            parts: What a person wants to know about what was measured, by role.
            joints: Joints of a mechanism.
            figures: Further entries.
        """
        names = self.case.names
        about = {"model": str(self.case.model), "mechanism_digest": digest, "joints": list(joints), "mode": mode, **figures}
        return {**about, "effects": None if names is None else list(names), "records": dict(parts)}

    def amend(self, model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
        """Write the model with what was named and the evidence for it.

        Args:
            model: File of the model.
            findings: Content of `findings.json`.
            out: File of the amended model.
        """
        amend_model(model, findings, out)


def stored_names(about: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Effects that may be the reason, as `described` has stored them."""
    return None if about["effects"] is None else tuple(about["effects"])


def best_effects(findings: Mapping[str, Any]) -> tuple[Applied, ...]:
    """All effects of the account, whether named or not; of the best explanation where there is no account."""
    account = findings.get("account")
    return tuple(
        Applied(item["name"], item["joint"] or "", {name: row["value"] for name, row in item["parameters"].items()})
        for item in (account["entries"] if account else findings["effects"])
    )
