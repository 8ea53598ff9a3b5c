"""Reading, writing, encoding and comparing images.

Images are float32 RGB, H x W x 3, 0..1, sRGB-encoded as in the file; `linear_from_srgb` gives linear light, which can be added
up. Values are clamped before any 8-bit store.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pi_heif
import PIL.Image
import PIL.ImageOps

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

pi_heif.register_heif_opener()

HEIF_SUFFIXES = (".heic", ".heif")
"""Suffixes of the photos that Apple's phones take, which OpenCV does not read."""

LARGEST_IMAGE_PIXELS = 204_000_000
"""Largest number of pixels of a picture that is read: that of a phone's camera with 200 megapixels. At 3 bytes each they take
0.6 GB, and some steps hold two copies of the picture."""
LARGEST_IMAGE_BYTES = 1_000_000_000
# Pillow's own limit is smaller than the pictures of some phones; `_header` checks this one.
PIL.Image.MAX_IMAGE_PIXELS = LARGEST_IMAGE_PIXELS

_READABLE = "Replace or remove it; JPEG, PNG and HEIC work"

_WIDTH, _LENGTH, _ORIENTATION = 0x0100, 0x0101, 0x0112
"""Numbers of EXIF tags."""
_QUARTER_TURNS = (5, 6, 7, 8)
"""EXIF orientations that swap width and height."""

SSIM_SIGMA = 1.5
SSIM_RADIUS = 5


def read_image(path: str | Path) -> Array:
    """Read an image as float32 RGB in 0..1. [H, W, 3].

    Raises:
        InputError: The file is missing or no image.
    """
    return read_image_u8(path).astype(np.float32) / 255.0


def read_image_u8(path: str | Path) -> Array:
    """Read an image as uint8 RGB. [H, W, 3].

    Raises:
        InputError: The file is missing or no image.
    """
    source = regular_file(path, "image", "Check the path", LARGEST_IMAGE_BYTES)
    with refusing(source, "this is not a readable image", _READABLE):
        data = source.read_bytes()
        # The bytes decide the format, not the suffix: apps and people rename files.
        if _undamaged_kind(source, data) == "HEIF":
            return _read_heif(data)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        if image is None:
            raise InputError(source, "this is not a readable image", _READABLE)
        return image


def image_size(path: str | Path) -> tuple[int, int]:
    """Width and height, px, of an image as `read_image` returns it, turned by its EXIF orientation. Only the header is read.

    Raises:
        InputError: The file is missing or no image.
    """
    source = regular_file(path, "image", "Check the path", LARGEST_IMAGE_BYTES)
    with refusing(source, "this is not a readable image", _READABLE), _header(source, source) as image:
        exif = image.getexif()
        # For a TIFF, Pillow's size is already turned; the tags hold the size as stored.
        width, height = (exif[_WIDTH], exif[_LENGTH]) if image.format == "TIFF" else image.size
        return (height, width) if exif.get(_ORIENTATION, 1) in _QUARTER_TURNS else (width, height)


def is_png(path: str | Path) -> bool:
    """Whether a picture is a PNG, judged by its bytes, that its EXIF orientation does not turn."""
    source = regular_file(path, "image", "Check the path", LARGEST_IMAGE_BYTES)
    with refusing(source, "this is not a readable image", _READABLE), _header(source, source) as image:
        return image.format == "PNG" and image.getexif().get(_ORIENTATION, 1) == 1


@contextlib.contextmanager
def _header(source: Path, content: Path | io.BytesIO) -> Iterator[PIL.Image.Image]:
    """Open a picture without decoding it, and refuse one of absurd size.

    Raises:
        InputError: The picture has more than `LARGEST_IMAGE_PIXELS`, or the content is no picture.
    """
    try:
        image = PIL.Image.open(content)
    except PIL.Image.DecompressionBombError as error:
        raise InputError(source, f"it has more than {LARGEST_IMAGE_PIXELS // 10**6} million pixels", "Shrink it") from error
    except PIL.UnidentifiedImageError as error:
        raise InputError(source, "this is not a readable image", _READABLE) from error
    with image:
        if image.width * image.height > LARGEST_IMAGE_PIXELS:
            seen, most = f"{image.width} x {image.height}", LARGEST_IMAGE_PIXELS // 10**6
            raise InputError(source, f"it has {seen} pixels; at most {most} million are read", "Shrink it")
        yield image


def _undamaged_kind(source: Path, data: bytes) -> str | None:
    """Return a picture's format, and refuse a picture that is too large or cut off.

    OpenCV would decode a picture that is cut off, and fill the missing part with grey.

    Raises:
        InputError: The picture is too large, cut off, or no picture.
    """
    with _header(source, io.BytesIO(data)) as header:
        kind = header.format
    # A JPEG's end marker cannot occur within its coded pixels. Before them it may end a thumbnail, so the search skips headers.
    cut = (kind == "JPEG" and data.find(b"\xff\xd9", _start_of_pixels(data)) < 0) or (kind == "PNG" and b"IEND" not in data)
    if cut:
        raise InputError(source, "the image is cut off", "Copy it again, or remove it")
    return kind


