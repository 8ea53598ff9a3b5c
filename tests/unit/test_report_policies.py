"""Tables, page and scores of policies from trials whose truth is known."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from policy_files import trial_rows, write_policy, write_trials
from scipy import stats

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.images import read_image, write_image
from gsbridge.report.figures.learning_curves import write_learning_curves
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.figures.success import write_success_figure
from gsbridge.report.pages.policies import film, policy_headline
from gsbridge.report.pages.tables import write_tables
from gsbridge.report.scores.measured_policies import wall_time_figures, write_policy_figures, write_world_figures
from gsbridge.report.scores.results_page import AREAS, write_results_page
from gsbridge.report.scores.score import read_floors, write_scores
from gsbridge.report.tables.counts import overviews, read_counts
from gsbridge.report.tables.failures import write_failure_rows
from gsbridge.report.tables.paper import PAPER_GRASPS, PAPER_SCENARIOS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.success import p_text, percent, standard_cells, success_table, success_tables
from gsbridge.report.tables.success_rows import write_success_rows
from gsbridge.report.tables.training import write_training_rows
from gsbridge.report.tables.world_variants import write_world_variants

BEHIND = {"code": {"score_policies": "1"}, "settings": {}}
FLOORS = Path(__file__).parents[2] / "benchmarks" / "floors.yaml"
MESHES = [cell for cell in PAPER_SUCCESS if cell.renderer == "mesh"]
PLACE = CellPaths("pick_and_place", "cake", "plate")


def paper_run(root: Path, worlds: tuple[str, ...] = ("mirror",)) -> dict[str, Path]:
    """The rows of a run whose every cell succeeds as often as the paper's: the second world stands for its robot."""
    trials: dict[CellPaths, list[Path]] = {}
    for cell, paper in PAPER_SUCCESS.items():
        for world in ("sim", *worlds):
            count = paper.sim if world == "sim" else paper.real
            rows = trial_rows({"fixed": count, "unseen": count}, failure="missed_plate" if cell == PLACE else "dropped")
            trials.setdefault(cell, []).append(write_trials(root, cell, world, rows))
    made = [write_policy(root, cell, [0.5, 0.96875, 1.0]) for cell in PAPER_SUCCESS]
    chosen = {
        "grasping": PAPER_GRASPS,
        "renderer_contrast": [cell for cell in PAPER_GRASPS if cell not in PAPER_SCENARIOS] + MESHES,
        "pick_and_place": [PLACE],
        "worlds": [*PAPER_GRASPS, PLACE],
    }
    out = {name: root / "rows" / f"{name}.csv" for name in (*chosen, "failures", "training")}
    for name, cells in chosen.items():
        write_success_rows(out[name], [path for cell in cells for path in trials[cell]])
    write_failure_rows(out["failures"], [path for paths in trials.values() for path in paths])
    write_training_rows(*zip(*made, strict=True), out["training"])
    return out


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> dict[str, Path]:
    return paper_run(tmp_path_factory.mktemp("run"), ("mirror", "mirror_2", "mirror_3"))


def test_overview_of_the_papers_own_numbers_is_the_papers(run):
    rows = read_rows(run["grasping"])
    cells = standard_cells(rows, "grasp")
    assert set(cells) == set(PAPER_GRASPS)
    found = {(view.world, view.pose_set): view for view in overviews(read_counts(rows), cells)}
    sim, mirror = found["sim", "unseen"], found["mirror", "unseen"]
    assert (100 * sim.mean, 100 * mirror.mean) == pytest.approx((96.1, 93.0), abs=0.05)
    assert (mirror.total.successes, mirror.total.trials) == (238, 256)
    six, count = mirror.drop(PAPER_SCENARIOS)
    assert (100 * six, count) == (pytest.approx(6.6, abs=0.05), 6)
    assert 100 * mirror.drop()[0] == pytest.approx(3.2, abs=0.05)
    rates = [[PAPER_SUCCESS[cell].rate(world) for cell in cells] for world in ("sim", "robot")]
    assert mirror.correlation == pytest.approx(np.corrcoef(*rates)[0, 1])
    assert sim.changes == {}
    assert sim.correlation is None
    assert sim.violation is None


