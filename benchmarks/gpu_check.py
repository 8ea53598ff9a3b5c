"""Everything that needs a GPU, in one table and at most eight minutes: `make gpu-check`.

    python -m benchmarks.gpu_check --results toy/results
    python -m benchmarks.gpu_check --rehearse

It checks that gsplat agrees with the reference, forward and in gradients; the speed of training; one object with the budget of
the `paper` preset, on the photos of an earlier `make toy`; a policy's updates on the device; and COLMAP's dense stereo if
pycolmap has it. `--rehearse` does the same on the CPU with small numbers: it tests this program, not a GPU. The exit code is 0
if every line that was measured keeps its limit, and 1 otherwise or if there is no GPU.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from scipy.spatial import cKDTree

from benchmarks.rasterizer import gradient_errors, make_scene, make_view, measure
from gsbridge import logs
from gsbridge.errors import GsbridgeError, InputError

ROOT = Path(__file__).resolve().parents[1]
SCENE = "small_cube"
TOLERANCES = {
    # Limit of the mean over pixels. A splat whose alpha is rounded across the threshold of 1/255 changes single pixels by up to
    # that much; an error of the formula would change the mean.
    "forward": 1e-3,
    # The limit of gsbridge's own rasteriser against float64; gsplat also stops blending a pixel one splat earlier.
    "gradients": 2e-2,
    # Both sides compute in float32, but sum in different orders.
    "policy": 1e-3,
}
LEAST_PSNR_DB = 24.0
"""Smallest PSNR of held-out photos; below it the splats stage itself calls its result degraded."""
STEREO_MM = 3.0
"""Largest median distance of dense points from the mesh's nearest vertices, mm: half the vertices' spacing, and noise."""


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Args:
        name: What was checked.
        value: What was measured, in words, or why nothing was.
        limit: Limit of the value, in words; empty if there is none.
        kept: Whether the limit was kept; None if nothing was measured or there is no limit.
    """

    name: str
    value: str
    limit: str = ""
    kept: bool | None = None


