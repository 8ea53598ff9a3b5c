"""A page in a real browser, at the width of a desk and of a phone, in light and in dark: what a script finds in it."""

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
PHONE, DESK = 390, 1280
PAPER = (1031, 702)
"""What a printed page holds, px of CSS: A4 on its side, 297 x 210 mm, without the margins of 12 mm that the pages ask for."""
AXE = Path(os.environ.get("GSBRIDGE_AXE") or "axe.min.js")
"""axe-core's own file (MPL-2.0), which .ci/run fetches from npm; no part of the project."""
needs_axe = pytest.mark.skipif(BROWSER is None or not AXE.is_file(), reason="no axe-core: GSBRIDGE_AXE names no axe.min.js")
AUDIT = """
<script src="axe.min.js"></script>
<script>
addEventListener("load", () => setTimeout(() => axe.run(document, {resultTypes: ["violations"]}).then((found) => {
  const told = found.violations.map(v => [v.impact, v.id, v.help, v.nodes.slice(0, 3).map(n => n.html.slice(0, 120))]);
  document.body.innerHTML = "<pre id='found'></pre>";
  document.getElementById("found").textContent = JSON.stringify([found.passes.length, told]);
}), 100));
</script>
"""

LOOK = """
<script>
addEventListener("load", () => setTimeout(() => {
  const all = (selector) => [...document.querySelectorAll(selector)], text = (e) => (e.textContent || "").trim();
  const light = (colour) => {
    const [r, g, b] = colour.match(/[\\d.]+/g).slice(0, 3).map(v => { v /= 255; return v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4; });
    return .2126 * r + .7152 * g + .0722 * b;
  };
  const ground = (e) => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor; if (!/, 0\\)$/.test(c)) return c; } return "rgb(255, 255, 255)"; };
  const contrast = (e) => { const a = light(getComputedStyle(e).color), b = light(ground(e)); return (Math.max(a, b) + .05) / (Math.min(a, b) + .05); };
  const links = all("a[href^='#']"), pictures = [...document.images], ids = all("[id]").map(e => e.id), regions = all("[role=region]");
  const sentence = document.querySelector(".sentence");
  const found = {
    links: all("nav a").length, pictures: pictures.length, rows: all("table").map(t => t.rows.length),
    sentence: sentence && sentence.getBoundingClientRect().bottom,
    wrong: {
      lost: links.filter(a => !document.getElementById(a.getAttribute("href").slice(1))).map(a => a.outerHTML),
      broken: pictures.filter(i => !i.naturalWidth).map(i => i.alt),
      unnamed: pictures.filter(i => !i.alt || /_|\\.(png|jpe?g|svg|webp)/.test(i.alt)).map(i => i.alt),
      foreign: performance.getEntriesByType("resource").filter(r => !r.name.startsWith("data:")).map(r => r.name),
      outside: all("body *").filter(e => e.getBoundingClientRect().right > document.documentElement.clientWidth + 1 && !e.closest(".scroll, .frame")).map(e => e.outerHTML.slice(0, 80)),
      heads: all("thead th").filter(e => e.scope != "col").concat(all("tbody th").filter(e => e.scope != "row")).map(text),
      untitled: all("table").filter(t => !t.caption || !text(t.caption)).map(t => t.outerHTML.slice(0, 80)),
      unreachable: all(".scroll, .frame").filter(e => e.tabIndex != 0 || e.getAttribute("role") != "region" || !e.getAttribute("aria-label")).map(e => e.className),
      twice: ids.filter((id, k) => ids.indexOf(id) != k).concat(regions.map(r => r.getAttribute("aria-label")).filter((l, k, a) => a.indexOf(l) != k)),
      frame: [all("main").length == 1 ? [] : "main", all("h1").length == 1 ? [] : "h1", document.documentElement.lang == "en" ? [] : "lang"].flat(),
      faint: all("p, li, th, td, caption, figcaption, a, b, span, h1, h2, dt, dd").filter(e => text(e) && e.checkVisibility() && contrast(e) < (parseFloat(getComputedStyle(e).fontSize) >= 24 ? 3 : 4.5)).map(e => text(e).slice(0, 40)),
    },
    dark: light(getComputedStyle(document.body).backgroundColor) < .2,
  };
  const full = document.querySelector("a.full");
  if (full) {
    location.hash = full.getAttribute("href");
    const picture = document.getElementById(full.getAttribute("href").slice(1)).querySelector("img");
    found.full = [picture.clientWidth, picture.naturalWidth];
    found.after = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  }
  parent.postMessage(JSON.stringify(found), "*");
}, 100));
</script>
"""  # noqa: E501

