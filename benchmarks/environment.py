"""Measure the environment: steps per second with Gaussian rendering, and where the time goes.

    python benchmarks/environment.py --json
    python benchmarks/environment.py --skip-mirror
    python benchmarks/environment.py --item cake/asset.json --background plate/asset.json --robot-splats DIR --light FILE

Without assets the scene is synthetic, with as many splats as the desktop budget allows: 12,000 for a cube of 58 mm, 24,000 for
a table of 1 m, 8,000 for the robot. They are not fitted, which does not change the cost. The shadows are those of an evenly
bright sky, which costs more to sum than a lamp. The actions are the baseline controller's, so that the hand comes near the
object and grips it, which is the costly part. Episodes begin at poses of the set `fixed`.

A step is measured in CPU time of this process, which leaves out the waiting for other jobs; wall time is given beside it. Other
jobs still share caches and slow the clock, which can only add time. So of eight rounds, about half a second each, the fastest
counts; the median and the slowest are given, too.

`mirror_64` is the wrist camera of the mirror, which stands in for reality: small_cube on the foam pad under the robot, the arm
swaying, with the samples of the default quality. `mirror_64_severity_2` is the same in an ordinary lab, with motion blur and
highlights.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gsbridge import logs
from gsbridge.files import write_json
from gsbridge.geometry import Array

ROOT = Path(__file__).resolve().parents[1]
EDGE = 0.058
MASS = 0.117
OBJECT_SPLATS, BACKGROUND_SPLATS, ROBOT_SPLATS = 12_000, 24_000, 8_000
SIZES_PX = (128, 64)
EPISODES, ROUNDS = 4, 8
MIRROR_SIZE_PX, MIRROR_PICTURES, MIRROR_SEED = 64, 24, 1
WARMING = 3


class Stopwatch:
    """Adds up the CPU time of one method of one object while `run` is set."""

    def __init__(self, owner: Any, name: str) -> None:
        self.seconds, self.run = 0.0, False
        self._call = getattr(owner, name)
        setattr(owner, name, self._timed)

    def _timed(self, *args: Any, **options: Any) -> Any:
        if not self.run:
            return self._call(*args, **options)
        start = time.process_time()
        try:
            return self._call(*args, **options)
        finally:
            self.seconds += time.process_time() - start


def synthetic_item(folder: Path) -> Any:
    """A cube as the asset stage writes it, with URDF and width; Bullet's margin fills its inset hull up to the cube."""
    from gsbridge.asset.body import mass_properties
    from gsbridge.asset.bullet import COLLISION_MARGIN
    from gsbridge.asset.hulls import hull_mesh, inset
    from gsbridge.asset.urdf import write_body_urdf, write_obj
    from gsbridge.sim.engine import Item

    points = np.array([(x, y, z) for x in (-EDGE / 2, EDGE / 2) for y in (-EDGE / 2, EDGE / 2) for z in (0, EDGE)])
    cube = hull_mesh(points)
    write_obj(folder / "cube.obj", cube)
    write_obj(folder / "cube_bullet.obj", hull_mesh(inset(points, COLLISION_MARGIN)[0]))
    properties = mass_properties(cube, MASS / EDGE**3)
    path = folder / "cube.urdf"
    write_body_urdf(path, "cube", properties, visual="cube.obj", collisions=["cube_bullet.obj"])
    return Item(path, points, EDGE)


def sheet(count: int, width: float, depth: float) -> tuple[Array, float]:
    """About `count` points in a grid over a rectangle around the origin, m, [N, 3], and their spacing, m."""
    spacing = np.sqrt(width * depth / count)
    across, along = max(1, round(width / spacing)), max(1, round(depth / spacing))
    x, y = np.meshgrid((np.arange(across) + 0.5) / across - 0.5, (np.arange(along) + 0.5) / along - 0.5)
    return np.stack([width * x.ravel(), depth * y.ravel(), np.zeros(x.size)], axis=1), spacing


def discs(points: Array, normal_axis: int, spacing: float) -> Any:
    """Flat splats in a chequered colour, 0.8 of their spacing wide: as dense as trained ones."""
    from gsbridge.splats.cloud import Cloud

    count = len(points)
    scales = np.full((count, 3), 0.8 * spacing)
    scales[:, normal_axis] = 1e-5
    return Cloud(points, np.tile([1.0, 0, 0, 0], (count, 1)), scales, np.full(count, 0.9), 0.5 + 0.4 * np.sin(40.0 * points))


