"""Look of all pages: light CSS, the same colours everywhere."""

# ruff: noqa: E501  (CSS)

STYLE = """\
:root { --ink: #1d2733; --soft: #5b6b7b; --line: #dde3ea; --paper: #7a5a1e; --accent: #1f6f8b; --good: #2c7a4b; --warn: #a6611a; --back: #fbfcfd; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 80rem; padding: 2.5rem 1.5rem 4rem; color: var(--ink); background: var(--back);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; letter-spacing: -.01em; }
h2 { font-size: 1.35rem; margin: 3rem 0 .5rem; padding-top: 1rem; border-top: 2px solid var(--line); }
p { max-width: 46rem; }
.lede { font-size: 1.1rem; margin: .4rem 0; }
nav { margin: 1rem 0 0; }
nav a { color: var(--accent); margin-right: 1.2rem; }
figure { margin: 1.5rem 0 2.2rem; }
figure.table > figcaption { font-weight: 600; margin-bottom: .5rem; }
figure.picture > figcaption { color: var(--soft); font-size: .92rem; margin-top: .5rem; max-width: 46rem; }
img, video { max-width: 100%; border-radius: 4px; border: 1px solid var(--line); }
h2.part { font-size: 1.9rem; letter-spacing: -.01em; margin-top: 4.5rem; border-top-width: 4px; }
.films { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(32rem, 100%), 1fr)); gap: 1rem 1.2rem; }
figure.film { margin: .4rem 0; }
figure.film > figcaption { color: var(--soft); font-size: .9rem; }
figure.film video, figure.film img { width: 100%; }
.scroll { overflow-x: auto; background: white; border: 1px solid var(--line); border-radius: 6px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { padding: .42rem .6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--soft); font-size: .84rem; background: #f3f6f9; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0; }
td:first-child { background: inherit; }
tbody tr { background: white; }
tbody tr:last-child td { border-bottom: 0; }
tbody tr:hover { background: #f3f8fa; }
td.best { font-weight: 700; color: var(--accent); }
td.paper { color: var(--paper); font-style: italic; }
.note { color: var(--soft); font-size: .88rem; margin: .35rem 0 0; max-width: 60rem; }
.label { display: inline-block; border-radius: 1em; padding: 0 .6em; font-size: .82rem; border: 1px solid; }
.label.pass { color: var(--good); }
.label.degraded { color: var(--warn); background: #fdf5ea; }
.bar { display: inline-block; height: .7em; background: var(--accent); opacity: .65; border-radius: 2px; min-width: 2px; }
td.barcell { text-align: left; width: 40%; }
@media print { body { max-width: none; } .scroll { overflow: visible; } }
"""
