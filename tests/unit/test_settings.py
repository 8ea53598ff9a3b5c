"""Values that settings accept, and the messages about values that they refuse."""

import copy
import json
import string
from pathlib import Path
from typing import get_args

import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gsbridge.asset.density import DENSITIES
from gsbridge.configuration.asset import Material
from gsbridge.configuration.base import Given, plain
from gsbridge.configuration.experiment import Task
from gsbridge.configuration.films import Film
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.configuration.pages import PAGE, SCHEMA, filled, json_schema, table
from gsbridge.configuration.policy import PolicySettings
from gsbridge.configuration.splats import SplatSettings
from gsbridge.configuration.whole import Configuration, Sections, read_configuration
from gsbridge.environment.settings import TASKS
from gsbridge.errors import InputError
from gsbridge.reality.mirror.film import DENSE
from gsbridge.reality.mirror.studio import SCENES

ROOT = Path(__file__).resolve().parents[2]
OWN = yaml.safe_load((ROOT / "config.yaml").read_text())
DEFAULTS = read_configuration({key: OWN[key] for key in ("preset", "seed", "scenes", "presets")})
SECTIONS = {name: type(getattr(Sections(), name)) for name in Sections.model_fields}


def as_text(value):
    """A value as `--config` gives it: snakemake reads blocks of keys, lists and text there, nothing else."""
    return yaml.load(yaml.safe_dump(value), Loader=yaml.BaseLoader)


