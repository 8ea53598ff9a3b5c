"""Template of the benchmark's page (jinja2): one self-contained HTML file, no script."""

# ruff: noqa: E501  (markup)

from gsbridge.report.gap.template import GAP_STYLE
from gsbridge.report.pages.style import STYLE

BENCHMARK_PAGE = (
    """\
{% macro outcomes(title, rows) %}
<div class="scroll"><table>
<thead><tr><th>{{ title }}</th><th>cases</th><th>right</th><th>covered</th><th>abstained</th><th>missed</th><th>wrong</th><th>quiet</th><th>false alarm</th></tr></thead>
<tbody>
{% for row in rows %}<tr><td><b>{{ row.title }}</b></td><td>{{ row.n }}</td>{% for count in row.outcomes %}<td>{{ count }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
{% endmacro %}
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>gsbridge: blind benchmark of the gap</title>
<style>
"""
    + STYLE
    + GAP_STYLE
    + """
body { max-width: 80rem; }
details { margin: 1rem 0; }
summary { cursor: pointer; color: var(--accent); }
.label.met { color: var(--good); }
.label.unmet { color: var(--warn); background: #fdf5ea; }
</style>
</head>
<body>
<header>
<h1>Blind benchmark: naming what a simulation lacks</h1>
{% for sentence in headline %}<p class="lede">{{ sentence }}</p>
{% endfor %}
<p class="note">Effects are hidden in another engine or another formulation than the diagnosis knows, sealed by their hash before it begins, and opened for scoring alone. One unit is the size at which the effect's noise-free signature just stands out (χ² = 25). Brackets are Wilson's 95 % intervals. Split: {{ splits | join(", ") }}{% if splits != ["scored"] %}: <b>not the one that counts</b>{% endif %}. Preset: {{ preset }}.</p>
<nav><a href="#floors">Floors</a><a href="#sizes">By size</a>{% for tier in tiers %}<a href="#{{ tier.id }}">{{ tier.title }}</a>{% endfor %}<a href="#calibration">Calibration</a><a href="#wrong">What went wrong</a></nav>
</header>
<h2 id="floors">Floors</h2>
<div class="scroll"><table>
<thead><tr><th>what</th><th>floor</th><th>measured</th><th>95 %</th><th>cases</th><th class="text"></th></tr></thead>
<tbody>
{% for row in floors %}<tr><td class="text">{{ row.what }}</td><td>{{ row.floor }}</td><td>{{ row.value }}</td><td>{{ row.interval }}</td><td>{{ row.n }}</td><td class="text"><span class="label {{ row.met }}">{{ row.met }}</span> {{ row.why }}</td></tr>
{% endfor %}</tbody></table></div>
<h2 id="sizes">By size of what is hidden</h2>
<figure class="picture"><img src="{{ sizes }}" alt="outcomes by size"><figcaption>Single effects of the catalogue. Whiskers: interval of the rate of right names.</figcaption></figure>
{% for tier in tiers %}
<h2 id="{{ tier.id }}">{{ tier.title }}</h2>
<p>{{ tier.cases }} cases.</p>
<div class="scroll"><table>
<thead><tr><th>way of naming</th><th>right, ≥ 5 units</th><th>wrong</th><th>false alarms</th><th>unknown recognised</th><th>F1 of sets</th><th>closure</th><th>simulations</th><th>seconds</th></tr></thead>
<tbody>
{% for row in tier.methods %}<tr><td>{% if loop.first %}<b>{{ row.name }}</b>{% else %}{{ row.name }}{% endif %}</td><td>{{ row.right }}</td><td>{{ row.wrong }}</td><td>{{ row.alarm }}</td><td>{{ row.unknown }}</td><td>{{ row.f1 }}</td><td>{{ row.closure }}</td><td>{{ row.simulations }}</td><td>{{ row.seconds }}</td></tr>
{% endfor %}</tbody></table></div>
<p class="note">Closure, simulations after the bank (of photos: sets of drawn pictures), and seconds: medians.{% if tier.left_out %} Not run: {{ tier.left_out }}.{% endif %}</p>
{% if tier.race %}<figure class="picture"><img src="{{ tier.race }}" alt="right against wrong names" style="width: 38rem"><figcaption>The upper left corner is best: many right names, no wrong ones.</figcaption></figure>{% endif %}
<figure class="picture"><img src="{{ tier.confusion }}" alt="confusion matrix" style="width: {{ tier.confusion_rem }}rem"><figcaption>Cases by what was hidden and what was answered, all sizes, without joints. Red: a wrong name or joint.</figcaption></figure>
{{ outcomes("kind of case", tier.kinds) }}
<details><summary>Every effect</summary>
{{ outcomes("effect", tier.effects) }}
</details>
{% endfor %}
<h2 id="calibration">Are the stated probabilities true?</h2>
<figure class="picture"><img src="{{ calibration }}" alt="calibration of probabilities" style="width: 29rem"><figcaption>Of the explanations said to be best with some probability, the share that is the hidden one. Good lies on the dashed line. Brier scores: {{ brier }}.</figcaption></figure>
<h2 id="wrong">What went wrong</h2>
{% if wrong %}<div class="scroll"><table>
<thead><tr><th>case</th><th class="text">tier</th><th class="text">kind</th><th class="text">hidden</th><th>units</th><th class="text">answered</th></tr></thead>
<tbody>
{% for row in wrong %}<tr><td><b>{{ row.key }}</b></td><td class="text">{{ row.tier }}</td><td class="text">{{ row.kind }}</td><td class="text">{{ row.hidden }}</td><td>{{ row.units }}</td><td class="text">{{ row.answer }}</td></tr>
{% endfor %}</tbody></table></div>
{% else %}<p>No wrong name, and no alarm without a reason.</p>{% endif %}
<p class="note">For machines: <code>scores.json</code> of each tier beside this page.</p>
</body>
</html>
"""
)