def test_printed_tables_hold_counts_intervals_and_the_papers_values(run):
    tables = success_tables({name: read_rows(run[name]) for name in ("grasping", "renderer_contrast", "pick_and_place")})
    titles = [table.title for table in tables["grasping"]]
    assert titles == [
        "Grasping: means over the cells",
        "Grasping, fixed start poses",
        "Grasping, unseen start poses",
        "Grasping: the same policies in further mirrors",
    ]
    means, fixed, _, mirrors = tables["grasping"]
    line = next(row for row in means.rows if row[:2] == ("fixed", "mirror"))
    assert line[2:8] == ("8", "93.0 % [89.2 … 95.7]", "238/256", "93.0 %", "3.2 %", "6.6 %")
    line = next(row for row in fixed.rows if row[0] == "bear on tablecloth")
    assert line == (
        "bear on tablecloth", "28/32 87.5 % [72 … 95]", "24/32 75.0 % [58 … 87]", "−14.3 %", "0.34", "87.5 → 75.0 %", "−14.3 %",
        "pass",
    )  # fmt: skip
    assert mirrors.columns[2:] == ("sim", "mirror", "mirror_2", "mirror_3")
    assert len(mirrors.rows) == 16
    contrast = {row[:2]: row for row in tables["renderer_contrast"][0].rows}
    assert contrast["bear on foam pad", "mesh (RL-sim)"][3:5] == ("8/32 25.0 % [13 … 42]", "−73.3 %")
    assert contrast["bear on foam pad", "splats"][4] == "+14.3 %"
    assert list(contrast) == [
        (f"{item} on foam pad", on) for item in ("small cube", "bear") for on in ("splats", "mesh (RL-sim)")
    ]
    assert any("No trial hangs on it" in note for table in tables["pick_and_place"] for note in table.notes)


def test_trials_on_a_robot_have_tables_of_their_own(tmp_path):
    tried, other = PAPER_GRASPS[:2]
    paths = [write_trials(tmp_path, cell, "sim", trial_rows({"fixed": 32, "unseen": 31})) for cell in (tried, other)]
    paths += [write_trials(tmp_path, other, "sim", trial_rows({"fixed": 30}), seed=2)]
    (tmp_path / "own.csv").write_text("pose_set,index,success\nfixed,0,true\nfixed,1,false\n")
    robot = {"grasp/small_cube+foam_pad/gs/default": tmp_path / "own.csv"}
    write_success_rows(tmp_path / "rows.csv", paths, robot=robot)
    tables = {table.title: table for table in success_tables({"grasping": read_rows(tmp_path / "rows.csv")})["grasping"]}
    table = tables.pop("Grasping on the robot, fixed start poses")
    assert table.columns[:5] == ("cell", "sim", "robot", "change", "p")
    assert [row[:4] for row in table.rows] == [
        ("small cube on foam pad", "32/32 100 % [89 … 100]", "1/2 50.0 % [9 … 91]", "−50.0 %")
    ]
    # Nothing was tried in the mirror, and the second cell has two seeds for fixed poses.
    fixed, unseen = tables["Grasping, fixed start poses"], tables["Grasping, unseen start poses"]
    assert fixed.columns == ("cell", "sim", "paper's sim → robot", "paper's change", "seeds", "status")
    assert [row[4] for row in fixed.rows] == ["1", "2"]
    assert "seeds" not in unseen.columns
    assert not any("robot," in title or "mirror" in title for title in tables)