def _start_of_pixels(jpeg: bytes) -> int:
    """Byte at which a JPEG's first scan begins, behind all headers and thumbnails; the length of the data if there is none."""
    place = 2
    while place + 4 <= len(jpeg) and jpeg[place] == 0xFF:
        if jpeg[place + 1] == 0xDA:
            return place
        place += 1 if jpeg[place + 1] == 0xFF else 2 + int.from_bytes(jpeg[place + 2 : place + 4], "big")
    return len(jpeg)


def _read_heif(data: bytes) -> Array:
    """Decode a phone's HEIF picture and turn it by its EXIF orientation. uint8 [H, W, 3]."""
    with PIL.Image.open(io.BytesIO(data)) as picture:
        return np.ascontiguousarray(np.asarray(PIL.ImageOps.exif_transpose(picture).convert("RGB")))


def read_mask(path: str | Path) -> Array:
    """Read an 8-bit mask as float32 in 0..1. [H, W].

    Raises:
        InputError: The file is missing or no image.
    """
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if os.path.isfile(path) else None
    if image is None:
        raise InputError(str(path)[:200], "the mask is missing or not a readable image", "Run the masks stage again")
    return image.astype(np.float32) / 255.0


def to_u8(image: Array) -> Array:
    """Clamp to 0..1 and round to 8 bits. [...] -> [...] uint8."""
    return np.rint(np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint8)


def write_image(path: str | Path, image: Array) -> None:
    """Write RGB [H, W, 3] or grey [H, W], float 0..1 or uint8, whole or not at all; the format follows the suffix.

    Raises:
        OSError: The file could not be written.
    """
    data = image if image.dtype == np.uint8 else to_u8(image)
    if data.ndim == 3:
        data = np.ascontiguousarray(data[..., ::-1])
    # PNG at its lowest effort: photos hardly shrink further and writing is several times faster.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1] if str(path).lower().endswith(".png") else [cv2.IMWRITE_JPEG_QUALITY, 95]
    ok, buffer = cv2.imencode(Path(path).suffix, data, options)
    if not ok:
        raise OSError(f"{path}: the image could not be encoded")
    with atomic_file(path) as temporary:
        temporary.write_bytes(buffer.tobytes())


def linear_from_srgb(image: Array) -> Array:
    """Decode sRGB to linear light (IEC 61966-2-1). [...] -> [...]."""
    x = np.asarray(image)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.0) + 0.055) / 1.055) ** 2.4).astype(x.dtype)


def srgb_from_linear(image: Array) -> Array:
    """Encode linear light as sRGB (IEC 61966-2-1); values above 1 are kept for the caller to clamp. [...]."""
    x = np.asarray(image)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-12) ** (1 / 2.4) - 0.055).astype(x.dtype)


def psnr(image: Array, reference: Array, weight: Array | None = None) -> float:
    """Peak signal-to-noise ratio, dB, peak 1.

    Args:
        image, reference: Images to compare. [H, W, 3].
        weight: Weight of each pixel, for example a mask. [H, W].

    Returns:
        The ratio; infinity for equal images, NaN where no pixel counts.
    """
    error = ((np.asarray(image, dtype=np.float64) - reference) ** 2).mean(-1)
    if weight is None:
        mse = float(error.mean())
    else:
        total = float(np.sum(weight, dtype=np.float64))
        if total <= 0:
            return float("nan")
        mse = float((error * weight).sum() / total)
    return float("inf") if mse == 0 else float(-10 * np.log10(mse))


def ssim_map(image: Array, reference: Array) -> Array:
    """Structural similarity per pixel, mean over channels, Gaussian window of 11 px and sigma 1.5. [H, W, 3] -> [H, W].

    Source: Wang et al., IEEE TIP 13(4), 2004, with K1 = 0.01, K2 = 0.03 and peak 1.
    """
    a = np.asarray(image, dtype=np.float64)
    b = np.asarray(reference, dtype=np.float64)

    def blur(x: Array) -> Array:
        size = (2 * SSIM_RADIUS + 1, 2 * SSIM_RADIUS + 1)
        return cv2.GaussianBlur(x, size, SSIM_SIGMA, borderType=cv2.BORDER_REFLECT)

    mean_a, mean_b = blur(a), blur(b)
    var_a = blur(a * a) - mean_a**2
    var_b = blur(b * b) - mean_b**2
    cov = blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    values = ((2 * mean_a * mean_b + c1) * (2 * cov + c2)) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    return values.mean(-1)


def ssim(image: Array, reference: Array, weight: Array | None = None) -> float:
    """Mean structural similarity of two images.

    Args:
        image, reference: Images of one shape. [H, W, 3].
        weight: How much each pixel counts; all count the same when None. [H, W].

    Returns:
        The weighted mean; NaN where no pixel counts.
    """
    values = ssim_map(image, reference)
    if weight is None:
        return float(values.mean())
    total = float(np.sum(weight, dtype=np.float64))
    return float((values * weight).sum() / total) if total > 0 else float("nan")
