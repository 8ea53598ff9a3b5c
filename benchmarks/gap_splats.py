"""Plant faults in the mirror's wrist camera and light, and diagnose its photos against splats of the same states.

    python benchmarks/gap_splats.py toy --worlds 0:201 1:202 2:203 --output splats.json

`toy` is a folder in which `make toy` ran, or any other preset, with `--object` and `--background`: its splats, robot,
registration and colours are what the simulation knows. Each world is a severity and a seed of the mirror (docs/mirror.md). In
each world, photos of 24 states from a day without a fault show the error of the splats; photos of 24 other states, without a
fault and with each fault of `gsbridge.gap.benchmark.mirror_photos.SIZES`, are diagnosed. Sizes, signs and places of faults come
from the world's seed. A diagnosis is right if it names what was planted and nothing else, or names nothing if nothing was
planted; it is wrong if it names anything else. Seeds of worlds from 1000 on are for scoring.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gsbridge import logs
from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.postures import draw_postures
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.files import write_json
from gsbridge.gap.benchmark.mirror_photos import SIZES, MirrorStudio, PlantedFault
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.image.diagnose import diagnose_splats
from gsbridge.gap.image.files import read_views
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.splat_error import learn_splat_error
from gsbridge.images import read_image
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.severity import Severity
from gsbridge.reality.world.world_variants import world_variant
from gsbridge.tasks.views import read_states

VIEWS = 24
"""Number of states on each of the two days."""

POSTURES = 411
"""Seed of the states, which are drawn once for all worlds."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the cases of all worlds, print a summary, and write the figures."""
    given = _arguments(arguments)
    logs.start(1, None)
    results = Path(given.folder) / "results"
    with TemporaryDirectory() as folder:
        views = Path(given.views or folder) / "views"
        if not (views / "states.json").is_file():
            draw(results, given, views, Path(folder) / "record.json")
        rows = [row for world in given.worlds for row in measure(world, given, results, views)]
    named = [row for row in rows if row["planted"]]
    summary = {
        "right": float(np.mean([row["right"] for row in rows])),
        "right_of_planted": float(np.mean([row["right"] for row in named])) if named else None,
        "wrong": float(np.mean([row["wrong"] for row in rows])),
        "cases": len(rows),
        "cpu_s_most": max(row["cpu_s"] for row in rows),
    }
    print(summary)
    write_json(given.output, {"summary": summary, "rows": rows})
    return 0


def draw(results: Path, given: argparse.Namespace, views: Path, record: Path) -> None:
    """Choose the states of both days, and render them with the splats of a finished run."""
    scenes = results / "scenes"
    item, background = (scenes / name / "asset" / "asset.json" for name in (given.object, given.background))
    files = StageFiles(
        robot=results / "robot" / "description",
        robot_splats=results / "robot" / "splats",
        registration=results / "workspace" / "registration.json",
        photometry=results / "workspace" / "photometry.json",
        light=results / "workspace" / "light.json",
        item=item,
        background=background,
        model=Path(__file__).parents[1] / "models" / "nominal.yaml",
    )
    settings = EnvironmentSettings(image_size=given.size, plate=plate_of(item, background))
    draw_postures(files, settings, views, record, count=2 * VIEWS, seed=POSTURES)


def measure(world: str, given: argparse.Namespace, results: Path, views: Path) -> list[dict[str, Any]]:
    """Diagnose all cases of one world."""
    severity, seed = (int(part) for part in world.split(":"))
    hidden = world_variant(given.seed, seed, severity=Severity.of(severity))
    camera, rows, depths = read_views(views)
    states = read_states(views / "states.json")
    drawn = np.stack([np.asarray(read_image(views / f"{row['name']}.png"), np.float32) for row in rows])
    poses = np.stack([row["cam_from_world"] for row in rows])
    middle = np.mean([_middle(pose) for pose in poses], axis=0)
    names = given.names if given.names is not None else ["", *SIZES]
    faults = [PlantedFault.draw("" if name == "none" else name, seed, middle) for name in names]
    # States come in groups of four, one for each moment of a grasp. The days take groups in turn, so both have all moments.
    early, late = ([n for n in range(2 * VIEWS) if n // 4 % 2 == day] for day in (0, 1))
    item = results / "scenes" / given.object / "asset" / "asset.json"
    setting = Setting(given.object, given.background, "a4", given.seed)
    studio = MirrorStudio.build(setting, hidden, given.size, item, results / ".state" / "pieces")

    def pairs(chosen: list[int], photos: np.ndarray, name: str) -> Pairs:
        taken = photos.astype(np.float32) / np.float32(255.0)
        return Pairs(camera, drawn[chosen], drawn[chosen], taken, depths[chosen], poses[chosen], name=name, drawn=True)

    nothing = PlantedFault.draw("", seed)
    error = learn_splat_error(pairs(early, studio.photos([states[n] for n in early], [nothing], 0)[0], "registration"))
    photos = studio.photos([states[n] for n in late], faults, len(early))
    if given.keep:
        np.savez_compressed(Path(given.keep) / f"{severity}-{seed}.npz", drawn=drawn[late], photos=photos, depths=depths[late])
    out = []
    for fault, taken in zip(faults, photos, strict=True):
        parts = {}
        for role in ROLES:
            chosen = [k for k, n in enumerate(late) if rows[n]["role"] == role]
            parts[role] = pairs([late[k] for k in chosen], taken[chosen], role)
        begin = time.process_time()
        diagnosis = diagnose_splats(parts, error, seed=seed)
        finding = diagnosis.finding
        found = list(finding.best.names) if finding.best is not None and finding.verdict == "named" else []
        wanted = [fault.name] if fault.name else []
        row = {
            "severity": severity, "seed": seed, "planted": fault.name, "size": fault.size, "verdict": finding.verdict,
            "named": found, "best": list(finding.best.names) if finding.best is not None else [],
            "ambiguous": list(finding.ambiguous), "right": found == wanted, "wrong": bool(found) and found != wanted,
            "p": finding.p_value, "before": finding.before, "after": finding.after, "left": list(error.left),
            "cpu_s": round(time.process_time() - begin, 1),
        }  # fmt: skip
        print(
            {
                key: row[key]
                for key in (
                    "severity",
                    "seed",
                    "planted",
                    "size",
                    "verdict",
                    "best",
                    "ambiguous",
                    "right",
                    "before",
                    "after",
                    "cpu_s",
                )
            },
            flush=True,
        )
        out.append(row)
    return out


def _middle(pose: np.ndarray) -> np.ndarray:
    """Point of the table plane at which the camera's axis points, m. [2]."""
    centre, axis = -pose[:3, :3].T @ pose[:3, 3], pose[2, :3]
    return np.asarray((centre - axis * centre[2] / min(axis[2], -1e-6))[:2])


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of a finished run, which holds results/")
    parser.add_argument("--worlds", nargs="+", required=True, metavar="SEVERITY:SEED")
    parser.add_argument("--object", default="small_cube")
    parser.add_argument("--background", default="foam_pad")
    parser.add_argument("--names", nargs="*", help="faults; 'none' for none of them (default: none and all)")
    parser.add_argument("--size", type=int, default=128, choices=(64, 128), help="edge of the photos, px")
    parser.add_argument("--seed", type=int, default=1, help="seed of the configuration that the folder was made with")
    parser.add_argument("--keep", help="folder that keeps drawn pictures and photos (.npz), to be looked at")
    parser.add_argument("--views", help="folder that keeps the drawn states for a later call with the same folder and size")
    parser.add_argument("--output", required=True, help="file of the figures, JSON")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
