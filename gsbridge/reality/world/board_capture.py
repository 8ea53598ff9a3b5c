"""A board capture in the mirror: the arm goes to planned poses, and the wrist camera photographs the board from each.

The poses are planned from the nominal layout, as a person would plan them. Photos and joint angles come from the true layout.
"""

from __future__ import annotations

import logging
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.configuration.films import BoardFilmSettings
from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, write_json
from gsbridge.images import write_image
from gsbridge.logs import ProgressLog
from gsbridge.photogrammetry.board import Board
from gsbridge.reality.world.camera import FIELD_OF_VIEW, MirrorCamera, Quality, Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_flange_from_camera, true_robot
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.registration.capture import ARM_CSV, CAMERA_JSON, write_arm_table, write_camera
from gsbridge.registration.plan import plan_poses
from gsbridge.robot.nominal import base_from_table, flange_from_camera

logger = logging.getLogger("gsbridge")


def full_camera(width: int, height: int) -> Camera:
    """Return the wrist camera with its full picture; the policy's square picture is the middle of it.

    Args:
        width: Width of a photo, px, at least `height`.
        height: Height of a photo, px.

    Raises:
        InputError: The picture is higher than wide, or its height is not positive.
    """
    if not 0 < height <= width:
        raise InputError("config: board_film", f"{width} x {height} px is no lying picture", "Ask for width >= height")
    focal = height / 2 / np.tan(FIELD_OF_VIEW / 2)
    return Camera(width, height, focal, focal, width / 2, height / 2)


def film_board(
    *,
    out_capture: Path,
    out_truth: Path,
    board: Board,
    settings: BoardFilmSettings,
    threads: int,
    seed: int,
    hidden: Hidden,
    background: str = "foam_pad",
) -> None:
    """Photograph the board from many poses of the mirror's arm.

    Args:
        out_capture: Folder for the photos, `arm.csv` and `camera.json`, as `read_board_capture` reads them.
        out_truth: File for the true poses of table and camera, which only scores may use.
        board: The board on the table.
        settings: Number and size of the photos.
        threads: Threads to render with.
        seed: Seed of textures, poses and noise.
        hidden: Hidden parameters of the world.
        background: Background on which the board lies.

    Raises:
        InputError: The size of the photos makes no sense, or the background is unknown.
        StageError: Too few poses see the board.
    """
    camera = full_camera(settings.width, settings.height)
    with TemporaryDirectory() as folder:
        robot = true_robot(Path(folder) / "robot", hidden)
        physics = MirrorPhysics(robot, Stand(true_base_from_table(hidden)), None, hidden)
        room = MirrorCamera(Setting(None, background, board.sheet, seed), robot, hidden, threads)
    wanted = plan_poses(
        physics.kinematics, base_from_table(), flange_from_camera(), camera, board, count=settings.poses, seed=seed
    )
    quality = Quality(samples=settings.spp)
    progress = ProgressLog(len(wanted), "film the board")
    with atomic_directory(out_capture) as place:
        names, measured = [], []
        for index, q in enumerate(wanted):
            # The closed hand hides the least of the board, and an arm at rest gives no blur.
            physics.place(q, 0.0)
            room.move(physics.body_poses())
            names.append(f"pose_{index:02d}.png")
            measured.append(physics.joints()[0][: len(q)])
            grain = int(np.random.SeedSequence([seed, index]).generate_state(1)[0])
            write_image(place / names[-1], room.photo(camera, physics.camera_pose(), quality, grain))
            progress.update()
        write_arm_table(place / ARM_CSV, names, np.array(measured))
        # A camera's maker stores the intrinsics in the camera, so the mirror gives them, too.
        write_camera(place / CAMERA_JSON, camera)
    write_json(
        out_truth,
        {
            "base_from_table": true_base_from_table(hidden),
            "flange_from_camera": true_flange_from_camera(hidden),
            "settings": settings.model_dump(),
            "seed": seed,
        },
    )
    logger.info("%d photos of the board", len(names))
