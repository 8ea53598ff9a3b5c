"""From the files of a scene to an environment: kinds, plate, response, processes."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import yaml
from robot_fixture import robot
from sim_fixture import NOMINAL
from test_asset_relief import plate, table
from test_asset_stage import cloud_on, make_inputs, make_outputs

from gsbridge.asset.stage import AssetInputs, build_asset
from gsbridge.configuration.asset import AssetSettings
from gsbridge.environment.build import (
    StageFiles,
    build_controller,
    build_environment,
    build_renderer,
    build_world,
    camera_response,
    environment_makers,
    plate_of,
)
from gsbridge.environment.controllers import PlaceController
from gsbridge.environment.env import state_of
from gsbridge.environment.light import calibrate_light
from gsbridge.environment.robot_splats import robot_splats, write_robot_splats
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.views import draw_views
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.images import read_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.policy.deploy import simulated_arm
from gsbridge.scene.light import directions
from gsbridge.splats.ply import write_ply
from gsbridge.tasks.views import read_states

SETTINGS = EnvironmentSettings(image_size=64, renderer="mesh")


def closed(surface: Mesh) -> Mesh:
    """A height field as a solid: the surface and its image 30 mm under the table, joined at the border."""
    count = round(np.sqrt(len(surface.vertices)))
    index = np.arange(count * count).reshape(count, count)
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    following, below = np.roll(border, -1), len(surface.vertices)
    walls = np.concatenate([np.c_[border, following, border + below], np.c_[following, following + below, border + below]])
    under = surface.vertices * (1, 1, 0) - (0, 0, 0.03)
    faces = np.concatenate([surface.faces, surface.faces[:, ::-1] + below, walls])
    out = Mesh(np.concatenate([surface.vertices, under]), faces)
    return out if out.volume() > 0 else Mesh(out.vertices, faces[:, ::-1])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A box, a flat table and one with a plate, bundled."""
    folder = tmp_path_factory.mktemp("assets")
    made = {}
    for name, surface in (("flat", table(step=0.02)), ("plate", table(plate(0.0, 0.265, 0.08), step=0.01))):
        place = folder / name
        place.mkdir()
        painted = Mesh(surface.vertices, surface.faces, np.full(surface.vertices.shape, 0.6, np.float32))
        inputs = AssetInputs(*(place / file for file in ("visual.ply", "collision.ply", "splats.ply", "align.json")))
        write_mesh(inputs.visual, painted)
        write_mesh(inputs.collision, closed(surface))
        write_ply(inputs.splats, cloud_on(painted))
        write_json(inputs.align, {"scale": 1.0, "scale_source": "tags"})
        outputs = make_outputs(place / "asset")
        build_asset(inputs, outputs, name=name, kind="background")
        made[name] = outputs.record
    (folder / "box").mkdir()
    outputs = make_outputs(folder / "box" / "asset")
    build_asset(make_inputs(folder / "box"), outputs, AssetSettings(density=600), name="box")
    return StageFiles(robot().folder, outputs.record, made["flat"], NOMINAL), made["plate"]


def test_a_flat_background_has_no_plate_and_a_grasp_succeeds(files):
    stage, _ = files
    assert plate_of(stage.item, stage.background) is None
    environment, controller = build_environment(stage, SETTINGS), build_controller(stage.item, SETTINGS)
    _, info = environment.reset(seed=0, options={"pose": [0.03, 0.25, 0.2]})
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = environment.step(controller(state_of(info))[0])
        ended = terminated or truncated
    environment.close()
    assert info["success"], info["failure"]
    assert observation["image"].shape == (64, 64, 3)


