"""Choice of keyframes: the sharpest frame of each of many arcs of equal image motion."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import split_of
from gsbridge.capture.lenses import Lens, lenses_of
from gsbridge.capture.motion import FrameMotion, measure, sharpness_of, small_grey
from gsbridge.capture.sources import (
    KnownView,
    Photo,
    PhotoSequence,
    Source,
    Video,
    list_photos,
    read_colmap,
    read_film,
    read_nerfstudio,
)
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, write_stage
from gsbridge.geometry import Array
from gsbridge.images import image_size, is_png, read_image_u8, write_image
from gsbridge.logs import track

logger = logging.getLogger("gsbridge")

MIN_KEYFRAMES = 3
ADVISED_KEYFRAMES = 40
"""Number of keyframes that is enough for a complete model: steps of 5 to 9 degrees over an orbit or more (docs/capture.md)."""


_AROUND, _BLURRED = 3, 0.6
"""Number of arcs on each side with which an arc is compared, and the share of their sharpness below which it counts as blurred.
A blur of a few pixels takes away at least half of a picture's sharpness; a change of view by a few arcs takes away less."""


@dataclass(frozen=True)
class _Chosen:
    """One keyframe before it is written."""

    name: str
    index: int
    time_s: float | None
    sharpness: float
    motion_px: float | None
    known: KnownView | None = None
    size: tuple[int, int] | None = None
    """Width and height, px, if they may differ from the other keyframes'."""
    lens: Lens | None = None
    """Lens by EXIF data, if the capture may have several."""


def select_keyframes(source: Source, out_frames: Path, out_json: Path, settings: KeyframeSettings) -> None:
    """Choose keyframes of a capture and write them with their record.

    Args:
        source: The capture.
        out_frames: Folder of the chosen frames, made new.
        out_json: Record `keyframes.json`.
        settings: Limits.

    Raises:
        InputError: The source cannot be read, or too few frames are fit for reconstruction.
    """
    if source.kind == "video":
        _from_frames(source, Video(source.path), out_frames, out_json, settings)
    elif source.kind == "film":
        content, photos = read_film(source.path)
        if content.get("kind") == "dense":
            _from_frames(source, PhotoSequence(source.path, photos), out_frames, out_json, settings)
        else:
            _from_photos(source, photos, out_frames, out_json, settings)
    elif source.kind == "images":
        _from_photos(source, list_photos(source.path), out_frames, out_json, settings)
    elif source.kind == "colmap":
        _from_photos(source, read_colmap(source.path, source.images), out_frames, out_json, settings)
    else:
        photos, absent = read_nerfstudio(source.path)
        reasons = [f"{len(absent)} of {len(photos) + len(absent)} listed photos do not exist: {', '.join(absent[:5])}"]
        _from_photos(source, photos, out_frames, out_json, settings, reasons if absent else [])


def choose(motions: list[FrameMotion], settings: KeyframeSettings, width: int) -> list[int]:
    """Positions of the keyframes among a video's frames.

    Args:
        motions: Sharpness and path of each frame, in order.
        settings: Limits.
        width: Width of the images, px.

    Returns:
        Rising positions: the sharpest frame of each arc, where all arcs have equal image motion. An arc has none if all its
        frames are less sharp than the settings ask for, or blurred compared with those of its neighbours.
    """
    path = np.array([motion.path_px for motion in motions])
    total = float(path[-1])
    arcs = int(np.clip(total / max(settings.min_step * width, 1e-9), 1, settings.count))
    # The last frame lies on the far edge of the last arc and belongs to it.
    arc = np.minimum((path / max(total, 1e-9) * arcs).astype(int), arcs - 1)
    best: list[int | None] = []
    for number in range(arcs):
        members = [i for i in np.flatnonzero(arc == number) if motions[i].sharpness >= settings.min_sharpness]
        best.append(int(max(members, key=lambda i: motions[i].sharpness)) if members else None)
    return _without_blurred(best, motions)


def _without_blurred(best: list[int | None], motions: list[FrameMotion]) -> list[int]:
    """Leave out arcs whose sharpest frame is blurred compared with those of the arcs around it, but never two in a row.

    Args:
        best: Sharpest frame of each arc; None for an arc without any that is sharp enough.
        motions: Sharpness of each frame.
    """
    sharpness = np.array([np.nan if i is None else motions[i].sharpness for i in best])
    chosen: list[int] = []
    empty = False
    for number, frame in enumerate(best):
        around = sharpness[max(0, number - _AROUND) : number + _AROUND + 1]
        blurred = frame is None or sharpness[number] < _BLURRED * np.nanmedian(around)
        if frame is not None and (empty or not blurred):
            chosen.append(frame)
            empty = False
        else:
            empty = True
    return chosen


