"""What the schema lets pass and would fail hours later is refused at once."""

import copy
from pathlib import Path

import pytest
import yaml

from gsbridge.configuration import check_configuration, check_duplicates
from gsbridge.errors import InputError
from gsbridge.reality.mirror.film import DENSE
from gsbridge.reality.mirror.studio import SCENES

ROOT = Path(__file__).resolve().parents[2]

SCENE = {
    "kind": "object",
    "source": {"film": "cake"},
    "camera": "phone",
    "board": "a4",
    "require_scale": True,
    "known_length": None,
}
CONFIG = {
    "preset": "toy",
    "presets": {"toy": {"scenes": ["cake"]}},
    "cameras": {"phone": {"calibrate_from": ["cake"], "board": "a4"}},
    "scenes": {"cake": SCENE},
    "masks": {"backend": "grabcut", "sam2_weights": None},
    "object_splats": {"lpips_weights": None},
    "background_splats": {"lpips_weights": None},
}
FOAM_PAD = {**SCENE, "kind": "background", "source": {"film": "foam_pad"}}
BETWEEN = [["0001.png", 10, 20], ["0001.png", 30, 40]]


def test_a_consistent_configuration_passes():
    check_configuration(CONFIG)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("preset",), "big", "big"),
        (("presets", "toy", "scenes"), ["mug"], "mug"),
        (("scenes", "cake", "camera"), "tablet", "tablet"),
        (("cameras", "phone", "calibrate_from"), ["mug"], "mug"),
        (("scenes", "cake", "board"), None, "require_scale"),
        (("scenes", "cake", "board"), "letter", "letter"),
        (("scenes", "cake", "known_length"), {"metres": 0.2}, "between"),
        (("scenes", "cake", "known_length"), {"metres": 0.2, "object": "longest", "between": BETWEEN}, "once"),
        (("scenes", "foam_pad"), {**FOAM_PAD, "known_length": {"metres": 0.2, "object": "longest"}}, "background"),
        (("scenes", "mug"), SCENE, "scenes.mug.source.film: the film 'cake'"),
        (("masks", "backend"), "sam2", "masks.sam2_weights"),
        (("masks",), {"backend": "sam2", "sam2_weights": "nowhere"}, "nowhere"),
        (("presets", "toy", "masks"), {"backend": "sam2"}, "masks.sam2_weights"),
        (("background_splats", "lpips_weights"), "nowhere.pth", "background_splats.lpips_weights: the file nowhere.pth"),
    ],
)
def test_a_setting_that_cannot_work_is_named(path, value, named):
    config = copy.deepcopy(CONFIG)
    target = config
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = value
    with pytest.raises(InputError, match=named):
        check_configuration(config)


@pytest.mark.parametrize("length", [{"metres": 0.2, "object": "longest"}, {"metres": 0.2, "between": BETWEEN}])
def test_a_complete_known_length_passes(length):
    check_configuration({**CONFIG, "scenes": {"cake": {**SCENE, "known_length": length}}})


def test_weights_that_are_there_pass(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "lpips.pth").touch()
    check_configuration(
        {
            **CONFIG,
            "masks": {"backend": "sam2", "sam2_weights": str(tmp_path)},
            "object_splats": {"lpips_weights": str(tmp_path / "lpips.pth")},
        }
    )


def test_the_schema_lists_the_films_of_the_studio():
    schema = yaml.safe_load((ROOT / "rules/schemas/config.schema.yaml").read_text())
    source = schema["properties"]["scenes"]["additionalProperties"]["properties"]["source"]
    assert source["properties"]["film"]["enum"] == list(SCENES)
    assert DENSE in SCENES


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenes:\n  cake: {}\nseed: 1\nscenes:\n  mug: {}\n", ["'scenes'", "lines 1 and 4"]),
        ("scenes:\n  mug: {kind: object,\n    kind: background}\n", ["'scenes.mug.kind'", "lines 2 and 3"]),
    ],
)
def test_a_key_that_stands_twice_is_named(tmp_path, text, words):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        check_duplicates([path])
    for word in ["config.yaml", *words]:
        assert word in str(caught.value)


def test_configurations_without_duplicates_pass(tmp_path):
    (tmp_path / "config.json").write_text('{\n\t"seed": 1\n}')
    (tmp_path / "empty.yaml").touch()
    check_duplicates([ROOT / "config.yaml", tmp_path / "config.json", tmp_path / "empty.yaml"])


def described(schema):
    """Names of all keys of a schema, with those of the sections it refers to; a preset's overrides repeat them."""
    for name, content in schema.get("properties", {}).items():
        yield name, content
        yield from described(content)
    for part in [schema.get("additionalProperties"), *schema.get("anyOf", [])]:
        if isinstance(part, dict):
            yield from described(part)


def test_the_reference_page_names_every_key_with_its_default():
    schema = yaml.safe_load((ROOT / "rules/schemas/config.schema.yaml").read_text())
    page = (ROOT / "docs/configuration.md").read_text()
    keys = [("", *pair) for pair in described(schema)]
    keys += [(n, *pair) for n, part in schema["$defs"].items() if not n.endswith("_override") for pair in described(part)]
    for section, name, content in keys:
        row = [line for line in page.splitlines() if line.startswith("|") and f"`{name}`" in line.split("|")[1]]
        assert row, f"docs/configuration.md does not name {section} {name}"
        default = content.get("default")
        if section and isinstance(default, int | float) and not isinstance(default, bool):
            assert any(f"| {default} |" in line for line in row), f"docs/configuration.md: default of {section}.{name}"
