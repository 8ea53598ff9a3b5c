"""Drawing of blind image cases: a world, photos before and after effects are hidden, and sizes in units of the noise."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.gap.benchmark.generate import UNIT
from gsbridge.gap.benchmark.image_truth import READ, SHOT, TruthCamera, grainy
from gsbridge.gap.benchmark.image_world import ImageWorld, course
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.image.pairs import Pairs
from gsbridge.geometry import Array
from gsbridge.scene.track import Track

CAMERA = Camera(128, 96, 120.0, 120.0, 64.0, 48.0)

SIZES: Mapping[str, tuple[float, int, float]] = {
    "exposure": (0.05, 0, 2.0),
    "response": (0.03, 0, 0.6),
    "black_level": (0.01, 0, 0.15),
    "white_balance": (0.02, 0, 0.25),
    "saturation": (0.05, 0, 0.8),
    "vignetting": (0.05, 1, 1.8),
    "distortion": (0.01, 0, 0.3),
    "focal": (0.003, 0, 0.15),
    "extrinsics": (0.002, 1, 0.06),
    "rolling_shutter": (1e-4, 0, 1.8e-3),
    "motion_blur": (0.03, 1, 0.14),
    "defocus": (0.4, 1, 4.0),
    "hue_cast": (0.05, 1, 3.0),
    "shadow": (0.05, 1, 0.9),
    "noise": (0.004, 1, 0.12),
    "latency": (0.005, 1, 0.2),
    "flicker": (0.02, 1, 0.6),
}
"""Start size for the search of the unit, sign (0 for both) and largest plausible size by effect, in units of `TruthCamera`."""

STRANGE: Mapping[str, tuple[float, int, float]] = {
    "fringe": (0.002, 1, 0.06),
    "ghost": (0.03, 1, 0.5),
    "haze_depth": (0.03, 1, 0.8),
    "stripes": (0.01, 1, 0.3),
}
"""Effects outside the catalogue, as in `SIZES`: chromatic aberration, a reflection, haze at the top, a pattern of columns."""

STILL = ("rolling_shutter", "motion_blur", "latency", "flicker")
"""Effects that show only if the camera moves or if photos have different time stamps."""

REPEATS = 4
"""Number of repeated photos of each view before the change."""

_DEPTH = 0.004
"""Relative error of the depths that a diagnosis gets, as of a registered mesh."""

_TRIES = 14


@dataclass(frozen=True, eq=False)
class ImageSite:
    """A world and the camera in it.

    Args:
        world: The true world.
        camera: Camera of all photos.
        photos: Number of photos of each role.
        seed: Seed of the world.
    """

    world: ImageWorld
    camera: Camera
    photos: int
    seed: int

    def lens(self, hidden: Mapping[str, float] | None = None, spin: Mapping[str, float] | None = None) -> TruthCamera:
        """Return a camera in the world with hidden effects and their directions, places and colours."""
        return TruthCamera(self.world, self.camera, hidden or {}, spin or {})

    def depths(self, poses: Array, rng: np.random.Generator) -> Array:
        """Return the depths of views along the camera's z axis with a relative error, m. [N, 4, 4] -> [N, H, W]."""
        rays, out = self.camera.pixel_rays().reshape(-1, 3), []
        for pose in poses:
            centre = -pose[:3, :3].T @ pose[:3, 3]
            _, places = self.world.look(np.broadcast_to(centre, rays.shape), rays @ pose[:3, :3])
            out.append((places @ pose[2, :3] + pose[2, 3]).reshape(self.camera.height, self.camera.width))
        return np.stack(out) * (1.0 + _DEPTH * rng.standard_normal((len(poses), 1, 1)))


def film(seed: int, photos: int, duration: float = 4.0, rounds: float = 0.0) -> tuple[Track, Array]:
    """Draw a course of the camera and irregular times of photos on it.

    Args:
        seed: Seed of the course and the times.
        photos: Number of photos, N.
        duration: Length of the course, s.
        rounds: Number of rounds of the camera about the middle of the table.

    Returns:
        The course, and the times of the photos in ascending order, s. [N].
    """
    rng = np.random.default_rng(seed)
    return course(seed, duration, rounds), np.sort(rng.uniform(0.25, duration - 0.25, photos))


