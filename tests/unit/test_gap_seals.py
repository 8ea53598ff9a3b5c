"""Seals: one number draws a scored split, and its first score stays."""

import json

import pytest
from gap_scores import tier_scores
from scipy import stats

from benchmarks import gap_seals
from gsbridge.errors import InputError
from gsbridge.experiment.seals import read_seals, record_seal, seal_of
from gsbridge.gap.benchmark.case_plan import TIERS, plan_cases
from gsbridge.report.scores.results_page import seals_markdown


def test_a_seal_is_a_whole_number():
    assert seal_of({}) is None
    assert seal_of({"GSBRIDGE_SEAL": " "}) is None
    assert seal_of({"GSBRIDGE_SEAL": "4711"}) == 4711
    with pytest.raises(InputError, match="no seal"):
        seal_of({"GSBRIDGE_SEAL": "-3"})


def test_a_seal_alone_decides_what_is_drawn():
    names, strange = ("coulomb:a", "viscous:a", "lag", "gravcomp"), ("odd", "other")
    for tier in TIERS:
        drawn = plan_cases(tier, "scored", names, strange, 12, 0, 4711)
        assert drawn == plan_cases(tier, "development", names, strange, 12, 5, 4711)
        other = plan_cases(tier, "scored", names, strange, 12, 0, 4712)
        assert {order.seed for order in drawn}.isdisjoint(order.seed for order in other)
        assert {order.course_seed for order in drawn}.isdisjoint(order.course_seed for order in other)
        assert {order.units for order in drawn if order.units}.isdisjoint(order.units for order in other if order.units)


def test_the_first_score_of_a_seal_stays(tmp_path):
    record_seal(tmp_path, 12001, {"t5": {"code": "a", "figures": {"right": 1}}})
    record_seal(tmp_path, 12001, {"t5": {"code": "b", "figures": {"right": 9}}, "t7": {"code": "b", "figures": {}}})
    record_seal(tmp_path, 11001, {"t5": {"code": "b", "cases": 4, "figures": {}}})
    found = read_seals(tmp_path)
    assert [item["seal"] for item in found] == [11001, 12001]
    assert found[1]["parts"]["t5"] == {"code": "a", "figures": {"right": 1}}
    assert found[1]["parts"]["t7"]["code"] == "b"
    page = seals_markdown(
        [{"seal": 7, "parts": {"t5": {"code": "a", "cases": 3, "figures": {"right": "1 of 3"}, "note": "Drawn badly."}}}]
    )
    assert "| 7 | t5 | `a` | 3 | right 1 of 3 **Drawn badly.** |" in page
    assert "**" not in seals_markdown(found[:1])
    assert seals_markdown([]) == ""
    (tmp_path / "5.json").write_text("{}")
    with pytest.raises(InputError, match="no seal"):
        read_seals(tmp_path)


def test_first_scores_are_added_up_part_by_part():
    def seal(number, **parts):
        told = {part: {"code": "a", "cases": 9, "figures": figures} for part, figures in parts.items()}
        return {"seal": number, "parts": told}

    first = seal(
        1, t1={"named right": "8 of 8", "among the surest": "gsbridge 0 %; cosine 9 of 10 %"}, t5={"named right": "1 of 2"}
    )
    page = seals_markdown([first, seal(2, t1={"named right": "15 of 16", "named wrong": "0 of 0"})])
    table = page.split("All first scores together")[1]
    assert "| part | seals | named right | named wrong |" in table
    low, high = stats.binomtest(23, 24).proportion_ci(method="wilson")
    assert f"| t1 | 2 | 23 of 24 ({100 * low:.0f} to {100 * high:.0f}) | – |" in table
    assert "| t5 | 1 | 1 of 2 (9 to 91) | – |" in table
    # Cases from another version of the benchmark are not added up with these, either.
    old = seal(3, t1={"named right": "0 of 4"})
    old["parts"]["t1"]["apart"] = "old springs"
    page = seals_markdown([first, seal(2, t1={"named right": "15 of 16"}), old])
    assert "| t1 | 2 | 23 of 24" in page
    assert "| t1, old springs | 1 | 0 of 4" in page
    # With a single score there is no line of sums.
    assert "together" not in seals_markdown([first])


def test_a_part_of_a_seal_is_scored_beside_another_method(tmp_path, monkeypatch):
    monkeypatch.setenv("GSBRIDGE_SEAL", "21")
    given = ["--tiers", "t0", "--cases", "4", "--methods", "cosine"]
    assert gap_seals.main([*given, "--folder", str(tmp_path / "work"), "--register", str(tmp_path / "seals")]) == 0
    (found,) = read_seals(tmp_path / "seals")
    told = found["parts"]["t0"]
    assert (found["seal"], told["cases"]) == (21, 4)
    (ways,) = [text for name, text in told["figures"].items() if name.startswith("wrong among the")]
    assert ways.startswith("gsbridge ")
    assert "; cosine " in ways


def test_what_the_workflow_has_scored_with_a_seal_is_written_down(tmp_path, monkeypatch):
    monkeypatch.delenv("GSBRIDGE_SEAL", raising=False)
    drawn, compared = tmp_path / "t0.json", tmp_path / "compared.json"
    scores = {**tier_scores("t0"), "seal": 12001}
    compared.write_text(json.dumps(scores))
    drawn.write_text(json.dumps({**scores, "methods": {"gsbridge": scores["methods"]["gsbridge"]}}))
    assert gap_seals.main(["--scored", str(drawn), str(compared), "--register", str(tmp_path / "seals")]) == 0
    (found,) = read_seals(tmp_path / "seals")
    ours = tier_scores("t0")["methods"]["gsbridge"]["named_right"]
    assert found["seal"] == 12001
    assert found["parts"]["t0"]["figures"]["named right"] == f"{round(ours['value'] * ours['n'])} of {ours['n']}"
    # Scores of a tier together with other methods, which come later, are kept as a part of their own.
    beside = found["parts"]["t0, all ways of naming"]["figures"]
    assert {name for name in beside if name.startswith("wrong among")} == set(beside) - set(found["parts"]["t0"]["figures"])
    # Scores of cases that no seal has drawn are refused.
    other = tmp_path / "t1.json"
    other.write_text(json.dumps({**tier_scores("t1"), "seal": None}))
    with pytest.raises(InputError, match="no seal has drawn"):
        gap_seals.main(["--scored", str(drawn), str(other), "--register", str(tmp_path / "others")])
    assert not (tmp_path / "others").exists()


def test_methods_that_cannot_run_in_a_tier_are_refused_before_anything_is_drawn(tmp_path, monkeypatch):
    monkeypatch.setenv("GSBRIDGE_SEAL", "21")
    with pytest.raises(InputError, match="cosine cannot run in tier t5"):
        gap_seals.main(["--tiers", "t0", "t5", "--methods", "cosine", "--folder", str(tmp_path / "work")])
    assert not (tmp_path / "work").exists()
