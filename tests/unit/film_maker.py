"""Small films and photos, made from formulas, for the tests of capture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np


def texture(height: int = 600, width: int = 1600, seed: int = 0) -> np.ndarray:
    """Smooth random texture with detail at several sizes, uint8 BGR."""
    rng = np.random.default_rng(seed)
    out = np.zeros((height, width, 3), np.float32)
    for size in (3, 12, 40):
        noise = rng.random((height // size + 2, width // size + 2, 3)).astype(np.float32)
        out += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip((out - out.min()) / (out.max() - out.min()) * 255, 0, 255).astype(np.uint8)


def pan(offsets: list[float], size: tuple[int, int] = (320, 240), seed: int = 0) -> list[np.ndarray]:
    """Frames cut out of the texture at the given shifts to the right, px."""
    image = texture(seed=seed)
    width, height = size
    centre_y = 100 + height / 2
    return [cv2.getRectSubPix(image, size, (20 + width / 2 + offset, centre_y)) for offset in offsets]


def write_video(path: Path, frames: list[np.ndarray], codec: str = "mp4v", fps: float = 10.0) -> Path:
    """Encode frames."""
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), fps, (width, height))
    assert writer.isOpened()
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path