PRINT = """
<script>
addEventListener("load", () => setTimeout(() => {
  const all = (selector) => [...document.querySelectorAll(selector)], name = (e) => e.outerHTML.slice(0, 80), box = (e) => e.getBoundingClientRect();
  const shown = (e) => e.checkVisibility({contentVisibilityAuto: true}) && box(e).width * box(e).height > 0;
  const clips = (e) => getComputedStyle(e).overflow != "visible" && (e.scrollWidth > e.clientWidth + 1 || e.scrollHeight > e.clientHeight + 1);
  const pieces = "img, video, tr, figure.picture, figure.film, .photos figure, .next, caption, p, li, pre";
  const found = {
    outside: all("body *").filter(e => box(e).right > innerWidth + 1 || box(e).left < -1).map(name),
    clipped: all("body *").filter(clips).map(name),
    taller: all(pieces).filter(e => box(e).height > innerHeight).map(name),
    folded: all("details *").filter(e => (e.textContent || "").trim() && !shown(e)).map(name),
    torn: all("tr, img, figure.picture, figure.film, .photos figure").filter(e => getComputedStyle(e).breakInside != "avoid" && !e.parentElement.closest("figure.picture, figure.film, .photos figure")).map(name),
  };
  parent.postMessage(JSON.stringify(found), "*");
}, 100));
</script>
"""  # noqa: E501


def look(page, folder, width=DESK, *, dark=False):
    """What is found in a page; `wrong` lists what no page may have.

    Args:
        page: The HTML text.
        folder: For the browser's files.
        width: Of the window, px.
        dark: Whether the reader prefers dark pages.
    """
    found = said(page, LOOK, folder, (width, 900), dark=dark)
    assert found["dark"] == dark
    return found


def printed(page, folder):
    """What of a page is cut when it is printed: by the edge of the paper, by a frame, by a fold, or between two sheets.

    Args:
        page: The HTML text.
        folder: For the browser's files.
    """
    assert "@media print" in page
    found = said(page.replace("@media print", "@media all"), PRINT, folder, PAPER, dark=False)
    return {name: cut for name, cut in found.items() if cut}


def said(page, script, folder, size, *, dark):
    """What a script says of a page in a frame of some width and height, px."""
    (folder / "inner.html").write_text(page.replace("</body>", script + "</body>"), encoding="utf-8")
    # Windows are never as narrow as a phone, frames are.
    width, height = size
    frame = f'<iframe src="inner.html" style="border: 0; width: {width}px; height: {height}px"></iframe><pre id="found"></pre>'
    listen = "<script>onmessage = (e) => { document.getElementById('found').textContent = e.data }</script>"
    (folder / "outer.html").write_text(f"<!DOCTYPE html><body>{frame}{listen}</body>", encoding="utf-8")
    shown = _dumped(folder, folder / "outer.html", 1500, dark=dark)
    return json.loads(html.unescape(re.search(r'<pre id="found">(.*?)</pre>', shown, re.S)[1]))


def audit(page, folder, width=DESK, *, dark=False):
    """What axe objects to: impact, rule, what it wants, and the first elements, of each.

    Args:
        page: The HTML text.
        folder: For the browser's files.
        width: Of the window, px.
        dark: Whether the reader prefers dark pages.
    """
    shutil.copyfile(AXE, folder / "axe.min.js")
    (folder / "audited.html").write_text(page.replace("</body>", AUDIT + "</body>"), encoding="utf-8")
    shown = _dumped(folder, folder / "audited.html", width, dark=dark)
    passed, found = json.loads(html.unescape(re.search(r'<pre id="found">(.*?)</pre>', shown, re.S)[1]))
    assert passed > 10, "axe looked at nothing"
    return found


def _dumped(folder, file, width, *, dark):
    """What a page has become once its scripts have run."""
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += [f"--window-size={width},1000", "--virtual-time-budget=10000", "--hide-scrollbars"]
    command += ["--blink-settings=preferredColorScheme=0"] if dark else []
    return subprocess.run(
        [*command, "--dump-dom", file.as_uri()], capture_output=True, text=True, timeout=300, check=True
    ).stdout


def check(page, folder):
    """A page at both widths, in light and in dark, in print, and by axe where that is there; what was found at a desk.

    Args:
        page: The HTML text.
        folder: For the browser's files.
    """
    seen = {(width, dark): look(page, folder, width, dark=dark) for width, dark in ((DESK, False), (PHONE, True))}
    for found in seen.values():
        assert {name: wrong for name, wrong in found["wrong"].items() if wrong} == {}
        if "full" in found:
            shown, real = found["full"]
            assert shown == real
            assert found["after"] <= 0
    assert printed(page, folder) == {}
    if AXE.is_file():
        for width, dark in ((DESK, False), (PHONE, True)):
            assert audit(page, folder, width, dark=dark) == []
    return seen[DESK, False]
