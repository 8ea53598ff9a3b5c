"""Filming: renders every frame of a scene, its ground truth, and the highest PSNR that the renderer's noise allows.

Filming can be resumed. Each finished frame is kept in a state folder, so that an interruption loses at most the current frame.
The caller names that folder after settings and code.
"""

from __future__ import annotations

import itertools
import shutil
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.cameras import Camera, split_of
from gsbridge.configuration.films import FilmSettings, Take
from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, write_json, write_stage
from gsbridge.geometry import Array
from gsbridge.images import psnr, read_image, srgb_from_linear, write_image
from gsbridge.logs import ProgressLog
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.photogrammetry.board import standard_board
from gsbridge.reality.mirror.backgrounds import TABLE_SIZE_M
from gsbridge.reality.mirror.lens import PhoneLens
from gsbridge.reality.mirror.path import background_path, pan_path
from gsbridge.reality.mirror.path_tracer import variant
from gsbridge.reality.mirror.studio import SCENES, Studio, build_studio
from gsbridge.reality.mirror.takes import take_camera, take_gains, take_path

DENSE = "dense_pan"
"""Scene of the film that tests the choice of keyframes: video frame rate, known motion and known blur."""

_FPS = 30.0
_VIDEO_FRAMES_PER_KEYFRAME = 12


@dataclass(frozen=True)
class _Shot:
    """One frame to render: its poses (several are averaged to motion blur), its samples per pixel and its exposure gains."""

    name: str
    poses: Array
    spp: int
    gain: Array = field(default_factory=lambda: np.ones(3))


def film_scene(
    scene: str,
    settings: FilmSettings,
    out_frames: Path,
    out_json: Path,
    out_truth: Path,
    *,
    state: Path,
    threads: int,
    seed: int,
    take: Take | None = None,
) -> None:
    """Film one scene of the mirror.

    Args:
        scene: One of `studio.SCENES`.
        settings: Size and quality.
        out_frames: Folder for the frames, 8-bit PNG with the lens's distortion.
        out_json: The film's record.
        out_truth: Folder for the hidden ground truth: `truth.json`, `mesh.ply`, `masks/`.
        state: Folder that keeps finished frames until the film is complete. The caller must use another folder for another
            scene, settings, seed or code, because frames found there are used without a check.
        threads: Threads to render with.
        seed: Seed of the world (textures are the same in all films of one seed) and of this film's path and noise.
        take: How an object is filmed; None for the plain walk.

    Raises:
        InputError: The scene is unknown, or a take is given for a scene without an object.
    """
    if take is not None and (scene == DENSE or SCENES.get(scene, (None,))[0] is None):
        raise InputError("mirror", f"the scene '{scene}' has no takes", "Remove the take, or name an object's scene")
    studio = build_studio(scene, settings.sheet, threads, seed)
    lens = PhoneLens.of(take_camera(take, settings.width, settings.height))
    path_rng = np.random.default_rng([seed, zlib.crc32(scene.encode())])
    height = float(studio.truth.vertices[:, 2].max())
    extra: dict[str, Any] = {}
    if scene == DENSE:
        shots, extra = _dense_shots(settings, lens.film, height, path_rng)
    else:
        poses = (
            take_path(take, settings.frames, height, path_rng)
            if SCENES[scene][0]
            else background_path(settings.frames, path_rng)
        )
        gains = take_gains(take, settings.frames, path_rng)
        shots = [
            _Shot(f"{k:04d}.png", pose[None], settings.held_out_spp if split_of(k) == "held_out" else settings.spp, gains[k])
            for k, pose in enumerate(poses)
        ]
    progress = ProgressLog(len(shots), f"film {scene}")
    for number, shot in enumerate(shots):
        _take(studio, lens, shot, state, frame_seed=seed * 100_003 + number)
        progress.update(shot.name)
    ceilings = {} if scene == DENSE else _ceilings(studio, lens, shots, state, settings, seed)
    if take == "re_exposing":
        extra = {"gain": [shot.gain.tolist() for shot in shots]}
    _deliver(scene, settings, lens.film, shots, extra, ceilings, studio.truth, out_frames, out_json, out_truth, state, seed)


def _take(studio: Studio, lens: PhoneLens, shot: _Shot, state: Path, frame_seed: int) -> None:
    """Render one frame and its mask into the state folder, unless they exist already."""
    photo, mask = state / "frames" / shot.name, state / "masks" / shot.name
    if photo.is_file() and mask.is_file():
        return
    # Mitsuba takes seeds of 32 bits.
    parts = [studio.render(lens.pinhole, pose, shot.spp, (frame_seed * 16 + k) % 2**32) for k, pose in enumerate(shot.poses)]
    covers = [studio.coverage(lens.pinhole, pose) for pose in shot.poses]
    write_image(mask, np.clip(lens.warp(np.mean(covers, axis=0)), 0, 1))
    write_image(photo, lens.expose(np.mean(parts, axis=0), np.random.default_rng(frame_seed), shot.gain))


