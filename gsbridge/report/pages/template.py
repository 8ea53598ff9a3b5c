"""Template of the page (jinja2): one self-contained HTML file, light CSS, no script.

It is a module, not a data file: it is installed with the code, and its digest counts for the rule that writes the page.
"""

# ruff: noqa: E501  (markup)

from gsbridge.report.pages.style import STYLE

PAGE = (
    """\
{% macro show(table) %}
<figure class="table">
<figcaption>{{ table.title }}</figcaption>
<div class="scroll"><table>
<thead><tr>{% for name in table.columns %}<th>{{ name }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in table.rows %}
{% set line = loop.index0 %}
<tr>{% for text in row %}
<td{% if (line, loop.index0) in table.best %} class="best"{% elif table.columns[loop.index0] == "paper" or table.columns[loop.index0].startswith("paper's") %} class="paper"{% endif %}>{% if table.columns[loop.index0] == "status" %}<span class="label {{ text }}">{{ text }}</span>{% elif loop.first %}<b>{{ text }}</b>{% else %}{{ text }}{% endif %}</td>
{% endfor %}</tr>
{% endfor %}
</tbody></table></div>
{% for note in table.notes %}<p class="note">{{ note }}</p>
{% endfor %}
</figure>
{% endmacro %}
{% macro draw(picture) %}
<figure class="picture"><img src="{{ picture.data }}" alt="{{ picture.name }}"><figcaption>{{ picture.caption }}</figcaption></figure>
{% endmacro %}
{% macro show_film(item) %}
<figure class="film">{% if item.moving %}<video src="{{ item.data }}" controls loop muted playsinline preload="metadata"></video>{% else %}<img src="{{ item.data }}" alt="{{ item.title }}">{% endif %}<figcaption>{{ item.title }}</figcaption></figure>
{% endmacro %}
{% macro about_splats() %}
{% for sentence in headline %}<p class="lede">{{ sentence }}</p>
{% endfor %}
<p class="note">PSNR in dB, SSIM and alpha IoU: higher is better; LPIPS: lower. Held-out photos (every 8th) were never trained on.
The best bound model of each scene is <b style="color: var(--accent)">bold</b>, the paper's values are <i style="color: var(--paper)">in italics</i>.
“Mirror” scenes are filmed by a path tracer and have a hidden truth; they are not the real world.{% if preset %} Preset: {{ preset }}.{% endif %}</p>
{% endmacro %}
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>gsbridge: tables</title>
<style>
"""
    + STYLE
    + """</style>
</head>
<body>
<header>
{% if parts %}
<h1>From video to verdict: policies in two worlds</h1>
{% for sentence in policy_headline %}<p class="lede">{{ sentence | replace(" %", "\u00a0%") }}</p>
{% endfor %}
<p class="note">Policies learn in simulation alone, from pictures of splats. “Mirror” is a second world with shapes, physics, light and a camera of its own; it stands in for reality and is not the real world. “Robot” are a user's own trials.
Every rate stands with its count of trials; the paper's values are <i style="color: var(--paper)">in italics</i>.{% if preset %} Preset: {{ preset }}.{% endif %}</p>
{% else %}
<h1>Real2Sim: how well the splats show the photos</h1>
{{ about_splats() }}
{% endif %}
<nav>{% for part in parts %}<a href="#{{ part.id }}">{{ part.title }}</a>{% endfor %}{% if films %}<a href="#films">Films of trials</a>{% endif %}{% if mirror %}<a href="#mirror">Mirrored scenes</a>{% endif %}{% if real %}<a href="#real">Real captures</a>{% endif %}{% if stages %}<a href="#stages">Reconstruction</a>{% endif %}{% if degraded %}<a href="#degraded">Degraded results</a>{% endif %}{% for table in others %}<a href="#{{ table.title | replace(' ', '-') }}">{{ table.title }}</a>{% endfor %}{% if times %}<a href="#time">Time per stage</a>{% endif %}</nav>
</header>
{% for part in parts %}
<h2 id="{{ part.id }}">{{ part.title }}</h2>
<p>{{ part.intro }}</p>
{% for item in part.pictures %}
{{ draw(item) }}
{% endfor %}
{% for table in part.tables %}
{{ show(table) }}
{% endfor %}
{% endfor %}
{% if films %}
<h2 id="films">Films of trials</h2>
<div class="films">
{% for item in films %}
{{ show_film(item) }}
{% endfor %}
</div>
{% endif %}
{% if parts and (mirror or real) %}
<h2 class="part" id="splats">Real2Sim: how well the splats show the photos</h2>
{{ about_splats() }}
{% endif %}
{% if mirror %}
<h2 id="mirror">Mirrored scenes</h2>
{% for table in mirror %}
{{ show(table) }}
{% endfor %}
{% for item in pictures if not item.name.endswith("_real") %}
{{ draw(item) }}
{% endfor %}
{% endif %}
{% if real %}
<h2 id="real">Real captures</h2>
<p>Photos and films of the real world. There is no truth to score against and no value in the paper: held-out photos are the only judge.</p>
{% for table in real %}
{{ show(table) }}
{% endfor %}
{% for item in pictures if item.name.endswith("_real") or not mirror %}
{{ draw(item) }}
{% endfor %}
{% endif %}
{% if stages %}
<h2 id="stages">Reconstruction</h2>
<p>What the stages before the splats say of themselves. “unknown” scale: lengths are in arbitrary units.</p>
{{ show(stages) }}
{% endif %}
{% if degraded %}
<h2 id="degraded">Degraded results</h2>
<p>These runs finished, but something about them should be known before they are used.</p>
<ul>
{% for scene, reasons in degraded.items() %}
{% for reason in reasons %}
<li><b>{{ scene }}</b>: {{ reason }}</li>
{% endfor %}
{% endfor %}
</ul>
{% endif %}
{% for table in others %}
<h2 id="{{ table.title | replace(' ', '-') }}">{{ table.title }}</h2>
{{ show(table) }}
{% endfor %}
{% if times %}
<h2 id="time">Time per stage</h2>
<p class="note">Sums over the jobs of each rule; jobs run side by side, so the sum is more than the time you waited.</p>
<div class="scroll"><table>
<thead><tr><th>rule</th><th>jobs</th><th>wall s</th><th>CPU s</th><th>peak MB</th><th></th></tr></thead>
<tbody>
{% for stage in times %}
<tr><td><b>{{ stage.rule }}</b></td><td>{{ stage.jobs }}</td><td>{{ "%.1f" | format(stage.wall_s) }}</td><td>{{ "%.1f" | format(stage.cpu_s) }}</td><td>{{ "%.0f" | format(stage.max_rss_mb) }}</td><td class="barcell"><span class="bar" style="width: {{ "%.1f" | format(stage.share) }}%"></span></td></tr>
{% endfor %}
</tbody></table></div>
{% endif %}
</body>
</html>
"""
)
