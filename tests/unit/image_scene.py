"""A small table of coloured splats with boxes on it, and a camera that moves above: made in memory."""

import numpy as np

from gsbridge.cameras import Camera, look_at
from gsbridge.scene.track import Track
from gsbridge.splats.cloud import Cloud

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)


def scene(seed=0, count=2500):
    """A table of 0.6 m with smooth patches of colour, and two boxes."""
    rng = np.random.default_rng(seed)
    table = np.column_stack([rng.uniform(-0.35, 0.35, (count, 2)), np.zeros(count)])
    parts = [table]
    for x, y, half, height in ((-0.08, 0.03, 0.04, 0.08), (0.09, -0.04, 0.03, 0.12)):
        box = rng.uniform(-1.0, 1.0, (count // 8, 3))
        side = rng.integers(0, 3, len(box))
        box[np.arange(len(box)), side] = np.sign(box[np.arange(len(box)), side])
        parts.append(np.column_stack([x + half * box[:, 0], y + half * box[:, 1], 0.5 * height * (1 + box[:, 2])]))
    means = np.concatenate(parts)
    waves = rng.normal(0.0, 60.0, (3, 6, 3))
    phases = rng.uniform(0.0, 2 * np.pi, (3, 6))
    colours = np.stack([np.sin(means @ waves[c].T + phases[c]).sum(axis=1) for c in range(3)], axis=1)
    colours = np.clip(0.5 + 0.11 * colours + rng.normal(0.0, 0.05, colours.shape), 0.05, 0.95)
    n = len(means)
    return Cloud(means, np.tile([1.0, 0, 0, 0], (n, 1)), np.full((n, 3), 0.008), np.full(n, 0.9), colours)


def track(seed=0, duration=3.0, rate=20.0, still=False):
    """A hand-held path above the table; `still` rests in one place."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(duration * rate) + 1) / rate
    waves = rng.uniform(0.3, 0.9, (2, 3)) * 2 * np.pi
    sway = np.sin(times[:, None, None] * waves + rng.uniform(0, 6.3, (2, 3))) * (0.0 if still else 1.0)
    eyes = np.array([0.0, -0.28, 0.45]) + sway[:, 0] * [0.1, 0.08, 0.05]
    aims = sway[:, 1] * [0.05, 0.04, 0.0]
    return Track(times, np.stack([look_at(eye, aim) for eye, aim in zip(eyes, aims, strict=True)]))


def dots(points, size=0.004, colour=(0.9, 0.9, 0.9)):
    """Single splats at some points on black."""
    points = np.atleast_2d(np.asarray(points, dtype=float))
    n = len(points)
    colours = np.broadcast_to(colour, (n, 3))
    return Cloud(points, np.tile([1.0, 0, 0, 0], (n, 1)), np.full((n, 3), size), np.full(n, 0.95), colours)
