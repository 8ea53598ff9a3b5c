"""Controls of the closed loops: amendments with a wrong effect that changes the simulation as much as the named one.

If a policy trained with such a model did as well, any change of that size would help, and not the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.errors import StageError
from gsbridge.files import read_json
from gsbridge.gap.diagnosis.amend import ordered, write_amended
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.image.model import image_candidates
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.loop.amend import amended_content
from gsbridge.geometry import Array

_CLOSE = 0.02
"""Largest relative difference between two sizes that count as equal."""

_TRIES = 40


def wrong_effect(
    residual: Callable[[Sequence[Applied]], Array], named: Sequence[Applied], who: Sequence[Candidate], seed: int
) -> Applied:
    """Return an effect that was not named, with the size at which it changes the residual as much as the named ones do.

    Args:
        residual: Returns the whitened residual with given effects. [T, C].
        named: The named effects.
        who: Candidates.
        seed: Random seed that decides which candidate is taken, and its direction.

    Raises:
        StageError: No candidate can change as much within the bounds of its parameters.
    """
    plain = residual(())
    wanted = float(np.linalg.norm(residual(named) - plain))
    taken = {effect.name for effect in named}
    left = [one for one in who if one.name not in taken and one.effect.amendable]
    rng = np.random.default_rng(seed)
    for number in rng.permutation(len(left)):
        candidate = left[number]
        ways = candidate.effect.directions()
        way = ways[int(rng.integers(len(ways)))]
        found = _sized(candidate, way, residual, plain, wanted)
        if found is not None:
            return found
    raise StageError("wrong name", "no other effect changes as much as the named one", "Name fewer effects, or smaller ones")


def _sized(
    who: Candidate, way: Mapping[str, float], residual: Callable[[Sequence[Applied]], Array], plain: Array, wanted: float
) -> Applied | None:
    """Return an effect scaled so that it changes the residual by the norm `wanted`; None if no multiple of `way` does."""
    low, high, factor = 0.0, np.inf, 1.0
    for _ in range(_TRIES):
        applied = who.applied(who.effect.scaled(way, factor))
        change = residual((applied,)) - plain
        size = float(np.linalg.norm(change)) if np.isfinite(change).all() else np.inf
        if abs(size / wanted - 1.0) < _CLOSE:
            return applied
        low, high = (factor, high) if size < wanted else (low, factor)
        if np.isinf(high):
            if who.applied(who.effect.scaled(way, 2.0 * factor)) == applied:  # on its bounds already
                return None
            factor *= 2.0
        else:
            factor = 0.5 * (low + high)
    return None


def amend_arm_wrongly(
    nominal: str | Path, arm: str | Path, case: str | Path, findings: str | Path, model: str | Path, seed: int
) -> None:
    """Write the simulation's model with the calibrated arm and an effect that was not named.

    Args:
        nominal: File of the simulation's original model.
        arm: File of the arm's calibrated model.
        case: File of the case that was diagnosed.
        findings: File of the findings (`findings.json`).
        model: File to write the simulation's amended model to.
        seed: Random seed that decides which effect is taken.

    Raises:
        StageError: Nothing was named, or no other effect changes as much.
    """
    found, read = read_json(findings), read_joint_case(case)
    mechanism = Mechanism(read.system)
    view = JointResiduals.of(mechanism, read.records["verify"])
    wrong = wrong_effect(view.residual, _named(found, findings), candidates(view), seed)
    content = read_yaml(arm, "model", "docs/gap.md")
    content["effects"] = [*(content.get("effects") or []), wrong.record()]
    amended, _ = amended_content(read_yaml(nominal, "model", "models/nominal.yaml"), content, arm)
    write_amended(model, amended, _head(wrong, found))


def amend_camera_wrongly(
    nominal: str | Path, photos: tuple[str, str, str], findings: str | Path, model: str | Path, seed: int
) -> None:
    """Write the simulation's model with an image effect that was not named.

    Args:
        nominal: File of the simulation's original model.
        photos: Folders of the views, of the photos before, and of the photos after.
        findings: File of the findings (`findings.json`).
        model: File to write the amended model to.
        seed: Random seed that decides which effect is taken.

    Raises:
        StageError: Nothing was named, or no other effect changes as much.
    """
    found, pairs = read_json(findings), read_pairs(*photos)
    view = ImageResiduals(pairs["verify"], learn_noise(list(pairs.values())))
    who = [one for one in image_candidates() if view.tells(one) and not one.effect.noise_only]
    wrong = wrong_effect(view.residual, _named(found, findings), who, seed)
    content = read_yaml(nominal, "model", "models/nominal.yaml")
    content = ordered({**content, "effects": [*(content.get("effects") or []), wrong.record()]}, nominal)
    write_amended(model, content, _head(wrong, found))


def _named(found: Mapping[str, Any], source: str | Path) -> list[Applied]:
    """Return the effects that findings amend.

    Raises:
        StageError: The findings name nothing.
    """
    if not found["amended"]:
        raise StageError("wrong name", f"nothing was named ({found['verdict']})", f"See {source}")
    return [Applied(item["name"], item.get("joint") or "", item["parameters"]) for item in found["amended"]]


def _head(wrong: Applied, found: Mapping[str, Any]) -> list[str]:
    names = " and ".join(item["name"] for item in found["amended"])
    return [
        f"A control: '{wrong.name}' changes as much as '{names}', which was named, and was not found.",
        f"seed {found['seed']}",
    ]