def test_numbers_for_people():
    assert [percent(value) for value in (0.9375, -0.0625, 0.0, None)] == ["93.8 %", "−6.3 %", "0.0 %", "–"]
    assert [percent(value, signed=True) for value in (0.25, -1e-9, 0.0)] == ["+25.0 %", "0.0 %", "0.0 %"]
    assert [p_text(value) for value in (1.0, 0.336, 0.0421, 3e-9, None)] == ["1.00", "0.34", "0.042", "3e-09", "–"]


def test_figures_are_drawn(run, tmp_path):
    made = [write_policy(tmp_path, cell, np.linspace(0.1, 1.0, 5), seed=seed)[1] for cell in MESHES for seed in (1, 2)]
    write_learning_curves(made, tmp_path / "curves.png")
    write_success_figure([run["grasping"], run["renderer_contrast"]], tmp_path / "success.png")
    for name in ("curves.png", "success.png"):
        image = read_image(tmp_path / name)
        assert min(image.shape[:2]) > 200
        assert image.min() < 0.5
    with pytest.raises(InputError, match="no learning curve"):
        write_learning_curves([], tmp_path / "none.png")
    made[0].write_text(made[0].read_text().replace("1000,", "many,", 1))
    with pytest.raises(InputError, match="curve is damaged"):
        write_learning_curves(made, tmp_path / "none.png")


def test_page_tells_of_policies_first(run, tmp_path):
    write_image(tmp_path / "learning_curves.png", np.full((8, 8, 3), 0.5, np.float32))
    write_image(tmp_path / "behaviour_consistency_bear.png", np.full((8, 8, 3), 0.5, np.float32))
    (tmp_path / "bear.mp4").write_bytes(b"film")
    figures = [tmp_path / "learning_curves.png", tmp_path / "behaviour_consistency_bear.png"]
    films = [("bear <on> foam pad, sim and mirror", tmp_path / "bear.mp4")]
    write_tables(list(run.values()), [], tmp_path / "tables", preset="desktop", policy_figures=figures, films=films)
    names = {f"{name}.{suffix}" for name in run for suffix in ("csv", "md", "tex")}
    assert {path.name for path in (tmp_path / "tables").iterdir()} == names | {"index.html"}
    page = (tmp_path / "tables" / "index.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:|#)", page), "the page must not load anything"
    text = page.replace("\u00a0", " ")
    assert "Grasping, 8 cells, unseen start poses: 96.1 % of the trials succeed in simulation and 93.0 % in the mirror" in text
    assert "drops by 3.2 % on average over 8 cells; over the paper&#39;s six scenario cells it drops by 6.6 %" in text
    assert "the success rate drops by 80.2 % on the way to the mirror (the paper: 80.2 %)" in text
    order = ["grasping", "renderer-contrast", "pick-and-place", "behaviour", "failures", "training", "films"]
    places = [page.index(f'<h2 id="{name}"') for name in order]
    assert places == sorted(places)
    assert all(f'href="#{name}"' in page for name in order)
    assert 'src="data:video/mp4;base64,ZmlsbQ=="' in page
    assert "bear &lt;on&gt; foam pad" in page
    latex = (tmp_path / "tables" / "grasping.tex").read_text()
    assert latex.count(r"\begin{table}") == latex.count(r"\end{table}") == 4
    assert "24/32 75.0 % [58" in (tmp_path / "tables" / "grasping.md").read_text()


def test_one_cell_that_succeeds_everywhere_is_told_without_averages(tmp_path):
    cell = CellPaths("grasp", "small_cube", "foam_pad")
    trials = [write_trials(tmp_path, cell, world, trial_rows({"unseen": 32})) for world in ("sim", "mirror")]
    write_success_rows(tmp_path / "grasping.csv", trials)
    write_tables([tmp_path / "grasping.csv"], [], tmp_path / "tables", preset="toy")
    page = (tmp_path / "tables/index.html").read_text().replace("\u00a0", " ")
    assert "Grasping, small cube on foam pad, unseen start poses: 100.0 % of the trials succeed in simulation" in page
    assert "From simulation to the mirror the success rate stays the same." in page
    assert "on average" not in page
    assert "This is the toy run" in page