@dataclass
class Check:
    """The checks of one device, and their results so far.

    Args:
        device: `cuda`, or `cpu` for a rehearsal.
        results: Folder `results/` of a finished toy run.
        lines: The table so far.
    """

    device: str
    results: Path
    lines: list[Line] = field(default_factory=list)

    @property
    def rehearsal(self) -> bool:
        """Whether this program is tested on the CPU, and no GPU is checked."""
        return self.device == "cpu"

    def run(self, name: str, part: Callable[[], list[Line]]) -> None:
        """Add the lines of one part, or one line that tells why it gave none."""
        try:
            self.lines += part()
        except GsbridgeError as error:
            self.lines.append(Line(name, f"not measured: {error}"))
        except Exception as error:
            # Anything may go wrong on a device on which this has never run; the other lines are still wanted.
            self.lines.append(Line(name, f"failed: {type(error).__name__}: {error}", "", False))

    def parity(self) -> list[Line]:
        """Compare pictures and gradients with the reference's."""
        from gsbridge.splats.rasterize import rasterize

        camera, pose = make_view(64)
        scene = make_scene(1500)
        # gsplat clips alpha at 0.999, the reference at 0.99.
        scene["opacities"] = np.minimum(scene["opacities"], 0.98).astype(np.float32)
        pictures = []
        for backend, place in (("reference", "cpu"), (self.device, self.device)):
            tensors = [torch.tensor(array, device=place) for array in scene.values()]
            got = rasterize(*tensors, camera=camera, cam_from_table=pose, backend=backend)
            pictures.append(torch.cat([got.colours, got.alphas[..., None]], 2).double().cpu())
        difference = (pictures[0] - pictures[1]).abs()
        mean, limit = float(difference.mean()), TOLERANCES["forward"]
        lines = [
            Line(
                "forward, mean difference",
                f"{mean:.1e} (largest {float(difference.max()):.1e})",
                f"<= {limit:g}",
                mean <= limit,
            )
        ]
        limit = TOLERANCES["gradients"]
        for name, error in gradient_errors(self.device).items():
            lines.append(Line(f"gradient of {name}", f"{error:.1e} relative", f"<= {limit:g}", error <= limit))
        return lines

    def speed(self) -> list[Line]:
        """Time a view of 30,000 splats with gradients, as a training computes it."""
        times = {name: measure("train_30k_256", name, False)["median_ms"] for name in dict.fromkeys(("cpu", self.device))}
        text = ", ".join(f"{name} {value:.1f} ms" for name, value in times.items())
        return [Line("training step, 30,000 splats, 256 px", text)]

    def paper_object(self) -> list[Line]:
        """Train an object with the budget of the `paper` preset, on the photos of an earlier run."""
        from gsbridge.cameras import read_views
        from gsbridge.configuration.splats import SplatSettings
        from gsbridge.configuration.whole import read_configuration
        from gsbridge.files import read_json
        from gsbridge.splats.stage import train_splats

        scene = self._scene()
        config = read_configuration(yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8")))
        values = {**config["object_splats"], **config["presets"]["paper"]["object_splats"], "backend": self.device}
        if self.rehearsal:
            values |= {"max_splats": 500, "steps": 20}
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as name:
            out = Path(name)
            train_splats(
                views=read_views(scene / "align" / "views.json", scene / "sfm" / "images"),
                masks_dir=scene / "masks" / "images",
                mesh_path=scene / "mesh" / "visual.ply",
                out_ply=out / "splats.ply",
                out_binding=out / "binding.npz",
                out_views=out / "views",
                out_json=out / "splats.json",
                settings=SplatSettings(**values),
                binding="soft",
                seed=1,
                threads=logs.threads(),
                state=out / "state",
                kind="object",
            )
            psnr = read_json(out / "splats.json")["metrics"]["held_out"]["masked"]["psnr"]
        seconds = time.monotonic() - begin
        kept = None if self.rehearsal else bool(psnr >= LEAST_PSNR_DB)
        text = f"{psnr:.1f} dB held out, {values['steps']} steps of {values['max_splats']} splats in {seconds:.0f} s"
        return [Line("object of the paper preset", text, f">= {LEAST_PSNR_DB:g} dB", kept)]

    def policy(self) -> list[Line]:
        """Compare the losses of a policy's updates with the CPU's, and time the updates."""
        from gsbridge.configuration.policy import PolicySettings
        from gsbridge.policy.agent import Agent

        size, count = 64, 32 if self.rehearsal else 256
        settings = PolicySettings(actor_batch=count, critic_batch=count, image_size=size, device=self.device)
        rng = np.random.default_rng(0)
        batch = _random_batch(count, size, rng)
        losses, rate = [], 0.0
        for device in ("cpu", self.device):
            agent = Agent(settings, 0, device)
            losses.append(agent.update(batch, 0.5))
            begin, steps = time.monotonic(), 2 if device == "cpu" else 50
            for _ in range(steps):
                agent.update(batch, 0.5)
            if device == "cuda":
                torch.cuda.synchronize()
            rate = steps / (time.monotonic() - begin)
        worst = max(abs(a - b) / max(abs(a), 1e-3) for a, b in zip(losses[0].values(), losses[1].values(), strict=True))
        limit = TOLERANCES["policy"]
        return [
            Line("policy, losses against the CPU's", f"{worst:.1e} relative", f"<= {limit:g}", worst <= limit),
            Line("policy, updates", f"{rate:.0f} per second in batches of {count}"),
        ]

    def dense_stereo(self) -> list[Line]:
        """Run COLMAP's dense stereo on the object's photos, and compare its points with the mesh."""
        from gsbridge.mesh.backends import has_pycolmap_stereo

        if not has_pycolmap_stereo():
            text = "not measured: this pycolmap was built without CUDA; install pycolmap-cuda12 in its place"
            return [Line("COLMAP's dense stereo", text)]
        from gsbridge.cameras import read_views
        from gsbridge.mesh.backends import external_points
        from gsbridge.mesh.hull import read_masks
        from gsbridge.meshes import read_mesh
        from gsbridge.photogrammetry.sparse import read_points

        scene = self._scene()
        views, mesh = (
            read_views(scene / "align" / "views.json", scene / "sfm" / "images"),
            read_mesh(scene / "mesh" / "visual.ply"),
        )
        sparse = read_points(scene / "align" / "points.npz").points
        near = ((sparse > mesh.vertices.min(0)) & (sparse < mesh.vertices.max(0))).all(axis=1)
        masks, begin = read_masks(views, scene / "masks" / "images"), time.monotonic()
        points, _ = external_points("pycolmap", views, masks, sparse[near], logs.threads())
        distances, _ = cKDTree(mesh.vertices).query(points)
        middle = 1e3 * float(np.median(distances))
        text = f"{len(points)} points, {middle:.1f} mm from the mesh of the sweep, in {time.monotonic() - begin:.0f} s"
        return [Line("COLMAP's dense stereo", text, f"<= {STEREO_MM:g} mm", middle <= STEREO_MM)]

    def _scene(self) -> Path:
        """Folder of the object's stages.

        Raises:
            InputError: No earlier run has finished the object's mesh.
        """
        scene = self.results / "scenes" / SCENE
        if not (scene / "mesh" / "mesh.json").is_file():
            raise InputError(scene, "there are no photos, masks and mesh to work on", "Run `make toy` first")
        return scene


def _random_batch(count: int, size_px: int, rng: np.random.Generator) -> Any:
    """A batch of random transitions, as a replay buffer would give it."""
    from gsbridge.policy.observation import POSITION, PRIVILEGED, PROPRIO
    from gsbridge.policy.replay import Batch
    from gsbridge.sim.actions import SIZE

    def numbers(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.uniform(-1.0, 1.0, (count, *shape)).astype(np.float32))

    pictures = [torch.from_numpy(rng.integers(0, 256, (count, size_px, size_px, 3), dtype=np.uint8)) for _ in range(2)]
    state = [numbers(width) for width in (PROPRIO, PROPRIO, PRIVILEGED, PRIVILEGED, SIZE, SIZE, POSITION, SIZE)]
    return Batch(*pictures, *state, reward=numbers().abs(), terminated=(numbers() > 0.8).float())


def main(arguments: list[str] | None = None) -> int:
    """Read the options, measure, print the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, default=ROOT / "toy" / "results", help="results of a finished `make toy`")
    parser.add_argument("--rehearse", action="store_true", help="the same on the CPU, to test this program")
    options = parser.parse_args(arguments)
    logs.start(4, None)
    if not options.rehearse and not torch.cuda.is_available():
        built = "this build of torch has no CUDA" if torch.version.cuda is None else "no CUDA device answers"
        sys.stdout.write(f"gpu-check: {built}, so nothing was checked. With a GPU, in a fresh clone: make setup TORCH_INDEX=\n")
        return 1
    check = Check("cpu" if options.rehearse else "cuda", options.results)
    for name in ("parity", "speed", "policy", "paper_object", "dense_stereo"):
        check.run(name, getattr(check, name))
    wide = max(len(line.name) for line in check.lines)
    for line in check.lines:
        verdict = {True: "ok", False: "FAILED", None: ""}[line.kept]
        sys.stdout.write(f"{line.name:{wide}}  {verdict:6}  {line.value}{f'   asked: {line.limit}' if line.limit else ''}\n")
    return int(any(line.kept is False for line in check.lines))


if __name__ == "__main__":
    sys.exit(main())
