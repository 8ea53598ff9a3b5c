"""A policy as `policy.onnx`: raw camera pixels and proprio in, action out, for programs without PyTorch.

| name | | type | shape |
|---|---|---|---|
| `image` | in | uint8, RGB, sRGB | [1, size, size, 3] |
| `proprio` | in | float32 | [1, 12] |
| `action` | out | float32, -1..1 | [1, 5] |

The graph is small, so it is written node by node, not traced. PyTorch's exporters change from release to release (one computes
in float64, another needs a further package), whereas here the same weights give the same bytes. The graph includes the
preprocessing of the picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from gsbridge import __version__
from gsbridge.environment.proprioception import PROPRIO
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.policy.export import Policy, load_policy
from gsbridge.policy.format import INPUTS, OUTPUTS
from gsbridge.policy.observation import PICTURE_OFFSET, PICTURE_SCALE
from gsbridge.reading import refusing, regular_file
from gsbridge.sim.actions import SIZE

MODEL = "policy.onnx"
OPSET = 17
"""Version of the operators; old enough for onnxruntime 1.12 of 2022, which robots' computers still have."""

IR_VERSION = 8

TOLERANCE = 1e-5
"""Largest difference of an action between PyTorch and onnxruntime: both sum in float32, in another order."""

LARGEST_GRAPH = 2**30
"""Largest accepted size of a graph, bytes. An actor's graph has some megabytes."""

_STRIDES = (2, 2, 1)
_CHECKS = 16


def export_onnx(folder: str | Path) -> float:
    """Write `policy.onnx` beside a policy, and compare the two on random observations.

    Args:
        folder: Folder of `policy.safetensors` and `policy.json`.

    Returns:
        Largest difference of an entry of the actions.

    Raises:
        InputError: The policy is missing or damaged.
        StageError: The two do not act alike.
    """
    policy = load_policy(folder)
    weights = {name: value.numpy() for name, value in policy.actor.state_dict().items()}
    model = build_graph(weights, policy.image_size)
    for key, value in sorted({**_metadata(policy), "gsbridge": __version__}.items()):
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.checker.check_model(model, full_check=True)
    content = model.SerializeToString(deterministic=True)
    difference = _difference(policy, OnnxPolicy.of_bytes(content, policy.image_size))
    if not difference <= TOLERANCE:
        raise StageError(
            str(Path(folder) / MODEL),
            f"its actions differ from the policy's by {difference:.2g}",
            "Check the versions of torch and onnxruntime",
        )
    with atomic_file(Path(folder) / MODEL) as temporary:
        temporary.write_bytes(content)
    return difference


class OnnxPolicy:
    """A policy run by onnxruntime; called like `gsbridge.policy.export.Policy`.

    Args:
        session: The session of onnxruntime that runs the graph.
        image_size: Edge of the picture, px.
        metadata: Metadata of the file: `sha256` of the weights, `task`, `algo`, `gsbridge`.
    """

    def __init__(self, session: onnxruntime.InferenceSession, image_size: int, metadata: Mapping[str, str]) -> None:
        self.session, self.image_size, self.metadata = session, image_size, dict(metadata)

    @classmethod
    def of_bytes(cls, content: bytes, image_size: int) -> OnnxPolicy:
        """Load the content of `policy.onnx`; it runs on one thread, as sharing so small a network costs more than it saves."""
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        return cls(session, image_size, session.get_modelmeta().custom_metadata_map)

    def __call__(self, observation: Mapping[str, Array], info: Mapping[str, object] | None = None) -> Array:
        """The action for an observation; see `Policy`. float32 [5]."""
        feeds = {
            "image": np.asarray(observation["image"])[None],
            "proprio": np.asarray(observation["proprio"], np.float32)[None],
        }
        return self.session.run(list(OUTPUTS), feeds)[0][0]


def load_onnx(folder: str | Path) -> OnnxPolicy:
    """Read `policy.onnx`, and check that it was made from the policy beside it.

    Raises:
        InputError: A file is missing or damaged, or the graph was made of other weights.
    """
    policy, remedy = load_policy(folder), "Export the policy again"
    path = regular_file(Path(folder) / MODEL, "graph", remedy, LARGEST_GRAPH)
    # onnxruntime has a type of error for each status; all of them mean that it cannot run the file.
    with refusing(path, "onnxruntime cannot run it", remedy):
        out = OnnxPolicy.of_bytes(path.read_bytes(), policy.image_size)
    if out.metadata.get("sha256") != policy.spec["sha256"]:
        raise InputError(path, "it was made of other weights than policy.safetensors", remedy)
    return out