def test_figures_without_words_are_refused(tmp_path):
    write_image(tmp_path / "new_figure.png", np.full((8, 8, 3), 0.5, np.float32))
    with pytest.raises(InputError, match="no caption"):
        write_tables([], [tmp_path / "new_figure.png"], tmp_path / "tables")


@pytest.mark.parametrize("width", [2.0, 4.0, 12.0])
def test_legends_stay_inside_narrow_figures(width):
    figure, axis = plt.subplots(figsize=(width, 3.0), layout="constrained")
    lines = axis.plot(np.zeros((2, 5)))
    legend_above(figure, lines, [f"what line {number} shows" for number in range(5)])
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert len(figure.legends) == 1
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width
    plt.close(figure)


def test_page_without_policies_is_about_splats(tmp_path):
    write_tables([], [], tmp_path / "tables")
    page = (tmp_path / "tables" / "index.html").read_text()
    assert "<h1>Real2Sim" in page
    assert "policies" not in page.lower()


def test_page_lists_what_is_degraded_once(tmp_path):
    cell = PAPER_GRASPS[0]
    paths = [write_trials(tmp_path, cell, world, trial_rows({"fixed": 31, "unseen": 31})) for world in ("sim", "mirror")]
    policy, _ = write_policy(tmp_path, cell, [0.5], status="degraded", reasons=["never reached 95 %"])
    record = tmp_path / "results/scenes/foam_pad/align/align.json"
    write_json(record, {"status": "degraded", "reasons": ["no <board>"]})
    write_success_rows(tmp_path / "rows/grasping.csv", paths, policies=[policy], records=[record])
    write_tables([tmp_path / "rows/grasping.csv"], [], tmp_path / "tables", records=[record])
    page = (tmp_path / "tables" / "index.html").read_text()
    assert page.count("no &lt;board&gt;") == 1
    assert "small cube on foam pad, grasp, splats</b>: training: never reached 95 %" in page
    assert page.count("never reached 95 %") == 1
    assert '<span class="label degraded">degraded</span>' in page


def test_films_of_other_kinds_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        film("none", tmp_path / "none.mp4")
    with pytest.raises(InputError, match="no film"):
        film("none", tmp_path / "none.avi")


def area(tmp_path: Path, run: dict[str, Path], **more) -> dict:
    """Scores of the area."""
    rows = {name: path for name, path in run.items() if name not in ("failures", "worlds")}
    write_policy_figures(tmp_path / "measured.json", **rows, **more, preset="desktop")
    write_scores(
        FLOORS, [tmp_path / "measured.json"], tmp_path / "policies.json", area="policies", preset="desktop", provenance=BEHIND
    )
    return read_json(tmp_path / "policies.json")["figures"]


def further(tmp_path: Path, rows: Path) -> dict:
    """Scores of the area of further worlds."""
    write_world_figures(tmp_path / "measured.json", rows, "desktop")
    write_scores(
        FLOORS, [tmp_path / "measured.json"], tmp_path / "worlds.json", area="worlds", preset="desktop", provenance=BEHIND
    )
    return read_json(tmp_path / "worlds.json")["figures"]


def test_further_worlds_have_floors_and_a_page_of_their_own(run, tmp_path):
    scores = further(tmp_path, run["worlds"])
    assert {name.split("_mirror_")[1] for name in scores} == {f"{k}_{poses}" for k in (2, 3) for poses in ("fixed", "unseen")}
    for name, score in scores.items():
        paper = {"grasp": 92.97, "place": 71.875, "drop_six": 6.6, "drop_eight": 3.2}[name.split("_mirror_")[0]]
        assert score["value"] == pytest.approx(paper, abs=0.05), name
        assert score["where"] == "results/rows/worlds.csv"
    write_world_variants(run["worlds"], tmp_path / "worlds.md")
    page = (tmp_path / "worlds.md").read_text()
    assert "| fixed | mirror_3 | 8 | 93.0 % [89.2 … 95.7] |" in page
    assert "| cake on plate | unseen | 22/32 68.8 % [51 … 82] |" in page


