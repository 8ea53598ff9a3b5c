"""Pages as one self-contained HTML file each, without scripts: the templates beside this module, filled in."""

from __future__ import annotations

from pathlib import Path

import jinja2

from gsbridge.files import atomic_file

TEMPLATES = Path(__file__).parent / "templates"
"""`base.html.j2` is the frame of all pages, `finding.html.j2` that of pages which tell one finding."""


def render(template: str, **content: object) -> str:
    """Fill in a template, and return the text of the page.

    Args:
        template: Name of a file in `TEMPLATES`.
        **content: Every name that the template asks for; text is escaped.

    Raises:
        jinja2.UndefinedError: The template asks for a name that `content` lacks.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**content)


def write_page(out: str | Path, template: str, **content: object) -> None:
    """Write a page, whole or not at all.

    Args:
        out: File to write.
        template: Name of a file in `TEMPLATES`.
        **content: Every name that the template asks for; text is escaped.
    """
    text = render(template, **content)
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
