"""What an effect is, its lists, and the one check of a model's effects."""

import importlib
import inspect
from pathlib import Path

import pytest

from gsbridge import digests
from gsbridge.effects.base import Effect
from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import HOOKS
from gsbridge.effects.registry import Applied, Registry, effect_of, read_effects, read_names
from gsbridge.errors import InputError

REGISTRIES = {"joints": JOINT_EFFECTS, "bodies": BODY_EFFECTS, "images": IMAGE_EFFECTS}
ALL = [(place, name) for place, registry in REGISTRIES.items() for name in registry]
FOLDER = Path(digests.PACKAGE) / "effects"


@pytest.mark.parametrize("place", REGISTRIES)
def test_every_effect_in_a_folder_is_in_its_list(place):
    found = set()
    for path in (FOLDER / place).glob("*.py"):
        module = importlib.import_module(f"gsbridge.effects.{place}.{path.stem}")
        kinds = (kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == module.__name__)
        found |= {kind for kind in kinds if issubclass(kind, Effect) and not inspect.isabstract(kind) and hasattr(kind, "name")}
    assert found == {type(effect) for effect in REGISTRIES[place].values()}


@pytest.mark.parametrize(("place", "name"), ALL)
def test_imports_show_every_effect_and_its_file_is_named_like_it(place, name):
    """Digests follow static imports: who imports the list is rerun when any effect in it changes."""
    assert type(REGISTRIES[place][name]).__module__ == f"gsbridge.effects.{place}.{name}"
    assert f"gsbridge.effects.{place}.{name}" in digests.import_closure([f"gsbridge.effects.{place}"])


@pytest.mark.parametrize(("place", "name"), ALL)
def test_every_effect_says_what_it_is(place, name):
    effect, registry = REGISTRIES[place][name], REGISTRIES[place]
    assert effect.name == name
    assert set(effect.contains) | set(effect.confused_with) <= set(registry) - {name}
    assert effect.title
    assert effect.signature
    assert effect.tell_apart
    assert any(p.amplitude for p in effect.parameters)
    assert effect.scope in {"joints": ("joint", "mechanism"), "bodies": ("body",), "images": ("camera",)}[place]
    assert place != "joints" or effect.hook in HOOKS
    for values in effect.directions():
        assert effect.scaled(values, 1.0) == values
    # What cannot be amended says why, and what to do.
    assert effect.amendable == (not effect.reason) == (not effect.instead)
    assert not f"{effect.reason} {effect.instead}".endswith(".")
    assert (effect.advice or "").endswith(f"{effect.instead}." if effect.reason else "")


def test_the_page_lists_what_the_simulation_cannot_play():
    page = (Path(digests.PACKAGE).parent / "docs" / "gap.md").read_text(encoding="utf-8")
    table = page.split("### What the simulation's model can hold")[1].split("## Verdicts")[0]
    rows = [tuple(cell.strip() for cell in line.split("|")[1:4]) for line in table.splitlines() if line.startswith("| `")]
    assert rows == [(f"`{name}`", one.reason, one.instead) for name, one in JOINT_EFFECTS.items() if not one.amendable]


def test_the_page_lists_all_effects_of_joints():
    page = (Path(digests.PACKAGE).parent / "docs" / "gap.md").read_text(encoding="utf-8")
    table = page.split("## Effects")[1].split("### What the simulation's model can hold")[0]
    rows = [tuple(cell.strip() for cell in line.split("|")[1:5]) for line in table.splitlines() if line.startswith("| `")]
    assert rows == [
        (
            f"`{name}`",
            one.title,
            ", ".join(f"`{part.name}`" + (f" ({part.unit})" if part.unit not in ("", "1") else "") for part in one.parameters),
            one.signature,
        )
        for name, one in JOINT_EFFECTS.items()
    ]


class Haze(ImageEffect):
    """White light that is added."""

    name = "haze"
    parameters = (Parameter("light", "1", 0.0, 0.5, 0.02, True, "white light that is added"),)

    def apply(self, shooting, values):
        """Not needed here."""


