"""Measure the rasteriser: process CPU time of one view, forward and with gradients.

    python benchmarks/rasterizer.py --json
    python benchmarks/rasterizer.py --backend cpu --threads 2 --scene whole_50k_128

The scenes are synthetic: 40 % of the splats on a table plane, the others on a sphere, a box and a torus, flat discs at 0.8 of
their spacing with log-normal spread, opacities from Beta(2.5, 1), nearly all in view. CPU time leaves out the waiting for other
jobs on the machine, but not the effect of their use of its caches: the minimum of the repeats is the figure that counts, the
median shows the disturbance.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge import logs
from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import Array


@dataclass(frozen=True)
class Workload:
    """Size of one scene, and what is computed on it."""

    splats: int
    size_px: int
    backward: bool
    repeats: int


WORKLOADS = {
    "whole_50k_128": Workload(50_000, 128, False, 60),
    "train_30k_256": Workload(30_000, 256, True, 40),
}
TILE_PX = 16
"""Tiles of the torch loop, as in the common implementations of 3D Gaussian splatting."""


def _quats_towards(normals: Array, rng: np.random.Generator) -> Array:
    """Random rotations wxyz whose z axis is the given unit vector. [N, 3] -> [N, 4]."""
    half = np.stack([1.0 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(len(normals))], 1)
    half[normals[:, 2] < -0.999999] = (0.0, 1.0, 0.0, 0.0)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    angle = rng.uniform(0.0, np.pi, len(normals))
    c, s = np.cos(angle), np.sin(angle)
    w, x, y, z = half.T
    return np.stack([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s], 1)


def make_scene(splats: int, seed: int = 0) -> dict[str, Array]:
    """Splats of a table with three bodies, about 0.6 m across.

    Args:
        splats: Number of splats.
        seed: Seed of everything random.

    Returns:
        means [N, 3], quats [N, 4], scales [N, 3], opacities [N], colours [N, 3], float32, m.
    """
    rng = np.random.default_rng(seed)
    count = splats * 4 // 10
    each = (splats - count) // 3
    counts = [count, each, each, splats - count - 2 * each]
    plane = np.column_stack([rng.uniform(-0.3, 0.3, (counts[0], 2)), np.zeros(counts[0])])
    plane_normals = np.tile([0.0, 0.0, 1.0], (counts[0], 1))
    ball_normals = rng.normal(size=(counts[1], 3))
    ball_normals /= np.linalg.norm(ball_normals, axis=1, keepdims=True)
    ball = ball_normals * 0.08 + [-0.12, 0.1, 0.08]
    side, sign = rng.integers(0, 3, counts[2]), rng.choice([-1.0, 1.0], counts[2])
    box = rng.uniform(-1.0, 1.0, (counts[2], 3))
    box[np.arange(counts[2]), side] = sign
    box_normals = np.zeros_like(box)
    box_normals[np.arange(counts[2]), side] = sign
    box = box * [0.07, 0.06, 0.05] + [0.13, 0.08, 0.05]
    a, b = rng.uniform(0.0, 2.0 * np.pi, (2, counts[3]))
    ring_normals = np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], 1)
    ring = np.stack([0.09 * np.cos(a), 0.09 * np.sin(a), np.zeros_like(a)], 1) + 0.03 * ring_normals + [0.0, -0.13, 0.03]
    areas = [0.36, 4 * np.pi * 0.08**2, 8 * (0.07 * 0.06 + 0.07 * 0.05 + 0.06 * 0.05), 4 * np.pi**2 * 0.09 * 0.03]
    spacing = np.concatenate([np.full(n, np.sqrt(area / n)) for n, area in zip(counts, areas, strict=True)])
    normals = np.concatenate([plane_normals, ball_normals, box_normals, ring_normals])
    sigma = 0.8 * spacing[:, None] * np.exp(rng.normal(0.0, 0.4, (splats, 2)))
    scene = {
        "means": np.concatenate([plane, ball, box, ring]),
        "quats": _quats_towards(normals, rng),
        "scales": np.column_stack([sigma, 0.1 * sigma.mean(1)]),
        "opacities": rng.beta(2.5, 1.0, splats),
        "colours": rng.uniform(0.0, 1.0, (splats, 3)),
    }
    order = rng.permutation(splats)
    return {name: np.ascontiguousarray(array[order], dtype=np.float32) for name, array in scene.items()}


def make_view(size_px: int) -> tuple[Camera, Array]:
    """A square camera that sees the whole table."""
    focal = 1.05 * size_px
    return Camera(size_px, size_px, focal, focal, size_px / 2, size_px / 2), look_at((0.42, -0.34, 0.52), (0.0, 0.0, 0.0))


def cpu_times_ms(call: Callable[[], Any], repeats: int, synchronise: Callable[[], None] | None = None) -> dict[str, float]:
    """Minimum and median CPU time of a call (wall time where a device does the work), after two calls to warm up."""
    clock = time.perf_counter if synchronise else time.process_time
    times = []
    for k in range(repeats + 2):
        start = clock()
        call()
        if synchronise:
            synchronise()
        if k > 1:
            times.append((clock() - start) * 1e3)
    return {"min_ms": float(np.min(times)), "median_ms": float(np.median(times)), "repeats": repeats}


def measure(name: str, backend: str, compare: bool) -> dict[str, Any]:
    """Run one workload.

    Args:
        name: Key of `WORKLOADS`.
        backend: `cpu`, `cuda` or `reference` (the torch tile loop).
        compare: Time the torch tile loop in this process too.
    """
    import torch  # here, because libraries read the thread limits that `main` sets when they load

    from gsbridge.splats.rasterize import cpu, rasterize, reference

    work = WORKLOADS[name]
    scene = make_scene(work.splats)
    camera, pose = make_view(work.size_px)
    device = "cuda" if backend == "cuda" else "cpu"
    target = torch.rand(work.size_px, work.size_px, 3, generator=torch.Generator().manual_seed(0)).to(device)
    tensors = [torch.tensor(array, device=device, requires_grad=work.backward) for array in scene.values()]

    def step(draw: Callable[[], torch.Tensor]) -> None:
        for tensor in tensors:
            tensor.grad = None
        colours = draw()
        if work.backward:
            (colours * target).sum().backward()

    def tile_loop() -> torch.Tensor:
        return reference.rasterize(*tensors, camera, pose, None, 0.01, tile=TILE_PX)[0]

    def by_backend() -> torch.Tensor:
        if backend == "reference":
            return tile_loop()
        return rasterize(*tensors, camera=camera, cam_from_table=pose, backend=backend).colours

    if backend == "cpu" and not work.backward:
        figures = cpu_times_ms(lambda: cpu.render(*scene.values(), camera=camera, cam_from_table=pose), work.repeats)
    else:
        few = work.repeats if backend != "reference" else 3
        figures = cpu_times_ms(lambda: step(by_backend), few, torch.cuda.synchronize if backend == "cuda" else None)
    out: dict[str, Any] = {"splats": work.splats, "size_px": work.size_px, "backward": work.backward, **figures}
    if compare and backend == "cpu":
        loop = cpu_times_ms(lambda: step(tile_loop), 2)
        out["torch_tile_loop"] = loop
        out["speedup"] = loop["min_ms"] / figures["min_ms"]
    return out


def gradient_errors(backend: str) -> dict[str, float]:
    """Relative error of each parameter group's gradient against float64 autograd, worst of three small scenes."""
    import torch

    from gsbridge.splats.rasterize import rasterize

    camera, pose = Camera(72, 56, 80.0, 82.0, 35.3, 28.7), look_at((0.42, -0.34, 0.52), (0.0, 0.0, 0.03))
    device = "cuda" if backend == "cuda" else "cpu"
    worst = dict.fromkeys(("means", "quats", "scales", "opacities", "colours"), 0.0)
    for seed in range(3):
        scene = make_scene(400, seed)
        generator = torch.Generator().manual_seed(seed)
        weights = [
            torch.rand(shape, generator=generator, dtype=torch.float64) - 0.3 for shape in ((56, 72, 3), (56, 72), (56, 72))
        ]
        gradients = []
        for which, kind, place in (("reference", torch.float64, "cpu"), (backend, torch.float32, device)):
            tensors = [torch.tensor(array, dtype=kind, device=place, requires_grad=True) for array in scene.values()]
            got = rasterize(*tensors, camera=camera, cam_from_table=pose, backend=which)
            images = (got.colours, got.alphas, got.depths)
            loss = sum((image * weight.to(image)).sum() for image, weight in zip(images, weights, strict=True))
            loss.backward()
            gradients.append([tensor.grad.double().cpu() for tensor in tensors])
        for key, true, found in zip(worst, *gradients, strict=True):
            worst[key] = max(worst[key], float((true - found).norm() / true.norm()))
    return worst


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--backend", choices=("cpu", "cuda", "reference"), default="cpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--scene", choices=(*WORKLOADS, "all"), default="all")
    parser.add_argument(
        "--no-comparison", action="store_true", help="leave out the slow torch tile loop and the gradient check"
    )
    options = parser.parse_args()
    logs.start(options.threads, None)
    names = list(WORKLOADS) if options.scene == "all" else [options.scene]
    result: dict[str, Any] = {"backend": options.backend, "threads": options.threads, "scenes": {}}
    for name in names:
        result["scenes"][name] = measure(name, options.backend, not options.no_comparison and WORKLOADS[name].backward)
    if not options.no_comparison and options.backend != "reference":
        result["gradient_relative_error"] = gradient_errors(options.backend)
    if options.json:
        sys.stdout.write(json.dumps(result, indent=2) + "\n")
        return
    for name, figures in result["scenes"].items():
        sys.stdout.write(f"{name}: min {figures['min_ms']:.2f} ms, median {figures['median_ms']:.2f} ms")
        sys.stdout.write(f", {figures['speedup']:.0f}x faster than the torch tile loop\n" if "speedup" in figures else "\n")
    for key, error in result.get("gradient_relative_error", {}).items():
        sys.stdout.write(f"gradient of {key}: relative error {error:.1e}\n")


if __name__ == "__main__":
    main()
