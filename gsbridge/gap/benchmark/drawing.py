"""The first step of the blind benchmark: draw cases and hide their truths, without any use of the diagnosis."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, write_json
from gsbridge.gap.benchmark.body_cases import BODY, KNOWN, body_twins, draw_shown_case, write_body_case
from gsbridge.gap.benchmark.body_cases import UNKNOWN_OF as UNKNOWN_BODIES
from gsbridge.gap.benchmark.case_plan import BODIES, IMAGES, SCORED, SPLITS, TIERS, PlannedCase, plan_cases
from gsbridge.gap.benchmark.generate import DrawnCase, NotShownError, draw_case
from gsbridge.gap.benchmark.hidden_parts import true_parameters
from gsbridge.gap.benchmark.images import SIZES, STILL, STRANGE, DrawnImageCase, draw_image_case
from gsbridge.gap.benchmark.images import image_site as world_of
from gsbridge.gap.benchmark.mechanisms import BenchmarkMechanism, MechanismSite
from gsbridge.gap.benchmark.noises import STATED
from gsbridge.gap.benchmark.photo_cases import contents_of, write_photos
from gsbridge.gap.benchmark.sites import MechanismSites
from gsbridge.gap.benchmark.twins import twins_of
from gsbridge.gap.formats.records import TOOL, Record
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m", "tool": "m"}
_SLIDING = {"position": "m", "velocity": "m/s", "effort": "N"}

_REDRAWS = 20
"""Largest number of attempts to draw a case, each with one effect replaced by another joint or effect."""


def generate_tier(
    tier: str,
    split: str,
    count: int | None,
    seed: int,
    cases: str | Path,
    truths: str | Path,
    photos: Sequence[str | Path] = (),
    renders: Sequence[str | Path] = (),
    seal: int | None = None,
) -> None:
    """Draw the cases of a tier and hide their truths.

    Args:
        tier: One of `TIERS`.
        split: One of `SPLITS`.
        count: Number of cases; None for the tier's full number.
        seed: Seed of everything.
        cases: Folder to create for the cases.
        truths: Folder to create for the truths; their hashes are in the cases' manifest.
        photos: Folders of photos that may texture the tables of the worlds of `t4`.
        renders: Folders of renders of splats for the same purpose.
        seal: Number that decides the draw of a scored split instead of `split` and `seed`.
    """
    contents = contents_of(photos, renders)
    generate_cases(tier, split, Path(cases), Path(truths), count=count, seed=seed, contents=contents, seal=seal)


def generate_cases(
    tier: str,
    split: str,
    cases: str | Path,
    truths: str | Path,
    *,
    count: int | None = None,
    seed: int = 0,
    contents: Sequence[Sequence[Array]] = ((),),
    seal: int | None = None,
) -> dict[str, Any]:
    """Draw the cases of a tier, with the truths in a folder of their own.

    Args:
        tier: One of `TIERS`.
        split: One of `SPLITS`.
        cases: Folder to create with `manifest.json` (with the SHA-256 of every truth and record), `models`, and a folder per
            case.
        truths: Folder to create with `{key}.json` and `{key}.npz`; no diagnosis may read it.
        count: Number of cases; `TIER_SIZE[tier]` by default. A smaller count keeps the mix.
        seed: Seed of the draw.
        contents: Sets of images, one of which textures the table in each world of photos; an empty set stands for paint. The
            worlds use the sets in turn. Each image [H, W, 3].
        seal: Number that decides the draw of a scored split instead of `split` and `seed`; see `gsbridge.experiment.seals`.

    Returns:
        The manifest.

    Raises:
        InputError: There is no such tier or split.
    """
    if tier not in TIERS or split not in SPLITS:
        raise InputError(
            "benchmark", f"there is no tier '{tier}' with a split '{split}'", f"Use {', '.join(TIERS)}; {', '.join(SPLITS)}"
        )
    if seal is not None:
        split, seed = SCORED, seal
    order = Ordered(tier, split, count, seed, seal)
    with atomic_directory(cases) as made, atomic_directory(truths) as hidden:
        if tier == IMAGES:
            plant, rows = "camera", _photo_cases(made, hidden, order, contents)
        elif tier == BODIES:
            plant, rows = BODY, _body_cases(made, hidden, order)
        else:
            plant, rows = _motion_cases(made, hidden, order)
        manifest = {"tier": tier, "split": split, "seed": seed, "seal": seal, "plant": plant, "cases": rows}
        write_json(made / "manifest.json", manifest)
    return manifest


@dataclass(frozen=True)
class Ordered:
    """An order of cases of a tier.

    Args:
        tier: The tier.
        split: The split.
        count: Number of cases; None for the tier's full number.
        seed: Seed of the draw.
        seal: The seal; None if there is none.
    """

    tier: str
    split: str
    count: int | None
    seed: int
    seal: int | None

    def plan(self, names: tuple[str, ...], strange: tuple[str, ...]) -> tuple[PlannedCase, ...]:
        """Plan the cases, given the effects that may be hidden from the catalogue and from outside it."""
        return plan_cases(self.tier, self.split, names, strange, self.count, self.seed, self.seal)


def _motion_cases(made: Path, hidden: Path, ordered: Ordered) -> tuple[str, list[dict[str, Any]]]:
    """Draw cases of an axis, an arm or further machines; return the kind of mechanism and the manifest's rows."""
    sites, rows = MechanismSites(ordered.tier, ordered.split, made / "models"), []
    for order in ordered.plan(sites.names, sites.strange):
        site = sites.at(order.course_seed)
        order, case = _drawn(site, sites.placed(order))
        records = _write_case(made / order.key, site, order, case)
        rows.append({"key": order.key, "courses": order.course_seed, "records": records})
        rows[-1]["truth_sha256"] = _write_truth(hidden, site, order, case, ordered)
        logger.info("%s drawn", order.key)
    return sites.kind, rows


