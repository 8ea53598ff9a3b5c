"""The figure that compares photos with renderings of each binding, for print and for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from gsbridge.cameras import View, read_views
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.images import psnr, read_image, read_image_u8, read_mask
from gsbridge.photogrammetry.matting import unmix
from gsbridge.splats.evaluate import render_cloud
from gsbridge.splats.ply import read_ply

SHOWN = ("soft", "games", "refined")
TITLES = {
    "soft": "soft (the paper's)",
    "games": "GaMeS (hard)",
    "games_vertices": "GaMeS, free vertices",
    "refined": "refined (ours)",
    "unbound": "unbound",
}
AMPLIFIED = 5.0
"""Factor by which the difference pictures are amplified."""
GREY = 0.5
"""Grey level behind objects, 0..1: it shows dark and light halos alike."""
ASPECT = 4 / 3
FRAME_COLOUR = "#ffcf33"


@dataclass(frozen=True)
class ComparedScene:
    """Files of one scene in the comparison figure.

    Args:
        name: Scene.
        views_json: Cameras and poses.
        images: Folder of undistorted images.
        splats: {binding: splats.ply}.
        masks: Folder of masks of an object; None for a background.
    """

    name: str
    views_json: Path
    images: Path
    splats: Mapping[str, Path] = field(default_factory=dict)
    masks: Path | None = None


def compared_scene(folder: str | Path, bindings: Sequence[str] = SHOWN) -> ComparedScene:
    """Find the files of a scene in its folder `scenes/{scene}`; bindings that were not trained are left out."""
    scene = Path(folder)
    masks = scene / "masks" / "images"
    splats = {binding: scene / "splats" / binding / "splats.ply" for binding in bindings}
    return ComparedScene(
        name=scene.name,
        views_json=scene / "align" / "views.json",
        images=scene / "sfm" / "images",
        splats={binding: path for binding, path in splats.items() if path.is_file()},
        masks=masks if masks.is_dir() else None,
    )


@dataclass(frozen=True)
class _Panel:
    """Pictures of one scene at one view, all in one crop. Images [H, W, 3]; box and zoom as left, top, width, height, px."""

    name: str
    photo: Array
    shown: dict[str, Array]
    weight: Array
    zoom: tuple[int, int, int, int]


def write_rendering_comparison(scenes: Sequence[ComparedScene], out: str | Path, *, view: str | None = None) -> None:
    """Draw photo, renderings and differences of each scene at a held-out view, with enlarged details.

    Two lines per scene: the picture, and below it the framed part enlarged. The last columns are five times the absolute
    difference between soft or GaMeS and the photo.

    Args:
        scenes: Scenes, one pair of lines each.
        out: Picture (PNG, PDF or SVG).
        view: File name of the view to show where a scene has it; otherwise the middle held-out one.

    Raises:
        InputError: There is no scene, or a file of one cannot be read.
    """
    if not scenes:
        raise InputError(out, "there is no scene to compare", "Train the splats of a scene first")
    panels = [_panel(scene, view) for scene in scenes]
    bindings = [binding for binding in SHOWN if any(binding in panel.shown for panel in panels)]
    differences: list[str] = [binding for binding in ("soft", "games") if binding in bindings] or bindings[:1]
    titles = ["photo (held out)", *(TITLES[b] for b in bindings), *(f"{AMPLIFIED:.0f} × |{b} − photo|" for b in differences)]
    titles = [title.replace("|games", "|GaMeS") for title in titles]
    width = 2.6
    size = (width * len(titles) + 0.5, (width / ASPECT) * 2 * len(panels) + 0.35)
    figure, axes = plt.subplots(2 * len(panels), len(titles), figsize=size, squeeze=False, layout="constrained")
    figure.set_layout_engine("constrained", w_pad=0.02, h_pad=0.02, wspace=0.01, hspace=0.01)
    for index, panel in enumerate(panels):
        _draw_scene(axes[2 * index], axes[2 * index + 1], panel, bindings, differences)
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=13)
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
    plt.close(figure)


def _draw_scene(
    whole: Sequence[Axes], detail: Sequence[Axes], panel: _Panel, bindings: list[str], differences: list[str]
) -> None:
    """Fill the two lines of one scene."""
    pictures: list[Array | None] = [panel.photo, *(panel.shown.get(binding) for binding in bindings)]
    for binding in differences:
        shown = panel.shown.get(binding)
        error = None if shown is None else np.abs(shown - panel.photo) * panel.weight[..., None]
        pictures.append(None if error is None else np.clip(AMPLIFIED * error, 0, 1))
    left, top, width, height = panel.zoom
    for column, image in enumerate(pictures):
        for axis in (whole[column], detail[column]):
            axis.set_xticks([])
            axis.set_yticks([])
        if image is None:
            whole[column].text(
                0.5, 0.5, "not trained", ha="center", va="center", fontsize=12, transform=whole[column].transAxes
            )
            continue
        whole[column].imshow(image, interpolation="antialiased")
        frame = Rectangle((left - 0.5, top - 0.5), width, height, fill=False, edgecolor=FRAME_COLOUR, linewidth=1.4)
        whole[column].add_patch(frame)
        detail[column].imshow(image[top : top + height, left : left + width], interpolation="nearest")
        for side in detail[column].spines.values():
            side.set_edgecolor(FRAME_COLOUR)
            side.set_linewidth(1.8)
    for column, binding in enumerate(bindings, 1):
        if binding in panel.shown:
            value = psnr(panel.shown[binding], panel.photo, panel.weight)
            box = {"facecolor": "black", "alpha": 0.55, "pad": 2.0, "edgecolor": "none"}
            whole[column].text(
                0.02, 0.03, f"{value:.1f} dB", transform=whole[column].transAxes, fontsize=12, color="white", bbox=box
            )
    whole[0].set_ylabel(panel.name.replace("_", " "), fontsize=14)


def _panel(scene: ComparedScene, wanted: str | None) -> _Panel:
    """Render all bindings of a scene at one view and choose crop and detail."""
    views = read_views(scene.views_json, scene.images)
    view = _choose(list(views.of("held_out")) or list(views), wanted)
    photo = read_image(views.path(view))
    weight = np.ones(photo.shape[:2], np.float32)
    if scene.masks is not None:
        weight = read_mask(scene.masks / f"{Path(view.name).stem}.png")
        photo = unmix(read_image_u8(views.path(view)), weight).astype(np.float32) / 255
        photo = photo * weight[..., None] + GREY * (1 - weight[..., None])
    shown = {}
    covered = np.zeros(photo.shape[:2], np.float32)
    for binding, path in scene.splats.items():
        colours, alphas = render_cloud(read_ply(path), view.camera, view.cam_from_table)
        shown[binding] = np.clip(colours + GREY * (1 - alphas[..., None]), 0, 1)
        covered = np.maximum(covered, alphas)
    if scene.masks is None:
        # Beyond the table mesh there is nothing to compare: the differences leave it out.
        weight = (covered > 0.5).astype(np.float32)
    box = _crop(weight if scene.masks is not None else np.ones_like(weight))
    left, top, width, height = box
    part = np.s_[top : top + height, left : left + width]
    zoom = _detail(photo[part], weight[part])
    return _Panel(scene.name, photo[part], {name: image[part] for name, image in shown.items()}, weight[part], zoom)


def _choose(views: Sequence[View], wanted: str | None) -> View:
    """The wanted view where there is one, otherwise the middle one."""
    named = [view for view in views if view.name == wanted]
    return named[0] if named else views[len(views) // 2]


def _crop(weight: Array) -> tuple[int, int, int, int]:
    """Window of the figure's aspect round the pixels that count, with a margin: left, top, width, height."""
    rows, columns = np.flatnonzero((weight > 0.5).any(1)), np.flatnonzero((weight > 0.5).any(0))
    full_height, full_width = weight.shape
    if len(rows) == 0:
        rows, columns = np.array([0, full_height - 1]), np.array([0, full_width - 1])
    height = 1.15 * max(rows[-1] - rows[0] + 1, (columns[-1] - columns[0] + 1) / ASPECT)
    height = min(height, full_height, full_width / ASPECT)
    width = round(height * ASPECT)
    height = round(height)
    middle = ((columns[0] + columns[-1] + 1) / 2, (rows[0] + rows[-1] + 1) / 2)
    left = int(np.clip(middle[0] - width / 2, 0, full_width - width))
    top = int(np.clip(middle[1] - height / 2, 0, full_height - height))
    return left, top, width, height


def _detail(photo: Array, weight: Array) -> tuple[int, int, int, int]:
    """Window of a third of the picture with the most texture inside the pixels that count: left, top, width, height."""
    height, width = max(8, photo.shape[0] // 3), max(8, photo.shape[1] // 3)
    # The rim of an object is the strongest edge of all, but what counts is the texture within.
    thickness = max(3, height // 8)
    inner = cv2.erode((weight > 0.5).astype(np.uint8), np.ones((thickness, thickness), np.uint8))
    gradient = np.hypot(*np.gradient(photo.mean(-1))) * inner

    def window_sums(values: Array) -> Array:
        table = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
        return table[height:, width:] - table[:-height, width:] - table[height:, :-width] + table[:-height, :-width]

    inside = window_sums((weight > 0.5).astype(np.float64)) / (height * width)
    score = window_sums(gradient.astype(np.float64)) * np.minimum(inside, 0.9)
    top, left = np.unravel_index(int(np.argmax(score)), score.shape)
    return int(left), int(top), width, height