def test_a_registry_is_a_sorted_mapping_with_a_clear_error():
    registry = Registry(*(type(effect) for effect in IMAGE_EFFECTS.values()), Haze)
    assert list(registry) == sorted([*IMAGE_EFFECTS, "haze"])
    assert registry.effect("haze").directions() == ({"light": 0.02},)
    with pytest.raises(InputError, match=r"'fog' is unknown\. Use one of: .*haze"):
        registry.effect("fog", "m.yaml")
    with pytest.raises(ValueError, match="one name"):
        Registry(Haze, Haze)


def test_a_list_of_effects_is_read():
    items = [
        {"name": "coulomb", "joint": "elbow", "parameters": {"torque": 2}},
        {"name": "saturation", "joint": "elbow", "parameters": {"weakness": 0.1}},
        {"name": "saturation", "parameters": {"change": 0.1}},
    ]
    found = read_effects(items, "m.yaml", JOINT_EFFECTS, IMAGE_EFFECTS, joints=["elbow"])
    assert [effect.record() for effect in found] == items
    # One name, two effects: only one of them acts on a joint.
    assert effect_of(found[1], JOINT_EFFECTS, IMAGE_EFFECTS) is JOINT_EFFECTS["saturation"]
    assert effect_of(found[2], JOINT_EFFECTS, IMAGE_EFFECTS) is IMAGE_EFFECTS["saturation"]


@pytest.mark.parametrize(
    ("items", "said"),
    [
        (None, "is no list"),
        ({"name": "coulomb"}, "is no list"),
        (["coulomb"], "no {name, parameters}"),
        ([{"name": "coulomb"}], "no {name, parameters}"),
        ([{"name": "coulomb", "parameters": 1}], "no {name, parameters}"),
        ([{"name": "coulomb", "parameters": {}, "link": 1}], "no {name, parameters}"),
        ([{"name": "glue", "parameters": {}}], "'glue' is unknown"),
        ([{"name": "coulomb", "joint": "elbow", "parameters": {}}], "torque is unknown or missing"),
        ([{"name": "coulomb", "joint": "elbow", "parameters": {"torque": 1, "x": 1}}], "x is unknown or missing"),
        ([{"name": "coulomb", "joint": "elbow", "parameters": {"torque": 99}}], "effects.coulomb.torque' is 99, outside"),
        ([{"name": "coulomb", "joint": "elbow", "parameters": {"torque": "much"}}], "'much', no number"),
        ([{"name": "coulomb", "joint": "elbow", "parameters": {"torque": True}}], "no number"),
        ([{"name": "coulomb", "parameters": {"torque": 1}}], "a joint is unknown or missing"),
        ([{"name": "coulomb", "joint": "knee", "parameters": {"torque": 1}}], "no joint 'knee'. Use elbow"),
        ([{"name": "lag", "joint": "elbow", "parameters": {"time": 0.1}}], "and no joint"),
        (
            2 * [{"name": "stribeck", "joint": "elbow", "parameters": {"torque": 1, "speed": 0.1}}],
            "lists 'stribeck' of joint 'elbow' 2 times, which do not add up to one law",
        ),
    ],
)
def test_a_wrong_list_of_effects_is_refused(items, said):
    with pytest.raises(InputError) as caught:
        read_effects(items, "m.yaml", JOINT_EFFECTS, joints=["elbow"])
    assert said in str(caught.value)
    assert str(caught.value).startswith("m.yaml")


def test_a_list_of_names_is_read():
    assert read_names(["coulomb"], "case.yaml", JOINT_EFFECTS) == ("coulomb",)
    assert read_names(None, "case.yaml", JOINT_EFFECTS) is read_names([], "case.yaml", JOINT_EFFECTS) is None
    for wrong in ("coulomb", [1], ["restitution"]):
        with pytest.raises(InputError, match=r"case\.yaml"):
            read_names(wrong, "case.yaml", JOINT_EFFECTS)


def test_values_of_a_record_need_no_bounds():
    """Fits may leave them; files may not."""
    assert effect_of(Applied("coulomb", "elbow", {"torque": 99.0}), JOINT_EFFECTS).name == "coulomb"