def test_a_world_that_was_not_tried_meets_no_floor(tmp_path):
    paths = [
        write_trials(tmp_path, cell, world, trial_rows({"fixed": 32, "unseen": 32}))
        for cell in (*PAPER_GRASPS, PLACE)
        for world in ("sim", "mirror_2")
    ]
    write_success_rows(tmp_path / "worlds.csv", paths)
    scores = further(tmp_path, tmp_path / "worlds.csv")
    assert {name: score["reason"] for name, score in scores.items()} == {
        name: "" if "mirror_2" in name else "not measured" for name in scores
    }


def test_the_paper_itself_against_the_floors(run, tmp_path):
    write_json(tmp_path / "times.json", {"make_tables": {"wall_s": 9000, "cores": 2}, "make_toy": {"wall_s": 400, "cores": 8}})
    scores = area(tmp_path, run, toy=run["grasping"], wall_times=tmp_path / "times.json")
    for poses in ("fixed", "unseen"):
        assert scores[f"grasp_mirror_{poses}"]["value"] == pytest.approx(92.97, abs=0.01)
        assert scores[f"drop_six_mirror_{poses}"]["value"] == pytest.approx(6.6, abs=0.05)
        assert scores[f"drop_eight_mirror_{poses}"]["met"]
        assert scores[f"place_mirror_{poses}"]["reason"] == "outside the floor"
    # The paper's 96.1 and 92.97 stand on both sides of 96 and 93.
    assert scores["grasp_sim_unseen"]["met"]
    assert not scores["grasp_mirror_unseen"]["met"]
    # With one training per cell only the starts scatter: 96.1 % of 256, a little less than if all cells had the same rate.
    wide, wilson = 196 * np.sqrt(0.961 * 0.039 / 256), stats.binomtest(246, 256).proportion_ci(method="wilson")
    low, high = scores["grasp_sim_unseen"]["interval"]
    assert low == pytest.approx(100 * wilson.low)
    assert high == pytest.approx(96.1 + wide, abs=0.6)
    assert scores["rl_sim_drop_mirror_fixed"]["value"] == pytest.approx(80.2, abs=0.05)
    assert scores["training_cpu_max"]["value"] == pytest.approx(8.0)
    assert scores["replay_memory_max"]["value"] == 150.0
    assert (scores["make_tables_wall"]["value"], scores["make_tables_wall"]["met"]) == (2.5, True)
    assert scores["make_toy_wall"]["reason"] == "not measured"
    assert scores["toy_sim_success"]["value"] == pytest.approx(87.5)
    write_results_page(tmp_path, tmp_path / "RESULTS.md", dict.fromkeys(AREAS, BEHIND))
    text = (tmp_path / "RESULTS.md").read_text()
    floors = {name: entry for name, entry in read_floors(FLOORS).items() if entry["area"] == "policies"}
    assert all(f"`{name}`" in text for name in floors)
    assert re.search(r"\(`rl_sim_drop_mirror_fixed`\).* 80\.2.*\| reported \|", text)
    assert "bear+tablecloth" in text


def test_a_part_of_the_cells_meets_no_floor(tmp_path):
    cells = PAPER_GRASPS[:3]
    paths = [
        write_trials(tmp_path, cell, world, trial_rows({"fixed": 32, "unseen": 8}, count=32))
        for cell in cells
        for world in ("sim", "mirror")
    ]
    write_success_rows(tmp_path / "grasping.csv", paths)
    slow = write_policy(tmp_path, cells[0], [0.9, 0.94])
    fast = write_policy(tmp_path, cells[1], [0.96])
    write_training_rows(*zip(slow, fast, strict=True), tmp_path / "training.csv")
    scores = area(tmp_path, {"grasping": tmp_path / "grasping.csv", "training": tmp_path / "training.csv"})
    assert scores["grasp_sim_fixed"]["value"] == 100.0
    assert scores["grasp_sim_fixed"]["reason"] == "measured on 3 of 8 cells only"
    assert scores["training_cpu_max"]["reason"] == "measured on 1 of 8 cells at 95 % only"
    assert scores["place_sim_fixed"]["reason"] == scores["rl_sim_drop_mirror_fixed"]["reason"] == "not measured"


