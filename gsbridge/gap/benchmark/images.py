"""Drawing blind image cases: a world, splats of it, photos with hidden effects, and sizes in units of what can be seen."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.fft import dctn

from gsbridge.cameras import Camera
from gsbridge.gap.benchmark.generate import UNIT
from gsbridge.gap.benchmark.image_splats import fit_splats
from gsbridge.gap.benchmark.image_truth import Lens, grainy
from gsbridge.gap.benchmark.image_world import World, course
from gsbridge.gap.image.model import ImageModel
from gsbridge.gap.image.shots import REFERENCE, ROLES, Shots
from gsbridge.geometry import Array
from gsbridge.scene.track import Track

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)

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
"""For every effect: a size to begin the search for the unit with, its sign (0 for both), and the largest that makes sense."""

STRANGE: Mapping[str, tuple[float, int, float]] = {
    "fringe": (0.002, 1, 0.06),
    "ghost": (0.03, 1, 0.5),
    "haze_depth": (0.03, 1, 0.8),
    "stripes": (0.01, 1, 0.3),
}
"""Effects outside the catalogue: colours of a lens that differ in size, a reflection, haze at the top, a pattern of columns."""

_FILMS = 12
"""Effect-free courses by which the generator knows what splats leave."""

_TRIES = 12


@dataclass(eq=False)
class Site:
    """A world, its splats, and effect-free photos of it.

    Args:
        world: The truth.
        model: What a simulation has of it.
        reference: Effect-free photos that were not used to fit the splats.
        photos: Of each role.
        seed: Of everything.
    """

    world: World
    model: ImageModel
    reference: Shots
    photos: int
    seed: int
    _empty: list[tuple[Track, Array, Array]] = field(default_factory=list, repr=False)
    _weights: Array | None = field(default=None, repr=False)
    _spreads: dict[str, float] = field(default_factory=dict, repr=False)

    def lens(self, hidden: Mapping[str, float] | None = None, spin: Mapping[str, float] | None = None) -> Lens:
        """A camera in the world."""
        return Lens(self.world, self.model.camera, hidden or {}, spin or {})

    def empty(self) -> list[tuple[Track, Array, Array]]:
        """Course, times, and what splats leave of effect-free photos, without noise, for some courses."""
        if not self._empty:
            for number in range(_FILMS):
                track, times = film(self.seed * 1000 + 500 + number, self.photos)
                photos = self.lens().photos(track, times)
                plain = self.model.photographer.photos(track, times)
                self._empty.append((track, times, photos - plain))
        return self._empty

    def weigh(self, change: Array) -> Array:
        """Waves of a change of photos, divided by what splats and noise leave at their frequency. [N, H, W, 3] -> the same."""
        if self._weights is None:
            noise = 1.0e-4
            power = np.stack([(dctn(left, axes=(1, 2), norm="ortho") ** 2).mean(axis=0) for _, _, left in self.empty()])
            power = power.mean(axis=0)
            height, width = power.shape[:2]
            ring = np.hypot(np.arange(height)[:, None] / height, np.arange(width) / width)
            kind = np.digitize(ring, np.linspace(0.03, 1.3, 14))
            flat = np.stack([np.bincount(kind.ravel(), power[..., k].ravel(), 15) for k in range(3)], axis=-1)
            flat /= np.maximum(np.bincount(kind.ravel(), minlength=15), 1)[:, None]
            self._weights = 1.0 / np.sqrt(flat[kind] + noise)
        return dctn(change, axes=(1, 2), norm="ortho") * self._weights

    def spread(self, name: str, hidden: Mapping[str, float], spin: Mapping[str, float]) -> float:
        """Mean square of what effect-free films show of an effect, in units of white noise: splats err in the same ways."""
        key = json.dumps([name, dict(sorted(hidden.items())), dict(sorted(spin.items()))])
        if key not in self._spreads:
            squares = []
            for track, times, left in self.empty()[::2]:
                change = self.lens(hidden, spin).photos(track, times) - self.lens().photos(track, times)
                shape, rest = self.weigh(change).ravel(), self.weigh(left).ravel()
                squares.append((shape @ rest) ** 2 / max(shape @ shape, 1e-12))
            self._spreads[key] = 1.0 + float(np.mean(squares))
        return self._spreads[key]


def film(seed: int, photos: int, duration: float = 4.0, rounds: float = 0.0) -> tuple[Track, Array]:
    """A course and irregular times of photos on it."""
    rng = np.random.default_rng(seed)
    return course(seed, duration, rounds), np.sort(rng.uniform(0.25, duration - 0.25, photos))


def site_of(
    seed: int, pictures: Sequence[Array] = (), *, camera: Camera = CAMERA, photos: int = 8, splats: int = 3000, steps: int = 600
) -> Site:
    """A site.

    Args:
        seed: Of the world, its films and its splats.
        pictures: sRGB pictures, one of which lies on the table.
        camera: Of all photos.
        photos: Of each role.
        splats: How many: the fewer, the higher the floor.
        steps: Of their fit.
    """
    world = World.draw(seed, pictures)
    lens, films = Lens(world, camera), []
    for number in range(4):
        track, times = film(seed * 1000 + number, 28, 16.0, 1.0)
        films.append((track, times, grainy(lens.photos(track, times), {}, np.random.default_rng([seed, number]))))
    model = ImageModel(fit_splats(world, camera, films, seed, splats=splats, steps=steps), camera)
    track, times = film(seed * 1000 + 400, 4 * photos, 20.0, 1.0)
    taken = grainy(lens.photos(track, times), {}, np.random.default_rng([seed, 400]))
    return Site(world, model, Shots(times, taken, track, REFERENCE), photos, seed)


@dataclass(frozen=True)
class ImageCase:
    """A sealed truth and its photos.

    Args:
        name: Of the case.
        hidden: Sizes by name; empty for an effect-free case.
        units: Size in units of what can be seen.
        shots: By role, the reference among them.
        clean: What `verify` would have been without noise. [N, H, W, 3].
        plain: The same without anything hidden. [N, H, W, 3].
        seal: SHA-256 of the truth.
    """

    name: str
    hidden: Mapping[str, float]
    units: float
    shots: Mapping[str, Shots]
    clean: Array
    plain: Array
    seal: str


def draw_image_case(site: Site, names: tuple[str, ...], units: float, seed: int) -> ImageCase:
    """Draw one case.

    Args:
        site: Where.
        names: What is hidden; each of `units` by itself.
        units: Size.
        seed: Of courses, signs, directions and noise.

    Raises:
        ValueError: An effect does not reach that size within what makes sense.
    """
    rng = np.random.default_rng(seed)
    films = {role: film(int(rng.integers(1 << 30)), site.photos) for role in ROLES}
    spin, known = _spin(rng), {**SIZES, **STRANGE}
    hidden = {}
    for name in names:
        sign = float(known[name][1]) or float(rng.choice((-1.0, 1.0)))
        hidden[name] = sign * size_of_units(site, name, sign, units, films["select"], spin)
    shots = {REFERENCE: site.reference}
    for role, (track, times) in films.items():
        clean = site.lens(hidden, spin).photos(track, times)
        shots[role] = Shots(times, grainy(clean, hidden, rng), track, role)
    plain = site.lens().photos(*films["verify"])
    text = json.dumps({"seed": seed, "site": site.seed, "hidden": dict(sorted(hidden.items())), "spin": spin})
    seal = hashlib.sha256(text.encode()).hexdigest()
    return ImageCase("+".join(names) or "none", hidden, units, shots, clean, plain, seal)


def size_of_units(
    site: Site, name: str, sign: float, units: float, film: tuple[Track, Array], spin: Mapping[str, float]
) -> float:
    """Size at which the noise-free signature on `select` has the squared length `units`^2 times `UNIT`.

    Lengths are in units of noise and of what splats leave, both as the generator knows them.

    Raises:
        ValueError: There is no such size.
    """
    start, _, most = {**SIZES, **STRANGE}[name]
    aim = units * np.sqrt(UNIT)
    if name == "noise":
        return _noise_of_units(site, aim)
    plain = site.lens().photos(*film)

    def length(size: float) -> float:
        change = site.lens({name: sign * size}, spin).photos(*film) - plain
        return float(np.linalg.norm(site.weigh(change)) / np.sqrt(site.spread(name, {name: sign * start}, spin)))

    size, low, high = start, 0.0, most
    for _ in range(_TRIES):
        found = length(size)
        if abs(found / aim - 1.0) < 0.07:
            return size
        low, high = (size, high) if found < aim else (low, size)
        if low >= most:
            break
        guess = size * float(np.clip(aim / max(found, 1e-9), 0.2, 6.0))
        size = guess if low < guess < high else (0.5 * (low + high) if high < most or low > 0.3 * most else most)
    raise ValueError(f"{name} reaches no {units:g} units here")


def _noise_of_units(site: Site, aim: float) -> float:
    """Deviation of added noise whose grain exceeds that of effect-free photos by so many deviations of its logarithm."""

    def grain(photos: Array) -> Array:
        return np.log(((photos[:, :, 1:] - photos[:, :, :-1]) ** 2).mean(axis=(1, 2, 3)))

    usual = np.concatenate([grain(left + np.random.default_rng(0).normal(0, 0.008, left.shape)) for _, _, left in site.empty()])
    shift = aim * usual.std() / np.sqrt(site.photos)
    return float(np.sqrt(np.expm1(shift) * 0.5 * np.exp(usual.mean())))


def _spin(rng: np.random.Generator) -> dict[str, float]:
    """Directions, places and colours of whatever may be hidden."""
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