def image_site(seed: int, pictures: Sequence[Array] = (), *, camera: Camera = CAMERA, photos: int = 8) -> ImageSite:
    """Draw the world and camera of photo cases.

    Args:
        seed: Seed of the world.
        pictures: sRGB images, one of which textures the table; none for a painted table. [H, W, 3] each.
        camera: Camera of all photos.
        photos: Number of photos of each role.
    """
    return ImageSite(ImageWorld.draw(seed, pictures), camera, photos, seed)


@dataclass(frozen=True)
class DrawnImageCase:
    """A sealed truth and its photos.

    Args:
        name: Name of the case.
        hidden: Sizes of the hidden effects, by name; empty for an effect-free case.
        units: Size of each effect, in units of the detection limit.
        pairs: Photos by role.
        clean: Later photos of `verify` without noise. [N, H, W, 3].
        plain: Photos of `verify` without noise and hidden effects. [N, H, W, 3].
        seal: SHA-256 of the truth.
    """

    name: str
    hidden: Mapping[str, float]
    units: float
    pairs: Mapping[str, Pairs]
    clean: Array
    plain: Array
    seal: str


def draw_image_case(
    site: ImageSite, names: tuple[str, ...], units: float, seed: int, *, moving: bool | None = None
) -> DrawnImageCase:
    """Draw one case.

    Args:
        site: World and camera of the photos.
        names: Names of the effects to hide.
        units: Size of each effect by itself, in units of the detection limit.
        seed: Seed of views, signs, directions and noise.
        moving: Whether the camera moves while photos are taken; None for only if an effect in `STILL` is hidden.

    Raises:
        ValueError: An effect does not reach that size within its plausible range.
    """
    rng = np.random.default_rng(seed)
    moving = any(name in STILL for name in names) if moving is None else moving
    films = {role: film(int(rng.integers(1 << 30)), site.photos) for role in ROLES}
    spin, known = _spin(rng), {**SIZES, **STRANGE}
    hidden: dict[str, float] = {}
    for name in names:
        sign = float(known[name][1]) or float(rng.choice((-1.0, 1.0)))
        hidden[name] = sign * size_of_units(site, name, sign, units, _posed(films["select"], moving), spin)
    pairs = hidden_pairs(site, hidden, films, spin, rng, moving=moving)
    track = _posed(films["verify"], moving)
    clean, plain = site.lens(hidden, spin).photos(*track), site.lens().photos(*track)
    text = json.dumps({"seed": seed, "site": site.seed, "hidden": dict(sorted(hidden.items())), "spin": spin})
    seal = hashlib.sha256(text.encode()).hexdigest()
    return DrawnImageCase("+".join(names) or "none", hidden, units, pairs, clean, plain, seal)


def hidden_pairs(
    site: ImageSite,
    hidden: Mapping[str, float],
    films: Mapping[str, tuple[Track, Array]],
    spin: Mapping[str, float],
    rng: np.random.Generator,
    *,
    moving: bool = False,
) -> dict[str, Pairs]:
    """Simulate photos of all roles before and after effects are hidden in the camera.

    Args:
        site: World and camera of the photos.
        hidden: Sizes of the hidden effects, by name.
        films: Course of the camera and times of the photos, s, by role. [N] each.
        spin: Directions, places and colours of the hidden effects.
        rng: Random numbers for noise.
        moving: Whether the camera moves; otherwise it rests at the same poses.
    """
    out = {}
    for role, (way, times) in films.items():
        track, moments = _posed((way, times), moving)
        plain, changed = site.lens().photos(track, moments), site.lens(hidden, spin).photos(track, moments)
        poses = track.at(moments)
        again = np.mean([grainy(plain, {}, rng) for _ in range(REPEATS)], axis=0).astype(np.float32)
        first, shown = grainy(plain, {}, rng), grainy(changed, hidden, rng)
        depths, moved = site.depths(poses, rng), (track, moments) if moving else (None, None)
        out[role] = Pairs(site.camera, first, again, shown, depths, poses, moved[0], moved[1], REPEATS, role)
    return out


