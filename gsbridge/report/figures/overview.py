"""The whole pipeline in one picture and in a clip of some twenty seconds: film, splats, arm, and how many trials succeeded."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from gsbridge.asset.bundle import read_asset
from gsbridge.cameras import Camera, Views, look_at, read_views
from gsbridge.environment.build import StageFiles
from gsbridge.environment.gaussian_renderer import OBJECT, GaussianRenderer
from gsbridge.environment.onlooker import PAPER as ROOM
from gsbridge.environment.onlooker import OnlookerView
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.images import read_image
from gsbridge.report.figures.onlooker_films import BORDER, EVERY, HEIGHT, WIDTH, told_starts, trial_tile
from gsbridge.report.figures.paired_trials import SIM, STEP_S, ShownTrials, Start, cell_name, read_starts
from gsbridge.report.figures.trial_films import INK, PAPER, SOFT, label_font, write_film
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.success import POSE_TITLES
from gsbridge.statistics import wilson_interval

GAP, HEAD, FOOT = 12, 40, 30
"""Room between panels, line above and line below them, px."""
SHOWN_S, ORBIT_PICTURES, HOLD_S = 4.0, 40, 1.5
"""Duration of film and of orbit, s each; number of pictures of the orbit; how long the end of a trial stays, s."""
LAST_S = 3.5
"""How long the counts stay at the end, s."""
MOST_BYTES, MOST_PICTURE_BYTES = 2_000_000, 300_000

MIRROR_NOTE = "mirror: gsbridge's path-traced stand-in for reality"
COLOURS = ((16, 108, 142), (191, 84, 26))
"""Colours of simulation and of the second world, as in the figures."""

BAR = (96, WIDTH - 62)
"""Where shares 0 and 1 lie in the picture of the counts, px."""

Panel = tuple[Array, str]
"""A picture, uint8 [HEIGHT, WIDTH, 3], and its caption."""


@dataclass(frozen=True)
class FilmedScene:
    """A scene as its film shows it.

    Args:
        views: `views.json` of the align stage.
        images: Folder of its images.
        source: Who filmed, such as `a phone` or `the mirror's camera`.
    """

    views: str | Path
    images: str | Path
    source: str

    def read(self) -> Views:
        """Read all registered views.

        Raises:
            InputError: There is no view.
        """
        found = read_views(self.views, self.images)
        if not len(found):
            raise InputError(self.views, "it holds no view", "Run the align stage again")
        return found


def write_overview(
    cell: CellPaths, trials: Sequence[ShownTrials], scene: StageFiles, films: Mapping[str, FilmedScene], out: Mapping[str, str]
) -> None:
    """Write the picture and the clip.

    Args:
        cell: What the policy learned.
        trials: Trials of the policy; one world or two, the same for all seeds.
        scene: Splats of object, table and robot.
        films: Films of `item` (the object) and `background` (the table).
        out: `picture`, a JPEG, and `clip`, a WebP.

    Raises:
        InputError: Something is missing or damaged, or a file cannot be made small.
    """
    starts = read_starts(trials)
    filmed = _filmed(scene, films, starts[0].pose)
    played = [_played(OnlookerView.build(scene, WIDTH, HEIGHT), start) for start in told_starts(starts)]
    counted = _counted(starts)
    title = f"{cell.task.replace('_', ' ').capitalize()}: {cell_name(cell)}"
    pages: list[tuple[list[Panel], str, float]] = []
    for number, pair in enumerate(filmed):
        seconds = SHOWN_S / (len(filmed) // 2)
        head = "1 · Film the object, film the table" if number < len(filmed) // 2 else "2 · Both become splats, in metres"
        pages.append((pair, head, seconds))
    for line in played:
        head = "3 · A policy learns in the splats, and is tried"
        pages += [(pair, head, STEP_S * EVERY) for pair in line]
        pages[-1] = (*pages[-1][:2], HOLD_S)
    pages.append(([played[0][-1][-1], (counted, "95 % intervals; a dot is the share that succeeded")], "4 · Counted", LAST_S))
    frames = [_page(pair, head, title) for pair, head, _ in pages]
    write_film(frames, [round(1000 * seconds) for *_, seconds in pages], out["clip"], MOST_BYTES)
    middle = played[0][2 * len(played[0]) // 3]
    panels = [
        (filmed[len(filmed) // 8][0][0], f"1 · film by {films['item'].source}"),
        (filmed[-len(filmed) // 4][1][0], "2 · object and table as splats, in metres"),
        (middle[-1][0], "3 · a policy learns in them, and is tried"),
        (counted, "4 · successes are counted"),
    ]
    _write_picture(_page(panels, f"From a film to a policy. {title}", MIRROR_NOTE), out["picture"])


def _filmed(scene: StageFiles, films: Mapping[str, FilmedScene], pose: tuple[float, float, float]) -> list[list[Panel]]:
    """Make pairs of panels: films of object and table, then the object's film beside an orbit round its splats on the table."""
    shown = {name: film.read() for name, film in films.items()}
    count = max(len(views) for views in shown.values())
    pairs = []
    for number in range(count):
        pair = []
        for name, views in shown.items():
            view = views[number * len(views) // count]
            label = f"the {'object' if name == 'item' else 'table'}, filmed by {films[name].source}"
            pair.append((_fitted(read_image(views.path(view))), label))
        pairs.append(pair)
    orbit = _orbit(scene, pose)
    rest = [pairs[number * count // len(orbit)][0] for number in range(len(orbit))]
    label = "object on table, as splats: nothing here is a photo"
    drawn = [[film, (picture, label)] for film, picture in zip(rest, orbit, strict=True)]
    # Both halves have the same number of pictures, so that they last equally long.
    return [pairs[number * count // len(orbit)] for number in range(len(orbit))] + drawn


def _orbit(scene: StageFiles, start: tuple[float, float, float]) -> list[Array]:
    """Draw the object at a start pose (x, y, m, and yaw, rad) on the table, from an eye that moves half round it."""
    item, table = read_asset(scene.item), read_asset(scene.background)
    camera = Camera(WIDTH, HEIGHT, 1.05 * WIDTH, 1.05 * WIDTH, WIDTH / 2, HEIGHT / 2)
    renderer = GaussianRenderer(item.cloud(), table.cloud(), {}, camera, surface=table.mesh(), backdrop=ROOM, oversampling=1)
    size = float(np.ptp(item.mesh().vertices, axis=0).max())
    x, y, yaw = start
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:2, 3] = x, y
    middle = pose[:3, 3] + (0.0, 0.0, 0.4 * size)
    out = []
    for turn in np.radians(np.linspace(-140.0, 40.0, ORBIT_PICTURES)):
        eye = middle + 6.0 * size * np.array([np.cos(turn), np.sin(turn), 0.62])
        out.append(renderer.render({OBJECT: pose}, look_at(eye, middle)))
    return out


def _played(view: OnlookerView, start: Start) -> list[list[Panel]]:
    """Make the panels of a start in each world, moment by moment."""
    drawn = {world: view.pictures(trial.path, EVERY) for world, trial in start.trials.items()}
    out = []
    for moment in range(max(len(pictures) for pictures in drawn.values())):
        pair = []
        for world, trial in start.trials.items():
            ended = moment >= len(drawn[world]) - 1
            text = f"{_named(world)}, start {start.label}" + (f": {trial.outcome()}" if ended else "")
            pair.append((trial_tile(trial, drawn[world], moment)[BORDER:-BORDER, BORDER:-BORDER], text))
        out.append(pair)
    return out


def _counted(starts: Sequence[Start]) -> Array:
    """Draw successes by set of start poses and world, with their intervals. uint8 [HEIGHT, WIDTH, 3]."""
    image = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
    draw = ImageDraw.Draw(image)
    sets = list(dict.fromkeys(start.pose_set for start in starts))
    worlds = list(starts[0].trials)
    (left, right), step = BAR, (HEIGHT - 36) // (len(sets) * (len(worlds) + 1))
    y = 16
    for pose_set in sets:
        draw.text((10, y), POSE_TITLES[pose_set], fill=INK, font=label_font(14))
        for world, colour in zip(worlds, COLOURS, strict=False):
            y += step
            won = [start.trials[world].success for start in starts if start.pose_set == pose_set]
            low, high = wilson_interval(sum(won), len(won))
            x = [left + round((right - left) * share) for share in (0.0, low, sum(won) / len(won), high, 1.0)]
            draw.text((10, y), _named(world), fill=colour, font=label_font(13))
            middle = y + 9
            draw.line((x[0], middle, x[4], middle), fill=(224, 229, 234), width=2)
            draw.line((x[1], middle, x[3], middle), fill=colour, width=3)
            draw.ellipse((x[2] - 5, middle - 5, x[2] + 5, middle + 5), fill=colour)
            draw.text((WIDTH - 10, y), f"{sum(won)} of {len(won)}", fill=INK, font=label_font(13), anchor="ra")
        y += step
    return np.asarray(image)


def _named(world: str) -> str:
    """A world's name for people."""
    return "simulation" if world == SIM else world.replace("_", " ")


def _page(panels: Sequence[Panel], head: str, title: str) -> Array:
    """Lay out panels in rows of two, with a line of text above all and one below each. [H, W, 3] uint8."""
    lines = -(-len(panels) // 2)
    size = (GAP + 2 * (WIDTH + GAP), HEAD + lines * (HEIGHT + FOOT))
    canvas = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, 9), head, fill=INK, font=label_font(17))
    draw.text((size[0] - GAP, 12), title, fill=SOFT, font=label_font(12), anchor="ra")
    for number, (picture, text) in enumerate(panels):
        x, y = GAP + number % 2 * (WIDTH + GAP), HEAD + number // 2 * (HEIGHT + FOOT)
        canvas.paste(Image.fromarray(picture), (x, y))
        draw.text((x, y + HEIGHT + 5), text, fill=INK, font=label_font(15))
    return np.asarray(canvas)


def _fitted(picture: Array) -> Array:
    """Scale and cut a photo to the shape of a panel. uint8 [HEIGHT, WIDTH, 3]."""
    scale = max(WIDTH / picture.shape[1], HEIGHT / picture.shape[0])
    size = (max(WIDTH, round(scale * picture.shape[1])), max(HEIGHT, round(scale * picture.shape[0])))
    large = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    top, left = (size[1] - HEIGHT) // 2, (size[0] - WIDTH) // 2
    return np.clip(np.rint(255.0 * large[top : top + HEIGHT, left : left + WIDTH]), 0, 255).astype(np.uint8)


def _write_picture(picture: Array, out: str | Path) -> None:
    """Write a JPEG of the highest quality that keeps to `MOST_PICTURE_BYTES`; of the lowest one where none does."""
    for quality in (90, 80, 70, 60):
        memory = io.BytesIO()
        Image.fromarray(picture).save(memory, "JPEG", quality=quality, optimize=True)
        if memory.tell() <= MOST_PICTURE_BYTES:
            break
    with atomic_file(out) as temporary:
        temporary.write_bytes(memory.getvalue())
