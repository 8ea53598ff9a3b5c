"""SAM 2 as a mask backend, with weights that the user provides.

The sparse model prompts some frames with a box and points; the model's memory carries the masks through the others. The
processor of transformers is not used, because it needs torchvision; its steps are written out here.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import View, Views
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.logs import ProgressLog
from gsbridge.masks.prompt import Prompt

_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_STD = np.array([0.229, 0.224, 0.225], np.float32)
"""Colour statistics of ImageNet, with which SAM 2 was trained."""

_PROMPT_EVERY = 8
"""Every 8th frame is prompted: the memory reaches seven frames back."""

_POSITIVE, _BOX_LOW, _BOX_HIGH = 1, 2, 3
"""SAM's labels of prompt points."""


def _transformers() -> ModuleType:
    """Import transformers, an optional extra.

    Raises:
        InputError: It is not installed.
    """
    try:
        return importlib.import_module("transformers")
    except ImportError as error:
        raise InputError("masks.backend", "sam2 needs the package transformers", "Run: pip install 'gsbridge[sam2]'") from error


def load_model(weights: str | Path | None) -> Any:
    """Load a `Sam2VideoModel` from a folder, never from the network.

    Args:
        weights: Folder with `config.json` and the weights, as `save_pretrained` writes it.

    Raises:
        InputError: The folder is missing, or holds no such model.
    """
    if not weights:
        raise InputError("masks.sam2_weights", "the sam2 backend needs weights", "Name the folder of a Sam2VideoModel")
    folder = Path(weights)
    if not (folder / "config.json").is_file():
        raise InputError(folder, "this folder holds no config.json of a Sam2VideoModel", "Download the weights into it")
    transformers = _transformers()
    try:
        model, report = transformers.Sam2VideoModel.from_pretrained(folder, local_files_only=True, output_loading_info=True)
    except Exception as error:  # damaged configurations and archives raise many kinds; the user needs one line
        raise InputError(folder, f"the SAM 2 weights cannot be loaded ({error})", "Download them again") from error
    missing = sorted(report["missing_keys"])
    if missing:
        raise InputError(folder, f"{len(missing)} weights are missing, for example {missing[0]}", "Download them again")
    return model.eval()


def frame_tensor(image: Array, size: int) -> Array:
    """Convert a photo to the model's input. [H, W, 3] uint8 -> [3, size, size] float32, normalised."""
    resized = cv2.resize(image, (size, size), interpolation=cv2.INTER_LINEAR).astype(np.float32) / 255.0
    return np.ascontiguousarray(((resized - _MEAN) / _STD).transpose(2, 0, 1))


def prompt_points(view: View, prompt: Prompt, size: int) -> tuple[Array, Array] | None:
    """Box and points of the object in one frame.

    Args:
        view: The frame's view.
        prompt: The object in the table frame.
        size: Side of the model's square input, px.

    Returns:
        Coordinates [N, 2] in the model's input and SAM labels [N]: two box corners, then points on the object; None where
        the object is not in the picture.
    """
    camera = view.camera
    pixels = camera.project(prompt.points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
    inside = np.isfinite(pixels).all(axis=1) & (pixels >= 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
    pixels = pixels[inside]
    if len(pixels) < 3:
        return None
    low, high = np.percentile(pixels, [2, 98], axis=0)
    pad = 0.06 * (high - low)
    limit = np.array([camera.width, camera.height], dtype=np.float64)
    corners = np.clip([low - pad, high + pad], 0.0, limit)
    # The points nearest to the median and to each quartile lie safely inside the object.
    targets = np.quantile(pixels, [0.5, 0.25, 0.75], axis=0)
    inner = pixels[[int(np.argmin(np.linalg.norm(pixels - target, axis=1))) for target in targets]]
    points = np.concatenate([corners, inner]) * (size / limit)
    return points.astype(np.float32), np.array([_BOX_LOW, _BOX_HIGH] + [_POSITIVE] * len(inner), np.int32)


def _frame_order(views: Sequence[View]) -> list[int]:
    """Indices of the views in the order of filming, which is the order of their names."""
    return sorted(range(len(views)), key=lambda index: views[index].name)


def propagate(views: Views, prompt: Prompt, weights: str | Path | None, threads: int = 1) -> list[Array]:
    """Masks of all views by SAM 2.

    Args:
        views: Posed photos.
        prompt: The object in the table frame.
        weights: Folder of a `Sam2VideoModel`.
        threads: Threads torch may use.

    Returns:
        One soft mask per view, 0..1. [H, W] float32 each.

    Raises:
        InputError: The weights cannot be used, or no frame shows the object.
    """
    model = load_model(weights)
    import torch

    session_type = importlib.import_module("transformers.models.sam2_video.modeling_sam2_video").Sam2VideoInferenceSession
    torch.set_num_threads(threads)
    size = model.config.image_size
    size = int(size if isinstance(size, int) else size[0])
    device = "cuda" if torch.cuda.is_available() else "cpu"
    model = model.to(device)
    order = _frame_order(views)
    video = np.stack([frame_tensor(read_image_u8(views.path(views[index])), size) for index in order])
    first = views[order[0]].camera
    session = session_type(
        video=torch.from_numpy(video),
        video_height=first.height,
        video_width=first.width,
        inference_device=device,
        inference_state_device=device,
        dtype=torch.float32,
    )
    slot = session.obj_id_to_idx(1)
    progress = ProgressLog(len(order), "masks (SAM 2)")
    soft: dict[int, Array] = {}
    with torch.inference_mode():
        prompted = []
        for frame, index in enumerate(order):
            found = prompt_points(views[index], prompt, size) if frame % _PROMPT_EVERY == 0 else None
            if found is None:
                continue
            points, labels = (torch.from_numpy(item)[None, None] for item in found)
            session.add_point_inputs(slot, frame, {"point_coords": points, "point_labels": labels})
            session.obj_with_new_inputs = [1]
            model(inference_session=session, frame_idx=frame)
            prompted.append(frame)
        if not prompted:
            raise InputError(
                views.images, "no prompted photo shows the object", "Check the poses and points of the align stage"
            )
        for reverse in (False, True):
            # Forwards from the first prompt; the frames before it, if any, backwards.
            if reverse and prompted[0] == 0:
                continue
            for output in model.propagate_in_video_iterator(session, start_frame_idx=prompted[0], reverse=reverse):
                if output.frame_idx not in soft:
                    soft[output.frame_idx] = torch.sigmoid(output.pred_masks[0, 0]).float().cpu().numpy()
                    progress.update()
    masks: list[Array] = [np.zeros((0, 0), np.float32)] * len(order)
    for frame, index in enumerate(order):
        camera = views[index].camera
        masks[index] = cv2.resize(soft[frame], (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)
    return masks