def _posed(film: tuple[Track, Array], moving: bool) -> tuple[Track, Array]:
    """Return a film unchanged if the camera moves; otherwise make the camera rest 2 s at each pose, so no motion shows."""
    if moving:
        return film
    track, times = film
    poses = track.at(times)
    rests = 10.0 * np.arange(len(times))
    stamps = np.stack([rests - 1.0, rests, rests + 1.0], axis=1).ravel()
    return Track(stamps, np.repeat(poses, 3, axis=0)), rests


def size_of_units(
    site: ImageSite, name: str, sign: float, units: float, film: tuple[Track, Array], spin: Mapping[str, float]
) -> float:
    """Find the size at which the noise-free signature on `select` has the squared length `units`^2 times `UNIT`.

    Lengths are in units of the true noise of the difference of an earlier and a later photo.

    Args:
        site: World and camera.
        name: Name of the effect, of `SIZES` or `STRANGE`.
        sign: Sign of the size, 1 or -1.
        units: Wanted size in units of the detection limit.
        film: Course of the camera and times of the photos, s, from the function `film`. [N].
        spin: Directions, places and colours of the effect, as `TruthCamera` takes them.

    Returns:
        The size without its sign, in the effect's own unit.

    Raises:
        ValueError: There is no such size.
    """
    start, _, most = {**SIZES, **STRANGE}[name]
    aim = units * np.sqrt(UNIT)
    plain = site.lens().photos(*film)
    if name == "noise":
        return _noise_of_units(plain, aim)
    deviations = np.sqrt(2.0 * (READ**2 + SHOT * plain + 1.0 / (12.0 * 255.0**2)))

    def length(size: float) -> float:
        change = site.lens({name: sign * size}, spin).photos(*film) - plain
        return float(np.linalg.norm(change / deviations))

    size, low, high = start, 0.0, most
    for _ in range(_TRIES):
        found = length(size)
        if abs(found / aim - 1.0) < 0.07:
            return size
        low, high = (size, high) if found < aim else (low, size)
        if low >= most:
            break
        guess = size * float(np.clip(aim / max(found, 1e-9), 0.02, 6.0))
        size = guess if low < guess < high else (0.5 * (low + high) if high < most or low > 0.3 * most else most)
    raise ValueError(f"{name} reaches no {units:g} units here")


def _noise_of_units(plain: Array, aim: float) -> float:
    """Return the standard deviation of added noise that raises the log noise variance by `aim` standard deviations of it."""
    usual = float((READ**2 + SHOT * plain).mean())
    # The log of a variance estimated from n numbers has the variance 2 / n, and the log of a ratio of two has twice that.
    return float(np.sqrt(usual * np.expm1(aim * np.sqrt(4.0 / plain.size))))


def _spin(rng: np.random.Generator) -> dict[str, float]:
    """Draw directions, places and colours for all effects that may be hidden."""
    way, turn = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    light = rng.dirichlet([0.7, 0.7, 0.7])
    tint = rng.uniform(0, 2 * np.pi)
    return {
        "x": way[0], "y": way[1], "z": way[2], "a": turn[0], "b": turn[1], "c": turn[2],
        "px": rng.uniform(-0.1, 0.1), "py": rng.uniform(-0.1, 0.1), "radius": rng.uniform(0.06, 0.11),
        "r": light[0], "g": light[1], "bl": light[2],
        "hx": rng.uniform(-0.5, 0.5), "hy": rng.uniform(-0.3, 0.5), "hr": rng.uniform(0.25, 0.45),
        "readout": rng.choice([0.0, 2e-4]), "hertz": rng.choice([100.0, 120.0]), "phase": rng.uniform(0, np.pi),
        "wr": np.cos(tint), "wb": np.sin(tint),
    }  # fmt: skip