def _from_frames(
    source: Source, frames: Video | PhotoSequence, out_frames: Path, out_json: Path, settings: KeyframeSettings
) -> None:
    """Choose and write the keyframes of a video."""
    motions, (height, width) = measure(frames)
    frames.check(len(motions))
    _refuse_unfit_video(source.path, motions, settings, width)
    positions = choose(motions, settings, width)
    if len(positions) < MIN_KEYFRAMES:
        raise InputError(
            source.path,
            f"only {len(positions)} frames are sharp enough and differ enough; at least {MIN_KEYFRAMES} are needed",
            f"Film again, slowly, round the object in good light; {ADVISED_KEYFRAMES} or more keyframes are advised",
        )
    wanted = {position: rank for rank, position in enumerate(positions)}
    scale = _scale(width, height, settings)
    last = 0.0
    chosen = []
    with atomic_directory(out_frames) as folder:
        for position, (time_s, image) in enumerate(track(frames, "write keyframes", len(motions))):
            if position not in wanted:
                continue
            name = f"{wanted[position]:04d}.png"
            write_image(folder / name, _resized(image, scale)[..., ::-1])
            motion = motions[position]
            chosen.append(_Chosen(name, position, time_s, motion.sharpness, (motion.path_px - last) * scale))
            last = motion.path_px
        reasons = _few(len(chosen))
        size = round(width * scale), round(height * scale)
        _write_record(source, out_json, settings, chosen, size, (frames.declared, len(motions)), reasons, None)


def _refuse_unfit_video(path: Path, motions: list[FrameMotion], settings: KeyframeSettings, width: int) -> None:
    """Raise an error that names the fault of a video that is too short, black, static or blurred."""
    if len(motions) < MIN_KEYFRAMES:
        pictures = "one picture" if len(motions) == 1 else f"{len(motions)} pictures"
        raise InputError(path, f"the video has {pictures}; at least {MIN_KEYFRAMES} are needed", "Film all round the object")
    if max(motion.brightness for motion in motions) < settings.min_brightness:
        raise InputError(path, "the video is black", "Film again in better light")
    total = motions[-1].path_px / width
    sharp = sum(motion.sharpness >= settings.min_sharpness for motion in motions)
    if sharp < MIN_KEYFRAMES:
        best = max(motion.sharpness for motion in motions)
        raise InputError(
            path,
            f"the video is blurred: {sharp} of {len(motions)} frames are sharp "
            f"(best sharpness {best:.1f}, {settings.min_sharpness:g} is needed)",
            "Film again, slowly, in good light, with the focus locked on the object",
        )
    if total < settings.min_motion:
        raise InputError(
            path,
            f"the video is static: the image moves by {100 * total:.1f} % of its width, "
            f"{100 * settings.min_motion:g} % is needed",
            "Walk round the object with the camera; turning the camera or the object on the spot does not do",
        )


