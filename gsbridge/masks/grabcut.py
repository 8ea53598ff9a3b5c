"""GrabCut on the part of a photo round the object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array

UNSURE_BACK, UNSURE_FRONT = cv2.GC_PR_BGD, cv2.GC_PR_FGD
BACK, FRONT = cv2.GC_BGD, cv2.GC_FGD


@dataclass(frozen=True)
class Crop:
    """Part of a photo, resized. Pixel coordinates have centres at +0.5.

    Args:
        left, top, width, height: The part in the photo, px.
        size: Size of the resized part (width, height), px.
    """

    left: int
    top: int
    width: int
    height: int
    size: tuple[int, int]

    @classmethod
    def around(cls, pixels: Array, image_size: tuple[int, int], longest: int, margin: float = 0.25) -> Crop | None:
        """Choose the part of an image that holds some pixels and a margin.

        Args:
            pixels: Pixels to hold; those with NaN are left out. [N, 2].
            image_size: Width and height of the image, px.
            longest: Longest side of the shrunk part, px.
            margin: Free edge on each side, as a share of the longer side of the pixels' bounding box.

        Returns:
            The crop, or None if less than 8 px of its width or height lie within the image.
        """
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels) == 0:
            return None
        low, high = pixels.min(0), pixels.max(0)
        border = margin * (high - low).max()
        left, top = (int(max(0, np.floor(value - border))) for value in low)
        right = int(min(image_size[0], np.ceil(high[0] + border)))
        bottom = int(min(image_size[1], np.ceil(high[1] + border)))
        if right - left < 8 or bottom - top < 8:
            return None
        scale = min(1.0, longest / max(right - left, bottom - top))
        size = (max(8, round((right - left) * scale)), max(8, round((bottom - top) * scale)))
        return cls(left, top, right - left, bottom - top, size)

    @property
    def scale(self) -> float:
        """Pixels of the crop per pixel of the photo."""
        return self.size[0] / self.width

    def camera(self, camera: Camera) -> Camera:
        """Pinhole of the resized part, from the photo's; because sizes are whole pixels, fx and fy are scaled separately."""
        part = camera.cropped(self.left, self.top, self.width, self.height)
        (width, height), (x, y) = self.size, (self.size[0] / self.width, self.size[1] / self.height)
        return Camera(width, height, part.fx * x, part.fy * y, part.cx * x, part.cy * y)

    def cut(self, image: Array) -> Array:
        """The resized part of an image. [H, W, ...] -> [h, w, ...]."""
        part = image[self.top : self.top + self.height, self.left : self.left + self.width]
        interpolation = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_LINEAR
        return np.ascontiguousarray(cv2.resize(part, self.size, interpolation=interpolation))

    def paste(self, part: Array, image_size: tuple[int, int]) -> Array:
        """A full-size image, zero outside, from a resized float part. -> [H, W] float32."""
        out = np.zeros((image_size[1], image_size[0]), np.float32)
        resized = cv2.resize(part.astype(np.float32), (self.width, self.height), interpolation=cv2.INTER_LINEAR)
        out[self.top : self.top + self.height, self.left : self.left + self.width] = resized
        return out

    def pixels(self, pixels: Array) -> Array:
        """Coordinates in the crop of photo pixels. [N, 2] -> [N, 2]."""
        return (pixels - (self.left, self.top)) * np.array([self.size[0] / self.width, self.size[1] / self.height])


def stamp(labels: Array, pixels: Array, radius: int, value: int) -> None:
    """Write a label into discs round pixels, in place.

    Args:
        labels: Labels of an image. [H, W].
        pixels: Middles of the discs, pixel centres at +0.5; those with NaN are left out. [N, 2].
        radius: Radius of the discs, px.
        value: Label to write.
    """
    for x, y in pixels[np.isfinite(pixels).all(axis=1)]:
        if -radius <= x < labels.shape[1] + radius and -radius <= y < labels.shape[0] + radius:
            cv2.circle(labels, (int(np.floor(x)), int(np.floor(y))), radius, int(value), -1)


def cut_out(image: Array, labels: Array, iterations: int, seed: int) -> Array:
    """GrabCut in the Lab colour space.

    The image is padded with background in the colour of its edge. Otherwise an object that nearly touches the edge would claim
    the sliver between, in which no pixel is known to be background.

    Args:
        image: RGB, 8-bit. [h, w, 3].
        labels: `BACK`, `FRONT`, `UNSURE_BACK` or `UNSURE_FRONT` per pixel. [h, w] uint8.
        iterations: GrabCut iterations.
        seed: Seed of the colour clusters.

    Returns:
        True on the object; False everywhere if the labels hold no object or no background at all. [h, w] bool.

    Source: Rother, Kolmogorov, Blake, SIGGRAPH 2004 (OpenCV's implementation).
    """
    front = (labels == FRONT) | (labels == UNSURE_FRONT)
    if front.sum() < 10 or (~front).sum() < 10:
        return labels == FRONT
    cv2.setRNGSeed(seed)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    ring = int((edge != BACK).any())
    lab = cv2.copyMakeBorder(lab, ring, ring, ring, ring, cv2.BORDER_REPLICATE)
    result = cv2.copyMakeBorder(labels, ring, ring, ring, ring, cv2.BORDER_CONSTANT, value=int(BACK))
    cv2.grabCut(lab, result, (0, 0, 1, 1), np.zeros((1, 65)), np.zeros((1, 65)), iterations, cv2.GC_INIT_WITH_MASK)
    result = result[ring : ring + labels.shape[0], ring : ring + labels.shape[1]]
    return (result == FRONT) | (result == UNSURE_FRONT)


def tidy(mask: Array, keep: Array | None = None, hole_share: float = 0.01) -> Array:
    """Largest part of a mask, without small holes.

    Args:
        mask: The mask. [h, w] bool.
        keep: Pixels that the kept part should hold, for example the object's points; the part with most of them wins. [N, 2].
        hole_share: Holes smaller than this share of the mask are filled; larger ones (a cup's handle) stay.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count <= 1:
        return mask
    votes = stats[1:, cv2.CC_STAT_AREA].astype(np.float64)
    if keep is not None and len(keep):
        index = np.floor(keep[np.isfinite(keep).all(axis=1)]).astype(int)
        valid = (index >= 0).all(axis=1) & (index[:, 0] < mask.shape[1]) & (index[:, 1] < mask.shape[0])
        hits = np.bincount(labels[index[valid, 1], index[valid, 0]], minlength=count)[1:count]
        votes = hits + votes / (votes.sum() + 1.0)
    part = labels == 1 + int(np.argmax(votes))
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~part).astype(np.uint8), connectivity=8)
    limit = hole_share * part.sum()
    for label in range(1, count):
        x, y, w, h, area = stats[label]
        border = x == 0 or y == 0 or x + w == mask.shape[1] or y + h == mask.shape[0]
        if area < limit and not border:
            part[labels == label] = True
    return part