def _ceilings(
    studio: Studio, lens: PhoneLens, shots: list[_Shot], state: Path, settings: FilmSettings, seed: int
) -> dict[str, dict[str, float]]:
    """Return the PSNR that a perfect model reaches against the photos, by samples per pixel, in dB.

    One frame is rendered again with another seed. The noise of one photo, sensor noise and rounding included, is half the mean
    square difference of the two photos. The masked value counts the object's pixels only.
    """
    full: dict[str, float] = {}
    masked: dict[str, float] = {}
    for spp in sorted({settings.spp, settings.held_out_spp}):
        numbers = [number for number, shot in enumerate(shots) if shot.spp == spp]
        if not numbers:
            continue
        number = numbers[len(numbers) // 2]
        shot = shots[number]
        again = replace(shot, name=f"again_{spp}.png")
        _take(studio, lens, again, state, frame_seed=seed * 100_003 + number + 50_000)
        one, two = read_image(state / "frames" / shot.name), read_image(state / "frames" / again.name)
        cover = read_image(state / "masks" / shot.name)[..., 0]
        full[str(spp)] = psnr(one, two) + 10 * np.log10(2)
        if cover.any():
            masked[str(spp)] = psnr(one, two, cover) + 10 * np.log10(2)
    return {"ceiling_db": full, "ceiling_masked_db": masked}


def _deliver(
    scene: str,
    settings: FilmSettings,
    camera: Camera,
    shots: list[_Shot],
    extra: dict[str, Any],
    ceilings: dict[str, Any],
    mesh: Mesh,
    out_frames: Path,
    out_json: Path,
    out_truth: Path,
    state: Path,
    seed: int,
) -> None:
    """Copy a complete film out of the state folder and write its ground truth; the record is written last."""
    stride = 1 if scene == DENSE else _VIDEO_FRAMES_PER_KEYFRAME
    board = standard_board(settings.sheet)
    with atomic_directory(out_frames) as folder:
        for shot in shots:
            shutil.copyfile(state / "frames" / shot.name, folder / shot.name)
    with atomic_directory(out_truth) as folder:
        (folder / "masks").mkdir()
        for shot in shots:
            shutil.copyfile(state / "masks" / shot.name, folder / "masks" / shot.name)
        shown = None if mesh.colours is None else srgb_from_linear(mesh.colours)
        write_mesh(folder / "mesh.ply", replace(mesh, colours=shown))
        frames = []
        for k, shot in enumerate(shots):
            frame: dict[str, Any] = {"name": shot.name, "cam_from_table": shot.poses[len(shot.poses) // 2]}
            frames.append({**frame, **{key: values[k] for key, values in extra.items()}})
        write_json(
            folder / "truth.json",
            {
                "camera": camera.to_json(),
                "frames": frames,
                "object": SCENES[scene][0],
                "background": SCENES[scene][1],
                "table_size_m": TABLE_SIZE_M,
                "board": {
                    "sheet": board.sheet,
                    "tag_size_m": board.tag_size,
                    "ids": list(board.ids),
                    "centres_m": board.centres.tolist(),
                },
            },
        )
    write_stage(
        out_json,
        seed=seed,
        packages=("mitsuba",),
        path_tracer=variant(),
        scene=scene,
        kind="dense" if scene == DENSE else "object" if SCENES[scene][0] else "background",
        width=camera.width,
        height=camera.height,
        fps=_FPS,
        frames=[
            {"name": shot.name, "index": k * stride, "time_s": k * stride / _FPS, "spp": shot.spp * len(shot.poses)}
            for k, shot in enumerate(shots)
        ],
        **ceilings,
    )


def image_motion(camera: Camera, first: Array, second: Array) -> float:
    """Return the mean distance, px, by which points of the table move from one view to the other; NaN if none is in both.

    Args:
        camera: The camera, distortion included.
        first, second: cam_from_table. [4, 4] each.
    """
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 13), np.linspace(-0.2, 0.5, 15))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=-1)
    pixels = [camera.project(points @ pose[:3, :3].T + pose[:3, 3]) for pose in (first, second)]
    inside = [((p > 0) & (p < [camera.width, camera.height])).all(-1) for p in pixels]
    seen = inside[0] & inside[1]
    return float(np.linalg.norm(pixels[1] - pixels[0], axis=-1)[seen].mean()) if seen.any() else float("nan")


def _dense_shots(
    settings: FilmSettings, camera: Camera, height: float, rng: np.random.Generator
) -> tuple[list[_Shot], dict[str, list[Any]]]:
    """Plan the dense film: ten still frames, then motion of changing speed, with about 40 % of the frames shaken.

    A shaken frame is the mean of seven poses of a small turn of the camera during the exposure.

    Returns:
        The shots and, per frame, `motion_px` (motion from the frame before, px), `blur_px` and `blurred`.
    """
    still = min(10, settings.frames // 4)
    speed = 1 + 0.6 * np.sin(np.linspace(0, 4 * np.pi, settings.frames))
    speed[:still] = 0
    place = np.cumsum(speed)
    poses = pan_path(rng, height)(place / place[-1])
    shaken = rng.random(settings.frames) < 0.4
    shaken[: still + 1] = False
    shots, blur = [], []
    for k, pose in enumerate(poses):
        moments = pose[None]
        if shaken[k]:
            reach = rng.uniform(4, 9) * settings.width / 320 / camera.fx
            heading = rng.uniform(0, 2 * np.pi)
            moments = np.stack([_turned(pose, reach * s, heading) for s in np.linspace(-0.5, 0.5, 7)])
        shots.append(_Shot(f"{k:04d}.png", moments, max(1, settings.spp // 2) if shaken[k] else settings.spp))
        blur.append(image_motion(camera, moments[0], moments[-1]) if shaken[k] else 0.0)
    motion = [0.0] + [image_motion(camera, a, b) for a, b in itertools.pairwise(poses)]
    return shots, {"motion_px": motion, "blur_px": blur, "blurred": [bool(s) for s in shaken]}


def _turned(cam_from_table: Array, angle: float, heading: float) -> Array:
    """Turn a camera by a small angle, rad, about an axis perpendicular to the line of sight. -> [4, 4]."""
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(4)
    turn[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return turn @ cam_from_table
