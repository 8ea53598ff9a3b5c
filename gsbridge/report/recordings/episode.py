"""Recording of an episode: robot, object and camera in space, the pictures of all worlds side by side, actions and forces."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.asset.bundle import read_asset
from gsbridge.environment.rendering import wrist_camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.report.recordings.recording import log_camera, log_centres, log_mesh, log_scene_axes, recording
from gsbridge.robot.assembly import RobotFiles
from gsbridge.splats.cloud import Cloud
from gsbridge.tasks.episode import FORCES, OBJECT, Episode, read_episode

PICTURES = {"splats": "Splats", "mesh": "Mesh", "mirror": "Mirror"}
ACTIONS = ("x", "y", "z", "turn", "opening")
AXES = [[220, 50, 50], [50, 180, 50], [60, 90, 230], [230, 160, 40], [150, 90, 200]]
FORCE_COLOURS = [[220, 50, 50], [60, 90, 230], [40, 40, 40], [230, 160, 40]]
LENGTH_COLOURS = [[150, 90, 200], [50, 160, 120]]

PLANE_M = 0.12
"""Distance from the camera at which its picture is drawn in space, m."""

EYE_M, TARGET_M = (0.9, -0.7, 0.9), (-0.15, 0.25, 0.3)
"""Points where the viewer first stands and looks at; table frame, m. The nominal base is at x = -0.6, y = 0.265."""


@dataclass(frozen=True)
class EpisodeFiles:
    """Files that a recording is made of.

    Args:
        episode: File of `gsbridge.tasks.episode`, with the pictures `gs` and `mesh`.
        robot: Folder of the robot's description.
        item: `asset.json` of the object.
        background: `asset.json` of the background.
        photos: Folder of `{step}.png` from the mirror, of some of the steps; None where the mirror has no such scene.
    """

    episode: str | Path
    robot: str | Path
    item: str | Path
    background: str | Path
    photos: str | Path | None = None


def record_episode(files: EpisodeFiles, name: str, out: str | Path) -> None:
    """Record one episode on the timelines `step` and `time` (s).

    Entities: `table/axes`; `table/robot/{link}`, `table/object` (transforms on the timeline) with meshes of the links,
    `table/object/splats` and `/centres` (the same as points, for viewers that do not draw splats);
    `table/background/splats` and `/centres`; `table/camera` (moves) with `splats`, `mesh` and `mirror`;
    `plots/actions` (5), `plots/forces` (4, N), `plots/lengths` (opening and clearance of the object, mm); `summary`.

    Args:
        files: Files that the recording is made of.
        name: Name of the recording: object and background.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged, or files do not belong together.
    """
    episode, links = read_episode(files.episode), RobotFiles.read(files.robot).visuals()
    for renderer in ("gs", "mesh"):
        if renderer not in episode.images:
            raise InputError(files.episode, f"it holds no pictures of the renderer '{renderer}'", "Play the episode again")
    missing = sorted(set(links) - set(episode.names))
    if missing:
        raise InputError(files.episode, f"it has no pose of {', '.join(missing)}", "Play it with this robot")
    photos = {} if files.photos is None else _photos(files.photos, len(episode))
    clouds = {OBJECT: read_asset(files.item).cloud(), "background": read_asset(files.background).cloud()}
    with recording(out, "episode", name, _layout()) as stream:
        log_scene_axes(stream, 0.1)
        for link, parts in links.items():
            for number, (mesh, colour) in enumerate(parts):
                log_mesh(stream, f"table/robot/{link}/{number}", mesh, [round(255 * value) for value in colour])
        for body, cloud in clouds.items():
            _log_cloud(stream, f"table/{body}", cloud)
        _log_series(stream)
        stream.log("summary", rr.TextDocument(_summary(episode, name, photos), media_type="text/markdown"), static=True)
        camera = wrist_camera(episode.images["gs"].shape[1])
        for step in range(len(episode)):
            stream.set_time("step", sequence=step)
            stream.set_time("time", duration=float(episode.time[step]))
            _log_bodies(stream, episode, step, tuple(links))
            log_camera(stream, "table/camera", camera, episode.cam_from_table[step], plane=PLANE_M, static=False)
            _log_picture(stream, "table/camera/splats", episode.images["gs"][step])
            _log_picture(stream, "table/camera/mesh", episode.images["mesh"][step])
            if step in photos:
                _log_picture(stream, "table/camera/mirror", read_image_u8(photos[step]))
            if step < len(episode) - 1:
                stream.log("plots/actions", rr.Scalars(episode.actions[step]))
            stream.log("plots/forces", rr.Scalars(episode.forces[step]))
            stream.log("plots/lengths", rr.Scalars([1e3 * episode.aperture[step], 1e3 * episode.clearance[step]]))


def _layout() -> rrb.Container:
    """Space and summary on the left; pictures above plots on the right."""
    space = [
        rrb.Spatial3DView(
            origin="table",
            name=title,
            eye_controls=rrb.EyeControls3D(position=EYE_M, look_target=TARGET_M, eye_up=(0, 0, 1)),
            contents=[
                "table/axes",
                "table/robot/**",
                "table/object",
                f"table/object/{kind}",
                f"table/background/{kind}",
                "table/camera",
                "table/camera/splats",
            ],
        )
        for title, kind in (("Splats", "splats"), ("Centres", "centres"))
    ]
    pictures = [
        rrb.Spatial2DView(origin=f"table/camera/{entity}", name=title, contents="$origin") for entity, title in PICTURES.items()
    ]
    return rrb.Horizontal(
        rrb.Vertical(rrb.Tabs(*space), rrb.TextDocumentView(origin="summary", name="Summary"), row_shares=[5, 2]),
        rrb.Vertical(
            rrb.Horizontal(*pictures),
            rrb.TimeSeriesView(origin="plots/actions", name="Actions (-1 to 1)"),
            rrb.TimeSeriesView(origin="plots/forces", name="Contact forces (N)"),
            rrb.TimeSeriesView(origin="plots/lengths", name="Opening, and the object's clearance (mm)"),
            row_shares=[5, 3, 3, 3],
        ),
        column_shares=[4, 5],
    )


def _log_cloud(stream: rr.RecordingStream, entity: str, cloud: Cloud) -> None:
    """Log the splats of a body in its frame, and their centres."""
    rgba = np.rint(np.c_[np.clip(cloud.colours, 0, 1), cloud.opacities] * 255).astype(np.uint8)
    stream.log(
        f"{entity}/splats",
        # rerun wants quaternions as xyzw.
        rr.GaussianSplats3D(cloud.means, scales=cloud.scales, quaternions=cloud.quats[:, [1, 2, 3, 0]], colors=rgba),
        static=True,
    )
    log_centres(stream, f"{entity}/centres", cloud)


def _log_series(stream: rr.RecordingStream) -> None:
    """Log the names and colours of the curves."""
    forces = [name.replace("_", " ") for name in FORCES]
    stream.log("plots/actions", rr.SeriesLines(names=list(ACTIONS), colors=AXES), static=True)
    stream.log("plots/forces", rr.SeriesLines(names=forces, colors=FORCE_COLOURS), static=True)
    stream.log("plots/lengths", rr.SeriesLines(names=["opening", "clearance"], colors=LENGTH_COLOURS), static=True)


def _log_bodies(stream: rr.RecordingStream, episode: Episode, step: int, links: tuple[str, ...]) -> None:
    """Log the poses of everything that is drawn, at this step."""
    for name in (OBJECT, *links):
        pose = episode.body(name)[step]
        entity = "table/object" if name == OBJECT else f"table/robot/{name}"
        stream.log(entity, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))


def _log_picture(stream: rr.RecordingStream, entity: str, image: Array) -> None:
    """Log a picture as PNG, because JPEG would blur the few pixels there are. uint8 [H, W, 3]."""
    packed = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1]
    stream.log(entity, rr.EncodedImage(contents=packed.tobytes(), media_type="image/png"))


def _photos(folder: str | Path, count: int) -> dict[int, Path]:
    """Find the photos, by step.

    Raises:
        InputError: There is no photo, or one of a step that the episode does not have.
    """
    paths = sorted(Path(folder).glob("*.png"))
    found = {int(path.stem): path for path in paths if path.stem.isdigit() and int(path.stem) < count}
    if not found or len(found) < len(paths):
        raise InputError(folder, f"its photos do not belong to an episode of {count} states", "Photograph the episode again")
    return found


def _summary(episode: Episode, name: str, photos: dict[int, Path]) -> str:
    """What was done and how it ended, as Markdown."""
    item, _, background = name.replace("_", " ").partition("+")
    x, y, yaw = episode.start_pose
    steps = len(episode) - 1
    if episode.success[-1]:
        end = "success"
    elif episode.success_tolerant[-1]:
        end = "success, but for the rule on excess contact"
    else:
        end = f"failure: {str(episode.failure[-1]).replace('_', ' ')}"
    lines = [
        f"**{episode.task.replace('_', ' ')}**: {item} on {background}, baseline controller",
        "",
        f"- **{end}** after {steps} steps, {episode.time[-1]:.2f} s",
        f"- start pose {episode.start}: x {1e3 * x:.0f} mm, y {1e3 * y:.0f} mm, yaw {np.degrees(yaw):.0f} deg",
        *(f"- largest force, {key.replace('_', ' ')}: {value:.1f} N" for key, value in _largest(episode)),
        f"- pictures of {episode.images['gs'].shape[1]} px; {len(photos)} of {steps + 1} states photographed in the mirror",
    ]
    return "\n".join(lines)


def _largest(episode: Episode) -> list[tuple[str, float]]:
    return [(key, float(value)) for key, value in zip(FORCES, np.nanmax(episode.forces, axis=0), strict=True)]
