"""`policy.onnx` acts like the policy beside it, says whose it is, and is the same file every time."""

import numpy as np
import onnx
import pytest
import torch
from driver_fixture import spec, write_policy
from onnx.reference import ReferenceEvaluator

from gsbridge.environment.env import PROPRIO
from gsbridge.errors import InputError, StageError
from gsbridge.policy import onnx as module
from gsbridge.policy.export import load_policy, save_policy
from gsbridge.policy.format import SPEC
from gsbridge.policy.networks import Actor
from gsbridge.policy.onnx import MODEL, TOLERANCE, export_onnx, load_onnx


def observations(size, count=12):
    rng = np.random.default_rng(3)
    for _ in range(count):
        blocks = rng.integers(0, 256, (size // 4, size // 4, 3)).repeat(4, 0).repeat(4, 1)
        yield {"image": blocks.astype(np.uint8), "proprio": rng.normal(0, 2, PROPRIO).astype(np.float32)}


@pytest.mark.parametrize("size", [64, 128])
def test_acts_like_the_policy(tmp_path, size):
    write_policy(tmp_path, image_size=size)
    assert export_onnx(tmp_path) <= TOLERANCE
    policy, other = load_policy(tmp_path), load_onnx(tmp_path)
    actions = []
    for observation in observations(size):
        expected = policy(observation)
        found = other(observation, {})
        np.testing.assert_allclose(found, expected, atol=1e-5)
        assert found.shape == (5,)
        assert found.dtype == np.float32
        actions.append(found)
    # Not a constant: the comparison means something.
    assert np.ptp(actions, axis=0).min() > 0.01


def test_another_runtime_agrees(tmp_path):
    """ONNX's own evaluator in numpy knows nothing of onnxruntime's fused kernels."""
    export_onnx(write_policy(tmp_path))
    observation = next(observations(64))
    feeds = {"image": observation["image"][None], "proprio": observation["proprio"][None]}
    found = ReferenceEvaluator(str(tmp_path / MODEL)).run(["action"], feeds)[0][0]
    np.testing.assert_allclose(found, load_policy(tmp_path)(observation), atol=1e-5)


def test_same_weights_same_bytes_and_it_says_whose_it_is(tmp_path):
    write_policy(tmp_path)
    export_onnx(tmp_path)
    first = (tmp_path / MODEL).read_bytes()
    export_onnx(tmp_path)
    assert (tmp_path / MODEL).read_bytes() == first
    graph = onnx.load(tmp_path / MODEL)
    facts = {entry.key: entry.value for entry in graph.metadata_props}
    policy = load_policy(tmp_path)
    assert facts["sha256"] == policy.spec["sha256"]
    assert facts["task"] == "grasp"
    for side, values in (("inputs", graph.graph.input), ("outputs", graph.graph.output)):
        described = policy.spec["onnx"][side]
        assert [value.name for value in values] == list(described)
        for value in values:
            kind = value.type.tensor_type
            assert [axis.dim_value for axis in kind.shape.dim] == described[value.name]["shape"]
            assert np.dtype(onnx.helper.tensor_dtype_to_np_dtype(kind.elem_type)).name == described[value.name]["type"]


def test_a_graph_of_other_weights_is_refused(tmp_path):
    export_onnx(write_policy(tmp_path))
    torch.manual_seed(9)
    save_policy(tmp_path, Actor().state_dict(), spec())
    with pytest.raises(InputError, match="other weights"):
        load_onnx(tmp_path)
    (tmp_path / MODEL).write_bytes(b"no graph")
    with pytest.raises(InputError, match="cannot run it"):
        load_onnx(tmp_path)
    (tmp_path / MODEL).unlink()
    with pytest.raises(InputError, match="cannot be read"):
        load_onnx(tmp_path)
    (tmp_path / SPEC).unlink()
    with pytest.raises(InputError, match="does not exist"):
        export_onnx(tmp_path)


@pytest.mark.parametrize("name", ["encoder.layers.2.bias", "body.0.weight", "mean.bias"])
def test_a_graph_that_acts_otherwise_is_never_written(tmp_path, monkeypatch, name):
    write_policy(tmp_path)
    right = module.build_graph

    def wrong(weights, size):
        return right({**weights, name: weights[name] * np.float32(1.001)}, size)

    monkeypatch.setattr(module, "build_graph", wrong)
    with pytest.raises(StageError, match="differ"):
        export_onnx(tmp_path)
    assert not (tmp_path / MODEL).exists()
    assert not list(tmp_path.glob(".*part*"))