def within(schema):
    """Values that a key's schema allows, where it is one number, switch or word; None for other keys."""
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if schema.get("type") == "boolean":
        return st.booleans()
    low, high = schema.get("minimum"), schema.get("maximum", 10**9)
    if schema.get("type") == "integer":
        step = schema.get("multipleOf", 1)
        return st.integers(-(-low // step), high // step).map(lambda number: number * step)
    if schema.get("type") == "number":
        above = schema.get("exclusiveMinimum")
        return st.floats(low if above is None else above, high, exclude_min=above is not None)
    return None


@st.composite
def sections(draw):
    """A section's name, with some of its keys and values within their ranges."""
    name = draw(st.sampled_from(sorted(SECTIONS)))
    properties = SECTIONS[name].model_json_schema()["properties"]
    possible = {key: values for key, schema in properties.items() if (values := within(schema)) is not None}
    # These bind others: critics take at least the actor's batch, and the temperature starts below its limit.
    chosen = draw(
        st.sets(st.sampled_from(sorted(possible.keys() - {"actor_batch", "critic_batch", "alpha_start", "alpha_cap"})))
    )
    return name, {key: draw(possible[key]) for key in sorted(chosen)}


@given(sections())
@settings(max_examples=200)
def test_what_is_within_its_range_comes_back_with_the_defaults_beside_it(section):
    name, values = section
    read = read_configuration({**OWN, name: values})
    assert read[name] == {**DEFAULTS[name], **values}
    assert read_configuration(read) == read


@given(sections())
@settings(max_examples=200)
def test_text_says_the_same_as_numbers_switches_and_null(section):
    name, values = section
    assert read_configuration({**OWN, name: as_text(values)}) == read_configuration({**OWN, name: values})


@given(sections())
@settings(max_examples=200)
def test_a_preset_says_only_what_it_was_given(section):
    name, values = section
    config = {**OWN, "presets": {**OWN["presets"], "toy": {"scenes": ["cake"], name: values}}}
    assert read_configuration(config)["presets"]["toy"] == {"scenes": ["cake"], name: values}


def test_the_whole_configuration_may_come_as_text():
    # YAML 1.1 keeps a list of three numbers a list, and null the text 'null'.
    assert read_configuration(as_text(OWN)) == read_configuration(OWN)


def test_the_call_of_the_docs_is_understood():
    config = {**OWN, "editing": as_text({"scene": "mug", "azimuth_deg": 90})}
    assert read_configuration(config)["editing"] == {"scene": "mug", "azimuth_deg": 90.0, "size": 400}


@pytest.mark.parametrize(
    ("section", "value", "said"),
    [
        ("editing", {"azimuth_deg": "abc"}, "editing.azimuth_deg: 'abc' is no number. Direction from which the object is seen"),
        ("editing", {"size": "400.5"}, "editing.size: '400.5' is no integer"),
        ("editing", {"size": True}, "editing.size: True is no integer"),
        ("editing", {"azimuth_deg": False}, "editing.azimuth_deg: False is no number"),
        ("editing", {"azimuth_deg": "nan"}, "editing.azimuth_deg: nan is no finite number"),
        ("comparison", {"hull": "perhaps"}, "comparison.hull: 'perhaps' is no boolean. Whether soft and GaMeS"),
        ("comparison", {"hull": 1}, "comparison.hull: 1 is no boolean"),
        ("grasp_policy", {"image_size": "100"}, "grasp_policy.image_size: '100' is not possible. Give one of: 64, 128"),
        ("grasp_policy", {"eval_poses": 30}, "grasp_policy.eval_poses: 30 is no multiple of 4. Start poses"),
        ("grasp_policy", {"critic_batch": 16}, "grasp_policy: critic_batch is 16. Give at least the actor's 128"),
        ("object_splats", {"offset_band": "scenes"}, "Did you mean 'scene'? Give one of: scene, or a number"),
        # A number of the command line, out of range: the word that may stand there, too, is no answer to it.
        ("object_splats", {"offset_band": "10"}, "offset_band: 10 is greater than the maximum of 1"),
        ("object_splats", {"offset_band": 2}, "object_splats.offset_band: 2 is greater than the maximum of 1. Largest offset"),
        ("object_splats", {"focus_centre": [0, 1, 2]}, "object_splats.focus_centre"),
        ("object_splats", {"focus_centre": ["a", 1]}, "object_splats.focus_centre.0: 'a' is no number. Middle of that square"),
        ("mesh", {"table_size": [0, 1]}, "mesh.table_size.0: 0 is not above 0. Largest width and depth"),
        ("align", {"require_scale": True}, "align: 'require_scale' is no key"),
        ("asset", {"density": 3}, "asset: 'density' is no key"),
        ("cells", {"task": "grasp"}, "cells: {'task': 'grasp'} is no list"),
        (
            "cells",
            [{"task": "grasp", "object": "cake"}],
            "cells.0: the key 'background' is missing. Add it: Scene of the table",
        ),
        ("trials", {"worlds": ["mirror", "mirror"]}, "trials.worlds: 'mirror' stands twice. Remove one"),
        ("study", {"variants": []}, "study.variants"),
        ("variants", {"bc": {}}, "config: variants: the key 'default' is missing. Add default: {}"),
        ("worlds", {"sim": {}}, "config: worlds.sim: 'sim' is a world already"),
        ("worlds", {"Mars": {}}, "config: worlds.Mars: the name becomes a folder"),
        ("workspace", {"source": {"mirror": False}}, "config: workspace.source.mirror: 'False' is not possible"),
        ("gap", {"benchmark": {"t0": 0}}, "gap.benchmark.t0: 0 is less than the minimum of 1"),
        ("gap", {"methods": ["gsbridg"]}, "gap.methods.0: 'gsbridg' is not possible. Did you mean 'gsbridge'"),
        ("presets", {"toy": {"scenes": ["cake"], "splats": {}}}, "config: presets.toy: 'splats' is no key"),
        (
            "presets",
            {"toy": {"scenes": ["cake"], "masks": {"pases": 2}}},
            "presets.toy.masks: 'pases' is no key. Did you mean 'pas",
        ),
        ("presets", {"toy": {"scenes": ["cake"], "gap": {"cases": {}}}}, "config: presets.toy.gap: 'cases' is no key"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_with_its_key(section, value, said):
    with pytest.raises(InputError) as raised:
        read_configuration({**OWN, section: value})
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_several_faults_are_counted():
    with pytest.raises(InputError, match=r"^config: 'spalts' is no key \(2 more faults\)\. Keys here: "):
        read_configuration({**OWN, "spalts": {}, "seed": "one", "mesh": {"density": 3}})


@given(st.sampled_from(sorted(SECTIONS)), st.text(string.ascii_lowercase + "_", min_size=1))
@settings(max_examples=200)
def test_an_unknown_key_is_refused_by_its_name(section, key):
    assume(key not in SECTIONS[section].model_fields)
    for place, config in (
        (section, {**OWN, section: {key: 1}}),
        (f"presets.toy.{section}", {**OWN, "presets": {"toy": {"scenes": ["cake"], section: {key: 1}}}}),
    ):
        with pytest.raises(InputError) as raised:
            read_configuration(config)
        assert str(raised.value).startswith(f"config: {place}: '{key}' is no key. ")


@given(st.data())
@settings(max_examples=200)
def test_a_misspelt_key_is_answered_with_the_one_that_was_meant(data):
    section = data.draw(st.sampled_from(sorted(SECTIONS)))
    key = data.draw(st.sampled_from([name for name in SECTIONS[section].model_fields if len(name) > 4]))
    place = data.draw(st.integers(0, len(key) - 1))
    slip = key[:place] + key[place + 1 :]
    assume(slip not in SECTIONS[section].model_fields)
    with pytest.raises(InputError, match=rf"'{slip}' is no key\. Did you mean '\w+'\? Keys here: .*\b{key}\b"):
        read_configuration({**OWN, section: {slip: 1}})


def test_every_key_says_what_it_means_and_no_block_takes_others():
    whole = Configuration.model_json_schema()
    for title, block in {**whole["$defs"], "Configuration": whole}.items():
        assert block["additionalProperties"] is False, title
        for name, content in block["properties"].items():
            assert content.get("description"), f"{title}.{name}"


def test_settings_are_checked_when_they_are_made_and_stay_as_they_are():
    with pytest.raises(InputError, match=r"^mask: backend: 'magic' is not possible\. Give one of: grabcut, sam2$"):
        MaskSettings(backend="magic")
    with pytest.raises(InputError, match=r"^policy: 'speed' is no key"):
        PolicySettings(speed=3)
    with pytest.raises(ValueError, match="frozen"):
        MaskSettings().passes = 2


def test_what_is_not_given_takes_its_default():
    assert set(DEFAULTS) == set(Configuration.model_fields)
    for name, section in SECTIONS.items():
        assert set(DEFAULTS[name]) >= set(section.model_fields)
        assert not issubclass(section, Given)
    assert DEFAULTS["dense_film"] == {"frames": 150, "spp": 4, "held_out_spp": 4, "width": 320, "height": 240, "sheet": "a4"}
    assert DEFAULTS["workspace"]["source"] == {"mirror": True}
    assert DEFAULTS["gap"]["benchmark"] == dict.fromkeys(("t0", "t1", "t2", "t4", "t5", "t7"))


def test_the_words_of_the_configuration_are_those_of_the_library():
    assert list(get_args(Film)) == list(SCENES)
    assert DENSE in SCENES
    assert list(get_args(Material)) == list(DENSITIES)
    assert get_args(Task) == TASKS


def test_a_copy_does_not_share_what_can_change():
    first, second = read_configuration(OWN), read_configuration(OWN)
    first["variants"]["default"]["policy"]["steps"] = 3
    first["worlds"]["mirror"]["hidden"]["tint"] = 1
    assert second == read_configuration(copy.deepcopy(OWN))


def test_the_schema_and_the_tables_of_the_docs_are_those_of_the_models():
    page = (ROOT / PAGE).read_text(encoding="utf-8")
    assert (ROOT / SCHEMA).read_text(encoding="utf-8") == json_schema(), "run make schema"
    assert page == filled(page), "run make schema"
    for name in Sections.model_fields:
        assert f"`{name}`" in page
    for model in (Configuration, *SECTIONS.values()):
        assert table(model) in page, model.__name__


def test_the_schema_for_editors_takes_the_projects_own_configuration():
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((ROOT / SCHEMA).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(OWN, schema)
    with pytest.raises(jsonschema.ValidationError, match="spalts"):
        jsonschema.validate({**OWN, "spalts": {}}, schema)


@pytest.mark.parametrize("made", [MeshSettings(table_size=(0.2, 0.3)), SplatSettings(offset_band="scene"), PolicySettings()])
def test_settings_in_a_record_make_the_same_settings(made):
    assert type(made)(**plain(made)) == made
