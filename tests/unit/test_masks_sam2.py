"""The SAM 2 backend on a tiny model with random weights: loading, prompting, propagation. Not the quality of its masks."""

import numpy as np
import pytest
from table_scene import ball_scene

from gsbridge.errors import InputError
from gsbridge.masks import MaskSettings, segment_object
from gsbridge.masks.prompt import find_object
from gsbridge.masks.sam2 import frame_tensor, load_model, prompt_points, propagate
from gsbridge.photogrammetry.sparse import read_points

transformers = pytest.importorskip("transformers", reason="the optional extra sam2 (transformers) is not installed")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return ball_scene(tmp_path_factory.getbasetemp() / "ball")


@pytest.fixture(scope="module")
def prompt(scene):
    return find_object(scene.views, read_points(scene.points_npz), 0.008, 8)


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A `Sam2VideoModel` of 64 px input and a few thousand weights, saved as a user's weights would be."""
    import torch

    torch.manual_seed(0)
    vision = transformers.Sam2VisionConfig(
        backbone_config={
            "model_type": "sam2_hiera_det_model",
            "hidden_size": 8,
            "image_size": [64, 64],
            "num_attention_heads": 1,
            "blocks_per_stage": [1, 1, 1, 1],
            "embed_dim_per_stage": [8, 16, 32, 64],
            "num_attention_heads_per_stage": [1, 1, 2, 4],
            "window_size_per_stage": [4, 2, 4, 2],
            "global_attention_blocks": [],
            "window_positional_embedding_background_size": [4, 4],
        },
        backbone_channel_list=[64, 32, 16, 8],
        backbone_feature_sizes=[[16, 16], [8, 8], [4, 4]],
        fpn_hidden_size=256,
    )
    config = transformers.Sam2VideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 256, "image_size": 64, "patch_size": 16},
        mask_decoder_config={"hidden_size": 256, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 16},
        image_size=64,
        memory_attention_hidden_size=256,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=32,
        memory_attention_rope_feat_sizes=[4, 4],
        memory_encoder_hidden_size=256,
        memory_encoder_output_channels=64,
        mask_downsampler_embed_dim=256,
        memory_fuser_embed_dim=256,
        memory_fuser_intermediate_dim=64,
    )
    folder = tmp_path_factory.mktemp("sam2")
    transformers.Sam2VideoModel(config).save_pretrained(folder)
    return folder


def test_every_frame_gets_a_mask(scene, prompt, weights):
    masks = propagate(scene.views, prompt, weights)
    assert len(masks) == len(scene.views)
    for mask, view in zip(masks, scene.views, strict=True):
        assert mask.shape == (view.camera.height, view.camera.width)
        assert np.isfinite(mask).all()
        assert mask.min() >= 0
        assert mask.max() <= 1


def test_propagation_repeats(scene, prompt, weights):
    for first, second in zip(propagate(scene.views, prompt, weights), propagate(scene.views, prompt, weights), strict=True):
        assert np.array_equal(first, second)


def test_prompt_points_lie_on_the_object(scene, prompt):
    for view, true in zip(scene.views, scene.inside, strict=True):
        points, labels = prompt_points(view, prompt, 64)
        assert labels.tolist() == [2, 3, 1, 1, 1]
        pixels = points / 64 * (view.camera.width, view.camera.height)
        for x, y in pixels[2:]:
            assert true[int(y), int(x)]
        rows, columns = np.nonzero(true)
        low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
        size = (high - low).max()
        assert np.abs(pixels[0] - low).max() < 0.3 * size
        assert np.abs(pixels[1] - high).max() < 0.3 * size


def test_frames_are_normalised_as_in_training():
    tensor = frame_tensor(np.full((6, 8, 3), 255, np.uint8), 4)
    assert tensor.shape == (3, 4, 4)
    np.testing.assert_allclose(
        tensor[:, 0, 0], (1 - np.array([0.485, 0.456, 0.406])) / np.array([0.229, 0.224, 0.225]), rtol=1e-5
    )


@pytest.mark.parametrize("case", ["none", "missing", "empty", "damaged", "other"])
def test_weights_that_cannot_be_used_are_named(case, tmp_path, weights):
    folder = tmp_path / "weights"
    if case in ("empty", "damaged", "other"):
        folder.mkdir()
    if case == "damaged":
        (folder / "config.json").write_bytes((weights / "config.json").read_bytes())
        (folder / "model.safetensors").write_bytes(b"broken")
    if case == "other":
        (folder / "config.json").write_text("not json")
    with pytest.raises(InputError, match=r"sam2_weights|weights: "):
        load_model(None if case == "none" else folder)


def test_stage_needs_weights_for_sam2(scene, tmp_path):
    with pytest.raises(InputError, match="needs weights"):
        segment_object(scene.views, scene.points_npz, tmp_path / "i", tmp_path / "m.json", MaskSettings(backend="sam2"))
    assert not (tmp_path / "i").exists()