def test_a_plate_is_a_body_and_a_place_to_put_things(files):
    stage, plated = files
    stage = replace(stage, background=plated)
    found = plate_of(stage.item, plated)
    assert (found.x, found.y) == pytest.approx((0.0, 0.265), abs=2e-3)
    assert found.height == pytest.approx(0.004, abs=1e-3)
    # Room for the plate and half the box's diagonal.
    assert found.keep_out == pytest.approx(0.08 + np.hypot(0.03, 0.025), abs=0.008)
    settings = EnvironmentSettings(task="pick_and_place", image_size=64, plate=found)
    assert isinstance(build_controller(stage.item, settings), PlaceController)
    with build_world(stage) as world:
        world.reset(np.array([0.0, 0.265, 0.0]), 0)
        for _ in range(10):
            world.step()
        state = world.state()
    # The box stands in the plate, neither in the table nor on the rim.
    assert state.object_clearance[0] == pytest.approx(0.004, abs=1e-3)
    assert state.tilt()[0] < 0.02


def test_assets_of_the_wrong_kind_are_refused(files):
    stage, _ = files
    with pytest.raises(InputError, match="of the kind background"):
        build_world(replace(stage, item=stage.background))
    with pytest.raises(InputError, match="of the kind object"):
        build_world(replace(stage, background=stage.item))
    with pytest.raises(InputError, match="robot splats"):
        build_renderer(stage, replace(SETTINGS, renderer="gs"))


def test_a_model_at_another_rate_than_policies_act_is_refused(files, tmp_path):
    """An action is a step of 24 mm however often it is taken, and a task counts steps, so that another rate is another task."""
    stage, _ = files
    values = yaml.safe_load(NOMINAL.read_text())
    values["timing"]["control_hz"] = 40
    (tmp_path / "fast.yaml").write_text(yaml.safe_dump(values))
    for build in (build_environment, simulated_arm):
        with pytest.raises(InputError, match=r"fast\.yaml: timing\.control_hz is 40.*20 times a second.*Set it to 20"):
            build(replace(stage, model=tmp_path / "fast.yaml"), SETTINGS)


def test_registration_and_photometry_are_used(files, tmp_path):
    stage, _ = files
    with build_world(stage) as world:
        nominal = world.base_from_table
    moved = nominal.copy()
    moved[:3, 3] += (0.01, -0.02, 0.0)
    write_json(tmp_path / "registration.json", {"base_from_table": moved, "flange_from_camera": np.eye(4), "reasons": []})
    with build_world(replace(stage, registration=tmp_path / "registration.json")) as world:
        np.testing.assert_allclose(world.base_from_table, moved)
    write_json(tmp_path / "registration.json", {"reasons": []})
    with pytest.raises(InputError, match="base_from_table"):
        build_world(replace(stage, registration=tmp_path / "registration.json"))
    response = {"gain": 0.5, "red_gain": 1.0, "blue_gain": 1.0, "gamma": 1.0, "black_level": 0.0}
    write_json(tmp_path / "photometry.json", {"response": response, "robot_colours": {"left_pad": [1.0, 0.0, 0.0]}})
    seen = replace(stage, photometry=tmp_path / "photometry.json")
    assert camera_response(stage).gain == 1.0
    assert camera_response(seen).gain == 0.5
    plain, coloured = (build_environment(given, SETTINGS) for given in (stage, seen))
    images = [environment.reset(seed=0, options={"pose": [0, 0.265, 0]})[0]["image"] for environment in (plain, coloured)]
    assert images[1].mean() < 0.9 * images[0].mean()


@pytest.mark.parametrize(
    "effect",
    [{"name": "exposure", "parameters": {"stops": -1.0}}, {"name": "distortion", "parameters": {"k1": 0.2, "k2": 0.0}}],
    ids=["light", "lens"],
)
def test_a_policy_sees_the_model_s_effects_where_it_runs_as_where_it_is_trained(files, tmp_path, effect):
    stage, _ = files
    (tmp_path / "amended.yaml").write_text(yaml.safe_dump({**yaml.safe_load(NOMINAL.read_text()), "effects": [effect]}))
    pose, pictures = np.array([0.0, 0.265, 0.3]), {}
    for name, given in (("nominal", stage), ("amended", replace(stage, model=tmp_path / "amended.yaml"))):
        environment, arm = build_environment(given, SETTINGS), simulated_arm(given, SETTINGS)
        arm.prepare(pose, 4)
        arm.rest()
        pictures[name] = arm.image()
        np.testing.assert_array_equal(pictures[name], environment.reset(seed=4, options={"pose": pose})[0]["image"])
        assert (arm.camera.width, arm.camera.height) == (64, 64)
        environment.close()
        arm.close()
    assert np.abs(pictures["amended"].astype(int) - pictures["nominal"]).mean() > 0.5


