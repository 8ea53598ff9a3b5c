"""The page in a real browser: pictures load, links lead somewhere, nothing is asked of a network, nothing sticks out."""

import json
import re
import shutil
import subprocess

import pytest
from test_report_policies import paper_run

from gsbridge.report.figures.success import write_success_figure
from gsbridge.report.pages.tables import write_tables

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
LOOK = """
<script>
addEventListener("load", () => {
  const links = [...document.querySelectorAll("a[href^='#']")], pictures = [...document.images];
  const rows = [...document.querySelectorAll("table")].map(t => t.rows.length);
  document.body.innerHTML = "<pre id=found>" + JSON.stringify({
    lost: links.filter(a => !document.getElementById(a.getAttribute("href").slice(1))).length, links: links.length,
    broken: pictures.filter(i => !i.naturalWidth).length, pictures: pictures.length,
    foreign: performance.getEntriesByType("resource").filter(r => !r.name.startsWith("data:")).length,
    outside: document.documentElement.scrollWidth - innerWidth, rows: rows,
  }) + "</pre>";
});
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
def test_page_in_a_browser(tmp_path):
    run = paper_run(tmp_path)
    write_success_figure([run["grasping"]], tmp_path / "success_rates.png")
    write_tables(list(run.values()), [], tmp_path / "tables", policy_figures=[tmp_path / "success_rates.png"])
    page = tmp_path / "looked.html"
    page.write_text((tmp_path / "tables/index.html").read_text().replace("</body>", LOOK + "</body>"))
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--window-size=1400,900", "--virtual-time-budget=10000", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    found = json.loads(re.search(r'<pre id="?found"?>(.*)</pre>', shown)[1])
    assert found["pictures"] == 1
    assert found["links"] == 5
    assert (found["lost"], found["broken"], found["foreign"]) == (0, 0, 0)
    assert found["outside"] <= 0
    # A header each; means of two worlds and two sets, eight cells twice, two cells of two renderers twice, one cell twice.
    assert found["rows"][:7] == [5, 9, 9, 5, 5, 2, 2]