def _from_photos(
    source: Source,
    photos: list[Photo],
    out_frames: Path,
    out_json: Path,
    settings: KeyframeSettings,
    doubts: Sequence[str] = (),
) -> None:
    """Keep every photo above the sharpness floor."""
    # Headers are read first, so that unusable photos are reported before any photo is decoded.
    sizes = [image_size(photo.path) for photo in photos]
    cameras = [_scaled_known(photo, size, _scale(*size, settings)) for photo, size in zip(photos, sizes, strict=True)]
    chosen = []
    dropped = []
    # Photos with a larger longer side than the limit are shrunk to it, so that photos of one lens share a focal length in px.
    scales = [_scale(*size, settings) for size in sizes]
    lenses = [Lens(0, None)] * len(photos) if photos[0].known else lenses_of([photo.path for photo in photos], scales)
    with atomic_directory(out_frames) as folder:
        for index, photo in enumerate(track(photos, "read photos")):
            # The decoder applies the EXIF orientation.
            image = np.ascontiguousarray(read_image_u8(photo.path)[..., ::-1])
            scale = _scale(image.shape[1], image.shape[0], settings)
            grey = small_grey(image)
            sharpness = sharpness_of(grey)
            if sharpness < settings.min_sharpness or grey.mean() < settings.min_brightness:
                dropped.append(photo.path.name)
                continue
            name = f"{photo.path.stem}.png"
            if scale == 1.0 and photo.path.suffix.lower() == ".png" and is_png(photo.path):
                (folder / name).write_bytes(photo.path.read_bytes())
            else:
                write_image(folder / name, _resized(image, scale)[..., ::-1])
            size = round(image.shape[1] * scale), round(image.shape[0] * scale)
            chosen.append(_Chosen(name, index, photo.time_s, sharpness, None, cameras[index], size, lenses[index]))
        if len({item.name for item in chosen}) < len(chosen):
            raise InputError(source.path, "two photos carry the same name with different endings", "Rename one of them")
        if len(chosen) < MIN_KEYFRAMES:
            lost = f" ({len(dropped)} more are black or blurred)" if dropped else ""
            raise InputError(
                source.path,
                f"{len(chosen)} usable photos{lost}; at least {MIN_KEYFRAMES} are needed",
                f"Take photos all round the object; {ADVISED_KEYFRAMES} or more, 5 to 9 degrees apart, are advised",
            )
        reasons = [*doubts, *_few(len(chosen))]
        if dropped:
            reasons.append(f"{len(dropped)} of {len(photos)} photos dropped as black or blurred: {', '.join(dropped[:5])}")
        size = round(sizes[0][0] * scales[0]), round(sizes[0][1] * scales[0])
        counts = len(photos), len(photos)
        _write_record(source, out_json, settings, chosen, size, counts, reasons, lenses[0].focal)


def _few(count: int) -> list[str]:
    """Reason for a degraded result if there are few keyframes."""
    advised = ADVISED_KEYFRAMES // 2
    return [f"{count} keyframes; {advised} or more are advised"] if count < advised else []


def _scale(width: int, height: int, settings: KeyframeSettings) -> float:
    """Factor that brings the longer side within the limit; never enlarges."""
    return min(1.0, settings.max_side / max(width, height))


def _resized(image: Array, scale: float) -> Array:
    """Shrink by area averaging, which does not alias."""
    if scale == 1.0:
        return image
    height, width = image.shape[:2]
    return cv2.resize(image, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)


def _scaled_known(photo: Photo, size: tuple[int, int], scale: float) -> KnownView | None:
    """Known camera of a photo at the stored size.

    Raises:
        InputError: The camera was given for another image size.
    """
    if photo.known is None:
        return None
    camera = photo.known.camera
    if (camera.width, camera.height) != size:
        raise InputError(
            photo.path,
            f"the photo has {size[0]} x {size[1]} pixels, its camera {camera.width} x {camera.height}",
            "Use the photos that the camera file was made from",
        )
    return KnownView(camera.scaled(scale) if scale != 1.0 else camera, photo.known.cam_from_world)


def _write_record(
    source: Source,
    out_json: Path,
    settings: KeyframeSettings,
    chosen: list[_Chosen],
    size: tuple[int, int],
    counts: tuple[int, int],
    reasons: list[str],
    focal_prior_px: float | None,
) -> None:
    """Write `keyframes.json`."""
    known: dict[str, Any] = {
        item.name: {"camera": item.known.camera.to_json(), "cam_from_world": item.known.cam_from_world}
        for item in chosen
        if item.known is not None
    }
    frames = [
        {
            "name": item.name,
            "index": item.index,
            "time_s": item.time_s,
            "sharpness": item.sharpness,
            "motion_px": item.motion_px,
            "split": split_of(position),
        }
        | ({} if item.size in (None, size) else {"size": item.size})
        | ({"lens": item.lens.number, "focal_prior_px": item.lens.focal} if item.lens and item.lens.number else {})
        for position, item in enumerate(chosen)
    ]
    logger.info("%d keyframes of %d frames", len(chosen), counts[1])
    write_stage(
        out_json,
        reasons=reasons,
        packages=["opencv-python-headless"],
        source={"kind": source.kind, "path": source.path.name},
        ordered=source.kind in ("video", "film"),
        declared=counts[0],
        decoded=counts[1],
        width=size[0],
        height=size[1],
        focal_prior_px=focal_prior_px,
        settings=settings.model_dump(),
        frames=frames,
        known_cameras=known,
    )