def _body_cases(made: Path, hidden: Path, ordered: Ordered) -> list[dict[str, Any]]:
    """Draw cases of thrown bodies; return the manifest's rows."""
    rows = []
    strange = UNKNOWN_BODIES[ordered.split]
    for number, order in enumerate(ordered.plan(tuple(KNOWN), strange)):
        pool = strange if order.kind == "unknown" else tuple(KNOWN)
        case = draw_shown_case(order.names, order.units, order.seed, pool)
        # The number stands for the courses: no two cases share throws, and so none share a bank.
        row = {"key": order.key, "courses": number, "records": write_body_case(made / order.key, case)}
        truth = {**_common(order, ordered), "plant": BODY, "hidden": dict(case.hidden), "units": case.units, "sigma": {}}
        # The planned effects: those that show in no scene were replaced, so that visible effects are more frequent.
        truth["asked"] = list(order.names)
        truth |= {"parameters": dict(case.parameters), "settings": dict(case.settings)}
        truth["twins"] = body_twins(tuple(sorted(case.hidden)))
        rows.append({**row, "truth_sha256": _sealed_truth(hidden, truth, {})})
        logger.info("%s drawn", order.key)
    return rows


def _photo_cases(made: Path, hidden: Path, ordered: Ordered, contents: Sequence[Sequence[Array]]) -> list[dict[str, Any]]:
    """Draw cases of photos; return the manifest's rows."""
    rows = []
    for order in ordered.plan(tuple(SIZES), tuple(STRANGE)):
        pictures = contents[order.course_seed % len(contents)]
        order, case = _drawn_photos(order, pictures)
        (made / order.key).mkdir()
        records = write_photos(made / order.key, case.pairs)
        rows.append({"key": order.key, "courses": order.course_seed, "records": records})
        truth = {**_common(order, ordered), "plant": "camera", "hidden": dict(case.hidden), "twins": [], "sigma": {}}
        truth["content"] = f"{len(pictures)} pictures" if len(pictures) else "paint"
        rows[-1]["truth_sha256"] = _sealed_truth(hidden, truth, {"clean": case.clean, "plain": case.plain})
        logger.info("%s drawn", order.key)
    return rows


def _drawn_photos(order: PlannedCase, pictures: Sequence[Array]) -> tuple[PlannedCase, DrawnImageCase]:
    """Draw a case of photos; replace effects that do not reach the wanted size in its views.

    Raises:
        InputError: No effects that were tried reach the wanted size.
    """
    site, rng = world_of(order.course_seed, pictures), np.random.default_rng(order.seed)
    # The camera also moves in half of the other cases, so that motion does not reveal effects that show in motion alone.
    wanders = bool(rng.integers(2))
    for _ in range(_REDRAWS):
        moving = wanders or any(name in STILL for name in order.names)
        try:
            return order, draw_image_case(site, order.names, order.units, order.seed, moving=moving)
        except ValueError as error:
            logger.info("%s: %s", order.key, error)
            pool = [name for name in (STRANGE if order.kind == "unknown" else SIZES) if name not in order.names]
            names = rng.choice(pool, len(order.names), replace=False)
            order = replace(order, names=tuple(sorted(str(name) for name in names)))
    raise InputError("benchmark", f"nothing of {order.units:g} units could be hidden in photos", "Take other worlds")


