"""Since when floors stand: from versions of the list and from recorded scores."""

from pathlib import Path

import pytest
import yaml

from benchmarks.floor_history import FLOORS, PAGE, floors_over_time, is_current, is_missed, page

ROOT = Path(__file__).resolve().parents[2]


def asked(floor, direction="at_least", stretch=None):
    return {"floor": floor, "direction": direction, "unit": "%", "stretch": stretch}


def score(value, floor, direction="at_least", reason=""):
    return {**asked(floor, direction), "value": value, "reason": reason}


VERSIONS = [
    ("day 1", {"success": asked(90), "error": asked(2, "at_most"), "gone": asked(1)}),
    ("day 2", {"success": asked(90), "error": asked(3, "at_most")}),
    ("day 3", {"success": {**asked(90), "what": "other words"}, "error": asked(3, "at_most"), "new": asked(None)}),
]


def test_a_floor_stands_since_it_has_its_value():
    found = floors_over_time(iter(VERSIONS))
    assert {name: told.since for name, told in found.items()} == {"success": "day 1", "error": "day 2", "new": "day 3"}
    assert (found["error"].before, found["error"].floor) == (["≤ 2 %"], "≤ 3 %")
    assert found["success"].before == []
    assert found["new"].floor == "reported"


@pytest.mark.parametrize(
    ("told", "missed"),
    [
        (score(89, 90), True),
        (score(90, 90), False),
        (score(3, 2, "at_most"), True),
        (score(None, 90), False),
        (score(1, None), False),
        (score(1, 90, reason="measured with preset toy, asked for preset desktop"), False),
    ],
)
def test_a_miss_is_a_value_worse_than_its_floor(told, missed):
    assert is_missed(told) is missed


def test_the_page_tells_of_the_first_miss_and_of_a_floor_that_was_moved():
    told = [("day 1", "success", score(95, 90)), ("day 1", "error", score(2.5, 2, "at_most"))]
    told += [("day 2", "success", score(80, 90)), ("day 3", "success", score(70, 90)), ("day 3", "gone", score(0, 1))]
    text = page(floors_over_time(iter(VERSIONS)), iter(told))
    assert "| `success` | ≥ 90 % | day 1 | – | 80 % (day 2, floor ≥ 90 %) |" in text
    assert "| `error` | ≤ 3 % | day 2 | ≤ 2 % | 2.5 % (day 1, floor ≤ 2 %) |" in text
    assert "gone" not in text
    assert is_current(text, VERSIONS[-1][1])
    assert not is_current(text, VERSIONS[0][1])


def test_the_page_of_the_project_is_of_its_floors():
    floors = yaml.safe_load((ROOT / FLOORS).read_text(encoding="utf-8"))
    assert is_current((ROOT / PAGE).read_text(encoding="utf-8"), floors), "run python -m benchmarks.floor_history"