def build_graph(weights: Mapping[str, Array], image_size: int) -> onnx.ModelProto:
    """Build the graph of an actor, without its auxiliary head and without metadata.

    Args:
        weights: State of `gsbridge.policy.networks.Actor`, arrays by name. [...] float32 each.
        image_size: Edge of the picture, px.

    Raises:
        InputError: A weight is missing.
    """
    graph = _Graph(weights)
    x = graph.add("Cast", "image", to=TensorProto.FLOAT)
    x = graph.add("Mul", x, graph.constant("scale", np.array(PICTURE_SCALE, np.float32)))
    x = graph.add("Add", x, graph.constant("offset", np.array(PICTURE_OFFSET, np.float32)))
    x = graph.add("Transpose", x, perm=[0, 3, 1, 2])
    size = image_size
    for number, stride in enumerate(_STRIDES):
        kernel = graph.weights[f"encoder.layers.{2 * number}.weight"].shape[-1]
        x = graph.layer("Conv", x, f"encoder.layers.{2 * number}", strides=[stride, stride], kernel_shape=[kernel, kernel])
        x = graph.add("Relu", x)
        size = (size - kernel) // stride + 1
    x = graph.add("Concat", _soft_argmax(graph, x, size), "proprio", axis=1)
    for name in ("body.0", "body.2"):
        x = graph.add("Relu", graph.layer("Gemm", x, name, transB=1))
    x = graph.layer("Gemm", x, "mean", transB=1)
    graph.nodes.append(helper.make_node("Tanh", [x], list(OUTPUTS)))
    inputs = [
        helper.make_tensor_value_info(INPUTS[0], TensorProto.UINT8, [1, image_size, image_size, 3]),
        helper.make_tensor_value_info(INPUTS[1], TensorProto.FLOAT, [1, PROPRIO]),
    ]
    outputs = [helper.make_tensor_value_info(OUTPUTS[0], TensorProto.FLOAT, [1, SIZE])]
    return helper.make_model(
        helper.make_graph(graph.nodes, "policy", inputs, outputs, graph.tensors),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="gsbridge",
    )


def _soft_argmax(graph: _Graph, features: str, size: int) -> str:
    """Add a soft-argmax as in `gsbridge.policy.networks.SoftArgmax`. [1, C, size, size] -> [1, 3 C]."""
    flat = graph.add("Flatten", graph.add("Squeeze", features, graph.constant("first", np.array([0]))), axis=1)
    share = graph.add("Softmax", flat, axis=1)
    line = np.linspace(-1.0, 1.0, size).astype(np.float32)
    grid = np.stack([np.tile(line, size), np.repeat(line, size)], axis=1)
    places = graph.add("MatMul", share, graph.constant("grid", grid))
    values = graph.add("ReduceSum", graph.add("Mul", share, flat), graph.constant("last", np.array([1])), keepdims=0)
    row = graph.constant("row", np.array([1, -1]))
    return graph.add("Concat", graph.add("Reshape", places, row), graph.add("Reshape", values, row), axis=1)


class _Graph:
    """Nodes and tensors in the order in which they are added, with names that only depend on that order."""

    def __init__(self, weights: Mapping[str, Array]) -> None:
        self.weights = weights
        self.nodes: list[onnx.NodeProto] = []
        self.tensors: list[onnx.TensorProto] = []

    def add(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """Append a node; returns the name of its result."""
        name = f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], name=name, **attributes))
        return name

    def constant(self, name: str, value: Array) -> str:
        """Append a tensor; returns its name."""
        self.tensors.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def layer(self, kind: str, x: str, name: str, **attributes: Any) -> str:
        """Append a layer with weight and bias; returns the name of its result."""
        tensors = (self.constant(f"{name}.{part}", self.weights[f"{name}.{part}"]) for part in ("weight", "bias"))
        return self.add(kind, x, *tensors, **attributes)


def _metadata(policy: Policy) -> dict[str, str]:
    """Return the metadata of the graph."""
    return {name: str(policy.spec[name]) for name in ("sha256", "task", "algo") if name in policy.spec}


def _difference(policy: Policy, other: OnnxPolicy) -> float:
    """Return the largest difference of two policies over random observations; NaN if one of them gives NaN."""
    rng, size = np.random.default_rng(0), policy.image_size
    worst = 0.0
    for number in range(_CHECKS):
        # Pure noise would never move the soft-argmax far, so half of the pictures are coarse patches.
        coarse = rng.integers(0, 256, (8, 8, 3)).repeat(size // 8, 0).repeat(size // 8, 1)
        image = (coarse if number % 2 else rng.integers(0, 256, (size, size, 3))).astype(np.uint8)
        observation: dict[str, Array] = {"image": image, "proprio": rng.uniform(-2, 2, PROPRIO).astype(np.float32)}
        # max() would ignore a NaN.
        worst = float(np.maximum(worst, np.abs(policy(observation) - other(observation)).max()))
    return worst
