"""Settings of policies and worlds are refused before any job."""

import copy

import pytest

from gsbridge.errors import InputError
from gsbridge.policy.plan import AMENDED, SEEN, check_policies

OWN = {"registered_in": None, "calibrated_in": None, "unchanged_teacher": False}

CONFIG = {
    "seed": 1,
    "grasp_policy": {},
    "pick_and_place_policy": {"steps": 900},
    "trials": {"worlds": ["mirror", "late"]},
    "study": {
        "variants": ["default", "bc"],
        "worlds": ["late"],
        "cell": {"task": "grasp", "object": "cake", "background": "foam_pad"},
        "picture_gap": {
            "variants": ["bc"],
            "worlds": ["mirror"],
            "reference": "mirror",
            "amended": {"late": ["seen"]},
            "controls": {},
        },
        "severity": {"variants": ["default"], "worlds": ["mirror"]},
    },
    "scenes": {"cake": {}, "foam_pad": {}},
    "loop": {
        "cell": {"object": "cake", "background": "foam_pad"},
        "reference": "mirror",
        "changed": "late",
        "variant": "amended",
        "controls": [],
    },
    "presets": {"toy": {"grasp_policy": {"steps": 50}}, "desktop": {}},
    "variants": {
        "default": {"policy": {}, "model": None} | OWN,
        "bc": {"policy": {"algo": "bc"}, "model": "m.yaml"} | OWN,
        "amended": {"policy": {}, "model": AMENDED} | OWN,
        "seen": {"policy": {}, "model": SEEN.format(world="late")} | OWN,
    },
    "worlds": {"mirror": {"seed": None, "hidden": {}}, "late": {"seed": 4, "hidden": {"latency": 0.1}}},
}


def test_sound_settings_pass(tmp_path):
    (tmp_path / "m.yaml").touch()
    check_policies(CONFIG, tmp_path)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("variants", "bc", "policy"), {"alpha_start": 0.5}, ["variants.bc with grasp_policy", "alpha_start"]),
        (("presets", "toy", "grasp_policy"), {"critic_batch": 16}, ["presets.toy.grasp_policy", "critic_batch"]),
        (("variants", "bc", "model"), "gone.yaml", ["variants.bc.model", "gone.yaml"]),
        (("study", "variants"), ["default", "td3"], ["config: study.variants", "td3"]),
        (("study", "worlds"), ["mirror", "mars"], ["config: study.worlds", "mars"]),
        (("study", "picture_gap", "variants"), ["dark"], ["config: study.picture_gap.variants", "dark"]),
        (("study", "picture_gap", "worlds"), ["moon"], ["config: study.picture_gap.worlds", "moon"]),
        (("study", "cell"), {"object": "teapot", "background": "foam_pad"}, ["study.cell.object", "teapot"]),
        (("study", "picture_gap", "reference"), "moon", ["config: study.picture_gap", "moon"]),
        (("study", "picture_gap", "amended"), {"moon": ["seen"]}, ["config: study.picture_gap", "moon"]),
        (("study", "picture_gap", "amended"), {"mirror": ["seen"]}, ["study.picture_gap.amended.mirror", "the reference"]),
        (("study", "picture_gap", "amended"), {"late": ["dark"]}, ["study.picture_gap.amended.late", "dark"]),
        (("study", "picture_gap", "amended"), {"late": ["bc"]}, ["variants.bc.model", SEEN.format(world="late")]),
        (("trials", "worlds"), ["mirror", "mars"], ["config: trials.worlds", "mars"]),
        (("presets", "desktop", "trials"), {"worlds": ["mars"]}, ["presets.desktop.trials.worlds", "mars"]),
        (("loop", "variant"), "mended", ["loop.variant", "mended"]),
        (("loop", "changed"), "mars", ["loop.changed", "mars"]),
        (("loop", "changed"), "mirror", ["loop.changed", "the reference"]),
        (("loop", "variant"), "bc", ["variants.bc.model", AMENDED]),
        (("loop", "cell"), {"object": "hat", "background": "foam_pad"}, ["loop.cell.object", "hat"]),
        (("worlds", "late", "hidden"), {"latencey": 0.1}, ["worlds.late.hidden", "latencey"]),
        (("worlds", "late", "hidden"), {"mass": "heavy"}, ["worlds.late.hidden", "mass"]),
    ],
)
def test_what_would_fail_hours_later_is_named(tmp_path, path, value, words):
    (tmp_path / "m.yaml").touch()
    config = copy.deepcopy(CONFIG)
    place = config
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(InputError) as caught:
        check_policies(config, tmp_path)
    for word in words:
        assert word in str(caught.value)
