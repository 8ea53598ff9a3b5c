"""The pages in a real browser: pictures load, links lead somewhere, nothing is asked of a network, nothing sticks out."""

from browser import DESK, audit, check, needs_axe, needs_browser, said
from gap_scores import tier_scores
from test_gap_report_benchmark import FLOORS, write_tiers
from test_report_policies import paper_run

from gsbridge.report.figures.success import write_success_figure
from gsbridge.report.gap.benchmark_page import write_gap_benchmark
from gsbridge.report.pages.tables import write_tables


@needs_browser
def test_page_in_a_browser(tmp_path):
    run = paper_run(tmp_path)
    write_success_figure([run["grasping"]], tmp_path / "success_rates.png")
    write_tables(list(run.values()), [], tmp_path / "tables", policy_figures=[tmp_path / "success_rates.png"])
    found = check((tmp_path / "tables/index.html").read_text(encoding="utf-8"), tmp_path)
    assert found["pictures"] == 1
    # Grasping, renderers, pick and place, failures, training, and the rows without a layout of their own: `worlds`.
    assert found["links"] == 6
    # A header each; means of two worlds and two sets, eight cells twice, two cells of two renderers twice, one cell twice.
    assert found["rows"][:7] == [5, 9, 9, 5, 5, 2, 2]


CUT = """
<script>
addEventListener("load", () => setTimeout(() => {
  const cut = [...document.querySelectorAll(".scroll")].filter(e => e.scrollWidth > e.clientWidth + 1);
  parent.postMessage(JSON.stringify(cut.map(e => e.querySelector("caption").textContent)), "*");
}, 100));
</script>
"""


@needs_browser
def test_the_widest_table_is_whole_on_a_desk(tmp_path):
    run = paper_run(tmp_path)
    write_tables([run["training"]], [], tmp_path / "tables")
    page = (tmp_path / "tables/index.html").read_text(encoding="utf-8").replace(">pass<", ">degraded<")
    assert said(page, CUT, tmp_path, (DESK, 900), dark=False) == []


@needs_browser
def test_page_of_the_benchmark_in_a_browser(tmp_path):
    write_gap_benchmark(
        write_tiers(tmp_path, t1=tier_scores("t1"), t2=tier_scores("t2")), FLOORS, "desktop", tmp_path / "b.html"
    )
    found = check((tmp_path / "b.html").read_text(encoding="utf-8"), tmp_path)
    # Sizes, risk against coverage, calibration; a race and a matrix of each tier.
    assert found["pictures"] == 3 + 2 * 2
    # Floors, sizes, risk against coverage, two tiers, calibration, what went wrong.
    assert found["links"] == 7


@needs_axe
def test_axe_objects_to_what_a_reader_cannot_use(tmp_path):
    body = '<main><h1>A page</h1><p style="color: #bbb">Faint</p><img src="data:,"><button></button></main>'
    page = f"<!DOCTYPE html><html><head><title>A page</title></head><body>{body}</body></html>"
    assert {found[1] for found in audit(page, tmp_path)} >= {"color-contrast", "image-alt", "button-name", "html-has-lang"}