def test_makers_travel_to_other_processes(files):
    stage, _ = files
    makers = pickle.loads(pickle.dumps(list(environment_makers(stage, SETTINGS, 2))))
    assert len(makers) == 2
    environment = makers[0]()
    assert environment.reset(seed=1)[0]["image"].shape == (64, 64, 3)
    environment.close()


def test_views_are_drawn_by_all_renderers_at_the_same_states(files, tmp_path):
    stage, _ = files
    links = tmp_path / "links"
    from gsbridge.environment.robot_splats import robot_splats, write_robot_splats

    write_robot_splats(links, robot_splats(robot(), 900, fit_steps=0))
    given = replace(stage, robot_splats=links)
    draw_views(given, EnvironmentSettings(image_size=64), tmp_path / "out", tmp_path / "out.json", count=3)
    states, record = read_states(tmp_path / "out" / "states.json"), read_json(tmp_path / "out.json")
    assert (record["status"], record["views"], record["held"]) == ("pass", 3, 3)
    assert [state.start for state in states] == [0, 1, 2]
    # Later shares of a grasp are later steps, the last just when the box is held.
    assert states[0].step < states[2].step
    for index in range(3):
        pictures = [read_image(tmp_path / "out" / f"{index:02d}_{name}.png") for name in ("gs", "mesh", "mesh_vertex")]
        assert all(np.abs(picture - pictures[0]).mean() < 0.1 for picture in pictures)


def test_files_come_from_a_rules_inputs_by_name():
    needed = {"robot": "robot", "item": "cube.json", "background": "pad.json", "model": "nominal.yaml"}
    files = StageFiles.of({**needed, "registration": "registration.json", "kernels": "done"}, item_colour=(0.1, 0.2, 0.3))
    assert files == StageFiles(**needed, registration="registration.json", item_colour=(0.1, 0.2, 0.3))
    with pytest.raises(KeyError, match="model"):
        StageFiles.of({name: path for name, path in needed.items() if name != "model"})


def test_the_light_dims_splats_and_leaves_meshes(files, tmp_path):
    stage, _ = files
    write_robot_splats(tmp_path / "splats", robot_splats(robot(), 2000, fit_steps=0))
    calibrate_light(tmp_path / "dark.json", robot=robot().folder, shown=None)
    share = 1.0 / len(directions())
    light = {"floor": 0.0, "shares": [share] * len(directions())}
    write_json(tmp_path / "light.json", {**read_json(tmp_path / "dark.json"), "light": light})
    drawn = replace(stage, robot_splats=tmp_path / "splats")
    with build_world(stage) as world:
        world.reset(np.array([0.0, 0.265, 0.0]), 0)
        poses, camera = world.body_poses(), world.camera_pose()
    for name, dimmed in (("gs", True), ("mesh", False)):
        plain, lit, unlit = (
            build_renderer(replace(drawn, light=file), replace(SETTINGS, renderer=name)).render(poses, camera).mean()
            for file in (None, tmp_path / "light.json", tmp_path / "dark.json")
        )
        assert unlit == plain
        assert (lit < plain - 5) == dimmed
    named = {"robot": "r", "item": "i", "background": "b", "model": "m"}
    assert StageFiles.of({**named, "light": "light.json"}).light == "light.json"
    assert StageFiles.of(named).light is None
