"""Diagnosis of photos against earlier photos or rendered images: learn the noise, identify effects, verify them."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.closure import closed
from gsbridge.gap.diagnosis.findings import Account, Diagnosis
from gsbridge.gap.diagnosis.results import ROLES, Rules, Verification
from gsbridge.gap.image.doubts import check_compared
from gsbridge.gap.image.identify import ImageIdentification
from gsbridge.gap.image.model import image_candidates
from gsbridge.gap.image.null import ImageNull
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.image.splat_error import ENOUGH, SplatError, SplatResiduals, check_enough, reduced
from gsbridge.geometry import Array

UNSTEADY = (
    "second photos of the same views differ by more than independent noise of each pixel: the camera, the light or the robot "
    "is not steady, or the photos are compressed or denoised"
)

SPLAT_RULES = Rules(most=2)
"""Thresholds for photos compared with rendered images. At most two effects are named: a third would fit the model error."""

UNPROVEN = "names against drawn pictures are not proven yet: in the mirror a wrong one was seen; see docs/gap_images.md"
FEW = "few photos of the day on which all was well: what drawn pictures lack is known roughly"


def diagnose_images(
    pairs: Mapping[str, Pairs], *, names: Collection[str] | None = None, rules: Rules | None = None, seed: int = 0
) -> Diagnosis:
    """Diagnose what changed between earlier and later photos of the same views.

    Args:
        pairs: Photos by role: `fit`, `select`, `verify`; each role has views of its own.
        names: Effects among which the diagnosis searches; None for all image effects.
        rules: Thresholds; None for the default ones.
        seed: Seed of replicates.

    Raises:
        InputError: A role is missing.
    """
    missing = [role for role in ROLES if role not in pairs]
    if missing:
        raise InputError("photos", f"there are none for '{missing[0]}'", f"Give views for each of {', '.join(ROLES)}")
    begin = time.perf_counter()
    check_compared(pairs)
    noise = learn_noise([pairs[role] for role in ROLES])
    views = {role: ImageResiduals(pairs[role], noise) for role in ROLES}
    return _diagnosed(views, names, rules or Rules(), seed, begin, noise.levels())


def diagnose_splats(
    pairs: Mapping[str, Pairs],
    error: SplatError,
    *,
    names: Collection[str] | None = None,
    rules: Rules | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Diagnose why photos differ from rendered images of the same states by more than the model error of the renderings.

    Args:
        pairs: Rendered images (`before`, `again`) and photos (`after`) by role.
        error: Model error of rendered images, learnt from photos of the registration's day.
        names: Effects among which the diagnosis searches; None for all image effects.
        rules: Thresholds; None for `SPLAT_RULES`.
        seed: Seed of replicates.
    """
    begin = time.perf_counter()
    views = {role: SplatResiduals(error.corrected(reduced(pairs[role])), error) for role in ROLES}
    return _diagnosed(views, names, rules or SPLAT_RULES, seed, begin, {"model": error.left[-1]})


def _diagnosed(
    views: Mapping[str, ImageResiduals],
    names: Collection[str] | None,
    rules: Rules,
    seed: int,
    begin: float,
    floor: Mapping[str, float],
) -> Diagnosis:
    """Identify effects on the roles `fit` and `select`, and verify them on `verify`.

    Args:
        views: Residuals by role, in units of the noise or of the model error.
        names: Effects among which the diagnosis searches; None for all.
        rules: Thresholds.
        seed: Seed of replicates.
        begin: Start of the diagnosis, a value of `time.perf_counter`, s.
        floor: Levels of the noise or model error, for the findings.
    """
    finding = ImageIdentification(views["fit"], views["select"], image_candidates(names), rules, seed).run()
    verification = None
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = verify_images(views["verify"], effects, np.random.default_rng(seed))
        said = finding.verdict in ("named", "ambiguous")
        # Several effects mimic what is missing more easily than one, so they must close more of the gap.
        wanted = rules if len(effects) == 1 else replace(rules, closure=rules.several)
        finding = finding.refuted() if said and not verification.transfers(wanted) else finding
    runs = sum(view.expectation.pictures for view in views.values())
    return Diagnosis(finding, verification, floor, 0, runs, time.perf_counter() - begin)


def verify_images(view: ImageResiduals, effects: Sequence[Applied], rng: np.random.Generator) -> Verification:
    """Judge effects on held-out views that were used neither for fitting nor for choosing.

    Args:
        view: Residuals on the role `verify`.
        effects: Effects that were found on the other roles.
        rng: Random numbers for the null distribution.

    Returns:
        The gap without and with the effects, overall and by channel, and the p-value of what remains.
    """
    before, after = view.residual(), view.residual(effects)
    sizes = [view.size_of(table) for table in (before, after)]
    parts = [channel_sizes(view, table) for table in (before, after)]
    channels = {name: (parts[0][name], parts[1][name]) for name in parts[0]}
    closure = closed(before, after, view.numbers / before.size)
    p_remaining = ImageNull.of(view, rng).p_value(view, after)
    return Verification(sizes[0], sizes[1], closure, channels, sizes[1] <= sizes[0] + 1e-9, p_remaining)


def unsteady(pairs: Mapping[str, Pairs], rules: Rules | None = None, seed: int = 0) -> tuple[str, ...]:
    """Check that repeated photos of a view differ from the first ones by no more than noise.

    Args:
        pairs: Photos by role.
        rules: Thresholds; None for the default ones.
        seed: Seed of the null distribution.

    Returns:
        The reason why a diagnosis is degraded; empty if the photos are steady.
    """
    noise = learn_noise([pairs[role] for role in ROLES])
    rng, chances = np.random.default_rng(seed), []
    for role in ROLES:
        view = ImageResiduals(pairs[role], noise).quiet()
        # Against noise that is independent in each pixel, since patches would take in what an unsteady light does.
        chances.append(ImageNull.of(view, rng, patches=(1,)).p_value(view, view.residual()))
    return (UNSTEADY,) if len(chances) * min(chances) < (rules or Rules()).alarm else ()


def few_photos(registration: Pairs) -> tuple[str, ...]:
    """Return the reasons why a diagnosis against rendered images is degraded, such as few photos to learn the model error.

    Raises:
        InputError: There are too few photos for any diagnosis.
    """
    check_enough(registration)
    return (UNPROVEN, FEW) if len(registration) < ENOUGH else (UNPROVEN,)


def channel_sizes(view: ImageResiduals, table: Array) -> dict[str, float]:
    """Return the root mean squares of the image part and the noise part of a residual, in units of the noise.

    Args:
        view: The views that the residual belongs to.
        table: Residual, as from `ImageResiduals.residual`. [N * h + N, 3 * w].
    """
    pictures, noise = view.pictures(table), view.noise_part(table)
    measured = max(int((noise != 0).sum()), 1)
    return {
        "picture": float(np.sqrt((pictures**2).sum() / max(3.0 * view.mask.sum(), 1.0))),
        "noise": float(np.sqrt((noise**2).sum() / measured)),
    }


class ImageAccount(Account):
    """Report of findings on camera images in words and numbers."""

    effects = IMAGE_EFFECTS
    agree = "Earlier and later photos agree within the noise (p = {p:.2g})."
    alone = "A difference shows on 'select' alone; take more such photos and fit those."
    unexcited = "No difference shows, but most effects could not show in these photos: show edges and colours, near and far."


class SplatAccount(ImageAccount):
    """Report of findings for photos that are compared with rendered images."""

    agree = "Photos differ from drawn pictures by no more than on the day of the registration (p = {p:.2g})."
