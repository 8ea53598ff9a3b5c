"""Template of a gap report (jinja2): one self-contained HTML file, no script."""

# ruff: noqa: E501  (markup)

from gsbridge.report.pages.style import STYLE

GAP_STYLE = """
body { max-width: 66rem; }
.verdict { display: inline-block; border-radius: 1em; padding: .1em .9em; font-weight: 600; font-size: .95rem; color: white; }
.verdict.good { background: var(--good); }
.verdict.warn { background: var(--warn); }
.sentence { font-size: 1.45rem; line-height: 1.4; max-width: 60rem; margin: 1rem 0 1.2rem; letter-spacing: -.01em; }
.numbers { display: flex; flex-wrap: wrap; gap: .8rem; margin: 0 0 1.2rem; padding: 0; }
.numbers div { background: white; border: 1px solid var(--line); border-radius: 8px; padding: .7rem 1.1rem; min-width: 9.5rem; }
.numbers b { display: block; font-size: 1.7rem; line-height: 1.2; font-variant-numeric: tabular-nums; }
.numbers b.before { color: #c2660c; }
.numbers b.after { color: var(--accent); }
.numbers span { color: var(--soft); font-size: .86rem; }
.next { background: #eef5f7; border-left: 4px solid var(--accent); border-radius: 0 6px 6px 0; padding: .8rem 1.2rem; max-width: 60rem; }
.next p { margin: .25rem 0; }
.degraded-box { background: #fdf5ea; border-left: 4px solid var(--warn); border-radius: 0 6px 6px 0; padding: .8rem 1.2rem; max-width: 60rem; margin: 1rem 0; }
.degraded-box p { margin: .25rem 0; }
code { font-size: .88em; overflow-wrap: anywhere; }
.scroll { margin-top: .6rem; }
td.text, th.text { text-align: left; white-space: normal; }
td.barcell { min-width: 9rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.2rem; font-size: .9rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }
"""


def gap_page(title: str, lead: str, body: str) -> str:
    """Template of a page that tells a finding: its sentence and what to do next come first.

    Args:
        title: Of the page.
        lead: Line above the verdict.
        body: What follows, down to the end of the page.
    """
    return f"""\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{STYLE}{GAP_STYLE}</style>
</head>
<body>
<header>
<p class="note">{lead}</p>
{_HEADER}</header>
{body}"""


_HEADER = """\
<span class="verdict {{ tone }}">{{ verdict }}</span>{% if remaining %} <span class="verdict warn">something remains</span>{% endif %}{% if reasons %} <span class="verdict warn">degraded</span>{% endif %}
<p class="sentence">{{ sentence }}</p>
<div class="numbers">
{% for item in numbers %}<div><b class="{{ item.tone }}">{{ item.value }}</b><span>{{ item.label }}</span></div>
{% endfor %}</div>
<div class="next"><p><b>What to do next</b></p>
{% for step in steps %}<p>{{ step }}</p>
{% endfor %}</div>
{% if reasons %}<div class="degraded-box"><p><b>Degraded</b>: the result holds with reserve.</p>
{% for reason in reasons %}<p>{{ reason }}</p>
{% endfor %}</div>{% endif %}
"""

GAP_PAGE = gap_page(
    "gsbridge: the gap of {{ case }}",
    "The gap of <b>{{ case }}</b>: what its simulation lacks",
    """\
<h2 id="residuals">Before and after</h2>
<p>{{ residuals_text }}</p>
<figure class="picture"><img src="{{ residuals }}" alt="{{ residuals_alt }}"></figure>
<figure class="picture"><img src="{{ channels }}" alt="{{ channels_alt }}"><figcaption>{{ channels_text }}</figcaption></figure>
{% if effects %}
<h2 id="found">{{ found_title }}</h2>
<div class="scroll"><table>
<thead><tr><th>effect</th><th class="text">where</th><th class="text">parameter</th><th>value</th><th>90 % interval</th><th class="text">unit</th>{% if becomes %}<th>the model's own</th>{% endif %}</tr></thead>
<tbody>
{% for row in effects %}<tr><td><b>{{ row.title }}</b></td><td class="text">{{ row.joint }}</td><td class="text">{{ row.parameter }}</td><td>{{ row.value }}</td><td>{{ row.interval }}</td><td class="text">{{ row.unit }}</td>{% if becomes %}<td><b>{{ row.becomes }}</b></td>{% endif %}</tr>
{% endfor %}</tbody></table></div>
{% for note in effect_notes %}<p class="note">{{ note }}</p>
{% endfor %}
{% endif %}
<h2 id="where">Where it shows</h2>
<p>{{ where_text }}</p>
<figure class="picture"><img src="{{ where }}" alt="map of the residuals by channel, phase and state"><figcaption>{{ where_caption }}</figcaption></figure>
{% if rivals %}
<h2 id="rivals">The rivals</h2>
<p>{{ rivals_text }}</p>
<div class="scroll"><table>
<thead><tr><th>explanation</th><th class="text">share of the gap closed</th><th></th><th>behind the best</th><th>probability</th></tr></thead>
<tbody>
{% for row in rivals %}<tr><td class="text">{% if loop.first %}<b>{{ row.title }}</b>{% else %}{{ row.title }}{% endif %}</td><td class="barcell"><span class="bar" style="width: {{ row.share }}%"></span></td><td>{{ row.closure }}</td><td>{{ row.behind }}</td><td>{{ row.probability }}</td></tr>
{% endfor %}</tbody></table></div>
<p class="note">{{ rivals_note }}</p>
{% endif %}
<h2 id="remains">What remains</h2>
<p>{{ remains_text }}</p>
{% if alike %}
<p class="note">{{ alike }}</p>
{% endif %}
{% if unseen %}
<p class="note">Could not show in these {{ logs }} at any sensible size: {{ unseen }}.</p>
{% endif %}
<h2 id="noise">Noise floor and {{ logs }}</h2>
<div class="scroll"><table>
<thead><tr><th>channel</th><th>noise of one sample</th><th class="text">unit</th>{% for role in roles %}<th>gap in {{ role }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in noise %}<tr><td>{{ row.channel }}</td><td>{{ row.sigma }}</td><td class="text">{{ row.unit }}</td>{% for value in row.gaps %}<td>{{ value }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
<p class="note">{{ noise_note }}</p>
<div class="scroll"><table>
<thead><tr><th>record</th><th class="text">role</th><th>seconds</th><th>samples</th><th>rate, Hz</th><th class="text">channels</th><th class="text">SHA-256</th></tr></thead>
<tbody>
{% for row in records %}<tr><td>{{ row.name }}</td><td class="text">{{ row.role }}</td><td>{{ row.seconds }}</td><td>{{ row.samples }}</td><td>{{ row.rate }}</td><td class="text">{{ row.channels }}</td><td class="text"><code title="{{ row.digest }}">{{ row.digest[:16] }}…</code></td></tr>
{% endfor %}</tbody></table></div>
<h2 id="provenance">Provenance</h2>
<dl>
{% for name, value in provenance %}<dt>{{ name }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl>
<p class="note">For machines: <code>findings.json</code>, <code>comparison.json</code>, <code>screen.json</code> and <code>replays.json</code> beside this page. In motion: <code>results/rerun/gap/{{ case }}.rrd</code>, open with <code>rerun</code>.</p>
</body>
</html>
""",
)