def _drawn(site: MechanismSite, order: PlannedCase) -> tuple[PlannedCase, DrawnCase]:
    """Draw a case; replace an effect that does not show by the same effect on another joint, else by another effect.

    Raises:
        InputError: No effects that were tried show as wanted.
    """
    rng, failed = np.random.default_rng(order.seed), set[str]()
    for _ in range(_REDRAWS):
        try:
            case = draw_case(
                site.plant, order.names, order.units, order.seed, order.course_seed,
                duration=order.duration, rate=site.rate, kinds=order.channels, spoil=order.noise, lost=order.lost,
                touched=order.touched,
            )  # fmt: skip
        except NotShownError as error:
            logger.info("%s: %s", order.key, error)
            lost = error.name
        else:
            if all(len(twin) >= len(case.hidden) for twin in twins_of(site.kind, case.hidden, order.channels)):
                return order, case
            # If a smaller set has the same equation, one effect is redundant, such as a short delay beside a short lag.
            lost = order.names[-1]
        failed.add(lost)
        kept = [name for name in order.names if name != lost]
        pool = site.strange if order.kind == "unknown" else site.names
        left = [name for name in pool if name not in failed and all(_effect(name) != _effect(other) for other in kept)]
        same = [name for name in left if _effect(name) == _effect(lost)]
        if not left:
            break
        order = replace(order, names=tuple(sorted([*kept, str(rng.choice(same or left))])))
    raise InputError("benchmark", f"nothing could be hidden; {', '.join(sorted(failed))} do not show", "Take other courses")


def _effect(name: str) -> str:
    """Return the name of a hidden effect without its joint."""
    return name.split(":")[0]


def _write_case(folder: Path, site: MechanismSite, order: PlannedCase, case: DrawnCase) -> dict[str, str]:
    """Write records and case file, and return the records' SHA-256 by role."""
    folder.mkdir()
    digests = {}
    for role, record in case.records.items():
        path = folder / f"{role}.csv"
        _table(record, site.system.sliding).to_csv(path, index=False, float_format="%.7g")
        digests[role] = hashlib.sha256(path.read_bytes()).hexdigest()
    content: dict[str, Any] = {
        "model": f"../models/{site.folder}/model.yaml",
        "records": {role: f"{role}.csv" for role in case.records},
    }
    if order.noise == "understated":
        content["noise"] = {kind: STATED * float(np.min(site.plant.noise[kind])) for kind in order.channels}
    (folder / "case.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return digests


def _table(record: Record, sliding: Sequence[str]) -> pd.DataFrame:
    """Make a table of a record, with units in its headers."""
    columns = {"time [s]": record.time}
    for kind, values in {**record.commands, **record.measured}.items():
        for number, column in enumerate(values.T):
            joint = record.joints[number] if kind != TOOL else ""
            unit = _SLIDING.get(kind, "m") if joint in sliding else _UNITS.get(kind, "rad")
            columns[f"{record.label(kind, number)} [{unit}]"] = column
    return pd.DataFrame(columns)


def _write_truth(folder: Path, site: MechanismSite, order: PlannedCase, case: DrawnCase, ordered: Ordered) -> str:
    """Write the truth of a mechanism's case, and return its SHA-256."""
    plant: BenchmarkMechanism = site.plant
    truth = {
        **_common(order, ordered),
        "plant": site.kind,
        "hidden": dict(case.hidden),
        "parameters": {name: _parameters(site, name, size) for name, size in case.hidden.items()},
        "twins": [sorted(names) for names in twins_of(site.kind, case.hidden, order.channels)],
        "sigma": {kind: plant.noise[kind] for kind in order.channels},
    }
    return _sealed_truth(folder, truth, {**case.clean, **{f"plain_{kind}": values for kind, values in case.plain.items()}})


def _parameters(site: MechanismSite, name: str, size: float) -> dict[str, float]:
    """Return the parameters that a perfect diagnosis would give, if an effect has several; else empty."""
    effect, _, joint = name.partition(":")
    number = site.plant.joints.index(joint) if joint else 0
    return true_parameters(effect, size, number, joint in site.system.sliding)


def _common(order: PlannedCase, ordered: Ordered) -> dict[str, Any]:
    """Return the entries of truths in all tiers, with a salt so that their SHA-256 reveals nothing."""
    return {
        "key": order.key,
        "kind": order.kind,
        "noise": order.noise,
        "known": order.kind != "unknown",
        "units": order.units,
        "lost": order.lost,
        "salt": np.random.default_rng([order.seed, ordered.seed, SPLITS.index(ordered.split)]).bytes(16).hex(),
    }


def _sealed_truth(folder: Path, truth: Mapping[str, Any], clean: Mapping[str, Array]) -> str:
    """Write a truth and the noise-free measurements, and return the truth's SHA-256."""
    arrays, path = folder / f"{truth['key']}.npz", folder / f"{truth['key']}.json"
    content: dict[str, Any] = dict(clean)
    np.savez_compressed(arrays, **content)
    write_json(path, {**truth, "clean_sha256": hashlib.sha256(arrays.read_bytes()).hexdigest()})
    return hashlib.sha256(path.read_bytes()).hexdigest()
