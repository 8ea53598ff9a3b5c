"""Pictures of good and bad captures for the filming guide, as a phone would take them in a mirror world of severity 2."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsbridge.cameras import Camera, look_at
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.photogrammetry.board import find_tags, standard_board
from gsbridge.reality.world.camera import MirrorCamera, Quality, Setting, expose
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_robot
from gsbridge.reality.world.severity import Severity, worsened

WORLD, SEVERITY = 7, 2
"""Seed and severity of the world that is photographed."""
WIDTH, HEIGHT, GAP, HEAD, FOOT = 480, 360, 12, 40, 54
SPOT = (0.0, 0.185)
"""Position of the object, as in the films, table frame, m."""
COLUMNS, MOST_BYTES = 4, 290_000
GOOD, BAD = (24, 110, 62), (178, 38, 46)
INK, PAPER = (29, 39, 51), (251, 252, 253)


@dataclass(frozen=True)
class Example:
    """One picture of the guide.

    Args:
        good: Whether this is a good way to film.
        text: One line that says what is right or wrong.
        azimuth_deg, elevation_deg, distance: Position of the camera as seen from the point that it aims at; the distance in m.
        aim: Point at which the camera aims, table frame, m; None for a point between object and board.
        object: Whether the object is there.
        exposure: Factor on the exposure.
        blur_deg: Angle by which the camera turns while the shutter is open.
        board: Whether the board lies there.
    """

    good: bool
    text: str
    azimuth_deg: float
    elevation_deg: float
    distance: float
    aim: tuple[float, float, float] | None = None
    object: bool = True
    exposure: float = 1.0
    blur_deg: float = 0.0
    board: bool = True

    def poses(self) -> list[Array]:
        """Return `cam_from_table` at the moments of the exposure. [4, 4] each."""
        azimuth, elevation = np.radians([self.azimuth_deg, self.elevation_deg])
        across = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(elevation)
        aim = np.array(self.aim or (SPOT[0], 0.66 * SPOT[1], 0.02))
        pose = look_at(aim + self.distance * np.array([*across, np.sin(elevation)]), aim)
        out = []
        for turn in np.radians(self.blur_deg) * (np.linspace(-0.5, 0.5, 9) if self.blur_deg else np.zeros(1)):
            moved = np.eye(4)
            moved[0, 0], moved[0, 2], moved[2, 0], moved[2, 2] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
            out.append(moved @ pose)
        return out


EXAMPLES = (
    Example(True, "first round: 30° above the table, all tags free", -70.0, 30.0, 0.55),
    Example(True, "second round: 55°, board and object whole", 20.0, 55.0, 0.52),
    Example(True, "the table alone, from higher and wider", -110.0, 50.0, 0.75, object=False),
    Example(False, "too near: no tag in view, little of the table", -70.0, 30.0, 0.15, aim=(SPOT[0], SPOT[1], 0.03)),
    Example(False, "too far: few pixels on object and tags", -70.0, 28.0, 1.5),
    Example(False, "moved too fast: everything is smeared", -70.0, 30.0, 0.46, blur_deg=4.0),
    Example(False, "too dark: noise instead of texture", -70.0, 30.0, 0.46, exposure=0.02),
    Example(False, "no board: nothing tells how large things are", 20.0, 40.0, 0.46, board=False),
)


def draw_capture_guide(out: str | Path, threads: int, samples: int = 24) -> None:
    """Photograph the examples and write them as one labelled sheet.

    Args:
        out: JPEG file to write.
        threads: Threads to render with.
        samples: Least number of samples per pixel.
    """
    hidden = worsened(Hidden.draw(WORLD), WORLD, Severity(look=SEVERITY))
    rows = -(-len(EXAMPLES) // COLUMNS)
    size = (GAP + COLUMNS * (WIDTH + GAP), HEAD + rows * (HEIGHT + FOOT))
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    note = f"Path-traced in gsbridge's mirror at severity {SEVERITY}, world {WORLD}; no photos of a real phone"
    draw.text((GAP, 8), note, fill=INK, font=_font(22))
    for number, example in enumerate(EXAMPLES):
        picture = photo_of(example, hidden, threads, samples, number)
        x, y = GAP + number % COLUMNS * (WIDTH + GAP), HEAD + number // COLUMNS * (HEIGHT + FOOT)
        sheet.paste(Image.fromarray(picture), (x, y))
        # Double the picture's size first: more tags are found in larger pictures, and a film's pictures are larger than these.
        tags = len(find_tags(cv2.resize(picture, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC), standard_board("a4")))
        colour = GOOD if example.good else BAD
        draw.rectangle((x, y, x + WIDTH - 1, y + HEIGHT - 1), outline=colour, width=5)
        draw.text((x, y + HEIGHT + 3), ("good · " if example.good else "bad · ") + example.text, fill=colour, font=_font(18))
        draw.text((x, y + HEIGHT + 26), f"tags found: {tags} of 8", fill=INK, font=_font(16))
    for quality in (85, 75, 65, 50):
        memory = io.BytesIO()
        sheet.save(memory, "JPEG", quality=quality, optimize=True)
        if memory.tell() <= MOST_BYTES:
            break
    with atomic_file(out) as temporary:
        temporary.write_bytes(memory.getvalue())


def photo_of(example: Example, hidden: Hidden, threads: int, samples: int, seed: int) -> Array:
    """Take the photo that a phone would take. uint8 [HEIGHT, WIDTH, 3].

    Args:
        example: The scene and the camera's pose and exposure.
        hidden: Hidden parameters of the world.
        threads: Threads to render with.
        samples: Samples per pixel of the whole exposure; each moment of it gets at least 4.
        seed: Seed of the samples and the noise.
    """
    setting = Setting("small_cube" if example.object else None, "foam_pad", "a4" if example.board else None)
    with TemporaryDirectory() as folder:
        room = MirrorCamera(setting, true_robot(Path(folder) / "robot", hidden), hidden, threads)
    place = np.eye(4)
    place[:3, 3] = *SPOT, 0.0
    room.move({"object": place})
    poses = example.poses()
    quality = Quality(max(4, samples // len(poses)))
    camera = Camera(WIDTH, HEIGHT, 0.83 * WIDTH, 0.83 * WIDTH, WIDTH / 2, HEIGHT / 2)
    light = np.mean([room.light(camera, pose, quality, 100 * seed + k) for k, pose in enumerate(poses)], axis=0)
    taken = hidden.changed({"exposure": hidden.exposure * example.exposure})
    return expose(light, taken, np.random.default_rng([seed, 2]))


def _font(size: int) -> ImageFont.FreeTypeFont:
    """Return the font that comes with Pillow, which is the same on every machine."""
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font