def test_too_few_trials_meet_no_floor(tmp_path):
    paths = [
        write_trials(tmp_path, cell, "sim", trial_rows({"fixed": 8}, count=8), seed=seed)
        for cell in PAPER_GRASPS
        for seed in (1, 2, 3, 4)
    ]
    write_success_rows(tmp_path / "grasping.csv", paths)
    scores = area(tmp_path, {"grasping": tmp_path / "grasping.csv"})
    # Four seeds of eight trials are 32 in all, but only a quarter of the start poses.
    assert scores["grasp_sim_fixed"]["reason"] == "measured on 8 of 32 trials only"


def test_every_floor_of_the_area_has_its_figure(run, tmp_path):
    write_json(tmp_path / "times.json", {name: {"wall_s": 60, "cores": 2} for name in ("make_tables", "make_toy")})
    scores = area(tmp_path, run, toy=run["grasping"], wall_times=tmp_path / "times.json")
    assert [name for name, score in scores.items() if score["reason"] == "not measured"] == []
    wanted = {
        ("grasp_sim_unseen", 96), ("grasp_mirror_unseen", 93), ("place_mirror_fixed", 80), ("place_sim_fixed", 85),
        ("drop_six_mirror_unseen", 6.6), ("drop_eight_mirror_fixed", 4), ("training_cpu_max", 8),
        ("rl_sim_drop_mirror_unseen", None), ("replay_memory_max", 200), ("make_tables_wall", 3), ("make_toy_wall", 15),
        ("toy_sim_success", 90),
    }  # fmt: skip
    assert wanted <= {(name, score["floor"]) for name, score in scores.items()}


def test_the_floors_of_further_worlds_are_those_of_the_first():
    floors = read_floors(FLOORS)
    for name, entry in floors.items():
        if entry["area"] == "worlds":
            first = floors[name.replace("mirror_2", "mirror").replace("mirror_3", "mirror")]
            assert [entry[key] for key in ("floor", "direction", "needs", "stretch")] == [
                first[key] for key in ("floor", "direction", "needs", "stretch")
            ]


def test_wall_times_on_more_cores_do_not_count():
    assert wall_time_figures({"make_toy": {"wall_s": 60, "cores": 3}, "other": {"wall_s": 1, "cores": 1}}) == {}


def test_the_paper_s_values_stand_beside_no_starts_beyond_its_training(tmp_path):
    cell = next(iter(PAPER_GRASPS))
    files = [
        write_trials(tmp_path, cell, world, trial_rows({"fixed": good, "unseen": good, "outside": 3}))
        for world, good in (("sim", 32), ("mirror", 30))
    ]
    write_success_rows(tmp_path / "grasping.csv", files)
    rows = read_rows(tmp_path / "grasping.csv")
    known = {row["pose_set"]: bool(row["paper_success_rate"]) for row in rows}
    assert known == {"fixed": True, "unseen": True, "outside": False}
    tables = {pose_set: success_table(rows, pose_set, title="") for pose_set in known}
    assert {name: "paper's change" in table.columns for name, table in tables.items()} == known
    # The headline gives the rates of the paper's protocol, not the lower ones of starts outside it.
    text = " ".join(policy_headline({"grasping": rows}))
    assert "unseen start poses: 100.0 % of the trials succeed in simulation and 93.8 % in the mirror (the paper" in text
    assert "drops by 6.3 %" in text
