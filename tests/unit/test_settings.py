"""The configuration's schema and the library's settings describe the same keys with the same defaults."""

import dataclasses
from pathlib import Path

import jsonschema
import pytest
import yaml

from gsbridge.align.stage import AlignSettings
from gsbridge.asset.settings import AssetSettings
from gsbridge.capture.keyframes import KeyframeSettings
from gsbridge.masks.settings import MaskSettings
from gsbridge.mesh.settings import MeshSettings
from gsbridge.policy.settings import PolicySettings
from gsbridge.reality.mirror.film import FilmSettings
from gsbridge.reality.world.board_capture import BoardFilmSettings
from gsbridge.registration.settings import RegistrationSettings
from gsbridge.report.figures.editing import EditingSettings
from gsbridge.sfm.settings import SfmSettings
from gsbridge.splats.train import SplatSettings

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = yaml.safe_load((ROOT / "rules/schemas/config.schema.yaml").read_text())

# Set per scene, not per experiment; step sizes are no knobs of an experiment either.
ELSEWHERE = {AlignSettings: {"require_scale"}, AssetSettings: {"density"}, SplatSettings: {"rates"}}
SECTIONS = {
    "films": FilmSettings,
    "board_film": BoardFilmSettings,
    "registration": RegistrationSettings,
    "capture": KeyframeSettings,
    "sfm": SfmSettings,
    "align": AlignSettings,
    "masks": MaskSettings,
    "mesh": MeshSettings,
    "splats": SplatSettings,
    "asset": AssetSettings,
    "editing": EditingSettings,
    "policy": PolicySettings,
}


def plain(value):
    return list(value) if isinstance(value, tuple) else value


@pytest.mark.parametrize(("section", "settings"), SECTIONS.items())
def test_schema_and_dataclass_agree(section, settings):
    fields = {field.name: field for field in dataclasses.fields(settings) if field.name not in ELSEWHERE.get(settings, set())}
    properties = SCHEMA["$defs"][section]["properties"]
    assert set(properties) == set(fields)
    for name, content in properties.items():
        assert content["description"], f"{section}.{name} has no description"
        assert content["default"] == plain(fields[name].default), f"{section}.{name}"
        assert SCHEMA["$defs"][section]["additionalProperties"] is False


def test_a_presets_section_has_the_same_keys_and_no_defaults():
    for section in SECTIONS:
        override = SCHEMA["$defs"][f"{section}_override"]["properties"]
        assert set(override) == set(SCHEMA["$defs"][section]["properties"])
        assert all("default" not in content for content in override.values())


def test_the_projects_own_configuration_is_valid():
    jsonschema.validate(yaml.safe_load((ROOT / "config.yaml").read_text()), SCHEMA)