def synthetic_clouds() -> tuple[Any, Any, Any]:
    """Splats of the cube and of the table, and the table's mesh."""
    from gsbridge.meshes import Mesh
    from gsbridge.splats.cloud import concatenate

    face, spacing = sheet(OBJECT_SPLATS // 6, EDGE, EDGE)
    sides = []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            # The sheet's third coordinate goes to the face's normal.
            points = np.roll(face + np.array([0, 0, sign * EDGE]), axis - 2, axis=1)
            sides.append(discs(points + np.array([0, 0, EDGE / 2]), axis, spacing))
    ground, spacing = sheet(BACKGROUND_SPLATS, 1.0, 1.0)
    corners = np.array([[-0.5, -0.25, 0], [0.5, -0.25, 0], [0.5, 0.75, 0], [-0.5, 0.75, 0]])
    table = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    return concatenate(sides), discs(ground + np.array([0, 0.25, 0]), 2, spacing), table


def shade(robot: Any, item: Any, options: argparse.Namespace, asset: Any) -> Any:
    """Shadows in the calibrated light (None if there is none), or under an even sky."""
    from scipy.spatial import ConvexHull

    from gsbridge.environment.gaussian_renderer import OBJECT
    from gsbridge.environment.light import OBJECT_SPHERES, PART_SPHERES, LightFile
    from gsbridge.meshes import Mesh
    from gsbridge.scene.light import SkyLight, directions
    from gsbridge.scene.occlusion import spheres_in
    from gsbridge.scene.shadows import Shadows

    if options.light:
        return LightFile.read(options.light).shadows(OBJECT, asset)
    spheres = {name: np.concatenate([spheres_in(m, PART_SPHERES) for m, _ in parts]) for name, parts in robot.visuals().items()}
    body = Mesh(item.points, ConvexHull(item.points).simplices)
    count = len(directions())
    return Shadows(SkyLight(0.1, np.full(count, 0.9 / count)), spheres, (OBJECT, spheres_in(body, OBJECT_SPHERES)))


def one_round(env: Any, controller: Any, clocks: Mapping[str, Stopwatch], episodes: int) -> dict[str, Any]:
    """Run some episodes in one environment, and return their figures."""
    from gsbridge.environment.env import state_of

    for clock in clocks.values():
        clock.seconds = 0.0
    wall, coverage, successes = 0.0, [], 0
    for episode in range(episodes):
        _, info = env.reset(seed=episode, options={"pose_set": "fixed", "index": (32 * episode) // episodes})
        ended = False
        while not ended:
            action = controller(state_of(info))[0]
            for clock in clocks.values():
                clock.run = True
            begin = time.perf_counter()
            *_, terminated, truncated, info = env.step(action)
            wall += time.perf_counter() - begin
            for clock in clocks.values():
                clock.run = False
            coverage.append(env.eye.renderer.coverage(env.world.body_poses(), env.world.camera_pose()))
            ended = terminated or truncated
        successes += info["success"]
    count = len(coverage)
    seconds = {name: clock.seconds for name, clock in clocks.items()}
    whole = seconds.pop("step")
    # `render` calls `see`; the figures show the two apart.
    seconds["render"] -= seconds["see"]
    return {
        "steps_per_second": count / whole,
        "wall_steps_per_second": count / wall,
        "steps": count,
        "successes": successes,
        "episodes": episodes,
        "step_ms": 1e3 * whole / count,
        **{f"{name}_ms": 1e3 * value / count for name, value in seconds.items()},
        "other_ms": 1e3 * (whole - sum(seconds.values())) / count,
        "coverage_min": float(np.min(coverage)),
        "coverage_mean": float(np.mean(coverage)),
    }


def measure(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Measure the environment, and return all figures by image size."""
    # Imported here, because libraries read the thread limits when they load, and `main` sets these first.
    from gsbridge.asset.bundle import read_asset
    from gsbridge.environment.controllers import GraspController, grip_of
    from gsbridge.environment.env import PickEnvironment
    from gsbridge.environment.gaussian_renderer import GaussianRenderer
    from gsbridge.environment.rendering import wrist_camera
    from gsbridge.environment.robot_splats import read_robot_splats, robot_splats
    from gsbridge.environment.settings import EnvironmentSettings
    from gsbridge.robot.assembly import build_robot
    from gsbridge.sim.engine import Item
    from gsbridge.sim.model import read_model
    from gsbridge.sim.world import SimWorld

    robot = build_robot(folder / "robot")
    model = read_model(ROOT / "models" / "nominal.yaml")
    links = read_robot_splats(options.robot_splats) if options.robot_splats else robot_splats(robot, ROBOT_SPLATS, fit_steps=0)
    if options.item and options.background:
        asset, ground = read_asset(options.item), read_asset(options.background)
        item, grip_centre = Item.of(asset), asset.properties.centre if asset.properties else None
        cube, table, surface = asset.cloud(), ground.cloud(), ground.mesh()
    else:
        item, grip_centre = synthetic_item(folder), None
        cube, table, surface = synthetic_clouds()
    shadows = shade(robot, item, options, asset if options.item and options.background else None)
    world = SimWorld(robot, item, model)
    controller = GraspController(grip_of(item.points, grip_centre), stroke=robot.dimensions.stroke)
    out: dict[str, Any] = {"splats": {"object": len(cube), "background": len(table), "robot": sum(map(len, links.values()))}}
    clocks = {"sim_step": Stopwatch(world, "step"), "command": Stopwatch(world, "command")}
    for size in SIZES_PX:
        renderer = GaussianRenderer(cube, table, links, wrist_camera(size), surface=surface, shadows=shadows)
        env = PickEnvironment(world, EnvironmentSettings(image_size=size), renderer, response=model.camera)
        env.reset(seed=0, options={"pose_set": "fixed", "index": 0})
        env.step(np.zeros(5))  # compiles what is not compiled yet
        clocks["see"], clocks["render"] = Stopwatch(renderer, "see"), Stopwatch(renderer, "render")
        clocks["step"] = Stopwatch(env, "step")
        rounds = [one_round(env, controller, clocks, options.episodes) for _ in range(ROUNDS)]
        rounds.sort(key=lambda figures: figures["step_ms"])
        times = [figures["step_ms"] for figures in rounds]
        spread = {"rounds": ROUNDS, "median_round_ms": float(np.median(times)), "slowest_round_ms": times[-1]}
        out[f"gs_{size}"] = {**rounds[0], **spread}
    return out


def measure_mirror(folder: Path, severity: int) -> dict[str, Any]:
    """CPU time of the mirror's pictures, s, in a world of the given severity, on one thread, while the arm sways."""
    from gsbridge.reality.mirror.path_tracer import variant
    from gsbridge.reality.world.camera import Setting
    from gsbridge.reality.world.hidden import Hidden
    from gsbridge.reality.world.mirror import TRIAL, mirror_world
    from gsbridge.reality.world.severity import Severity, worsened

    hidden = worsened(Hidden.draw(MIRROR_SEED), MIRROR_SEED, Severity.of(severity))
    world = mirror_world(Setting("small_cube", "foam_pad"), hidden, pieces=folder / "pieces")
    world.reset(np.array([0.02, 0.26, 0.3]), 0)
    begin, times = world.state().tool_position[0].copy(), []
    for number in range(MIRROR_PICTURES + WARMING):
        sway = 0.03 * np.array([np.sin(0.7 * number), np.cos(0.7 * number), 0.0])
        world.command(begin + sway, 0.1 * np.sin(0.7 * number), 0.08)
        world.step()
        start = time.process_time()
        world.image(MIRROR_SIZE_PX)
        times.append(time.process_time() - start)
    # The first pictures take longer: sensors are made and kernels compiled.
    settled = np.array(times[WARMING:])
    return {
        "seconds_min": float(settled.min()),
        "seconds_median": float(np.median(settled)),
        "first_seconds": times[0],
        "pictures": len(settled),
        "samples": TRIAL.samples,
        "path_tracer": variant(),
    }


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--output", type=Path, help="file for the JSON object: PyBullet prints on what else is shown")
    parser.add_argument("--skip-mirror", action="store_true", help="leave the mirror's pictures out")
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--item", type=Path, help="asset.json of an object; needs --background")
    parser.add_argument("--background", type=Path, help="asset.json of a background; needs --item")
    parser.add_argument("--light", type=Path, help="light.json; an even sky without it")
    parser.add_argument("--robot-splats", type=Path, help="folder of the robot's splats")
    options = parser.parse_args()
    if (options.item is None) != (options.background is None):
        parser.error("--item and --background go together")
    if options.light and options.item is None:
        parser.error("--light goes with --item")
    if not 1 <= options.episodes <= 32:
        parser.error("--episodes: 1 to 32")
    logs.start(1, None)
    with TemporaryDirectory() as folder:
        result = measure(options, Path(folder))
        if not options.skip_mirror:
            result[f"mirror_{MIRROR_SIZE_PX}"] = measure_mirror(Path(folder), 0)
            result[f"mirror_{MIRROR_SIZE_PX}_severity_2"] = measure_mirror(Path(folder), 2)
    if options.output:
        write_json(options.output, result)
        return
    if options.json:
        sys.stdout.write(json.dumps(result, indent=2) + "\n")
        return
    for name, figures in result.items():
        told = [f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in figures.items()]
        sys.stdout.write(f"{name}: {', '.join(told)}\n")


if __name__ == "__main__":
    main()
