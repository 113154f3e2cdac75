"""Renders the HTML page of a report from templates and a style sheet, with their filters.

Importing this module imports matplotlib.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from rigd.analysis.report.palette import style_sheet_variables
from rigd.analysis.report.plots.axes import unit_text, words
from rigd.analysis.report.rounding import number, probability
from rigd.analysis.report.section import Opening, Provenance
from rigd.analysis.report.svg import drawing_style
from rigd.model.about import visible

_TEMPLATES: Final = Path(__file__).parent / "templates"
_SUBSCRIPT: Final = re.compile(r"_(\w+)")


def render(
    template: str,
    build: Callable[[], object],
    provenance: Provenance,
    title: str,
    folder: Path | None = None,
    opening: Opening | None = None,
) -> str:
    """Return the self-contained HTML page that ``template`` makes of the view that ``build`` makes.

    ``build`` is called with the report's settings of matplotlib. ``folder`` has the templates of an
    analysis, which may use the shared ones; ``opening`` stands right below the title. The page
    loads nothing and runs no script; it prints, and follows the reader's choice of a light or dark
    screen. The same input gives the same text, byte for byte; every text of the user's is escaped.
    """
    with drawing_style():
        view = build()
    environment = Environment(
        loader=FileSystemLoader([_TEMPLATES] if folder is None else [folder, _TEMPLATES]),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        unit=unit_text,
        words=words,
        subscripts=subscripts,
        number=number,
        probability=probability,
        quoted=quote,
    )
    # The style sheet is ours and holds quotation marks: it must not be escaped.
    style = (_TEMPLATES / "report.css").read_text(encoding="utf-8")
    return environment.get_template(template).render(
        title=title,
        view=view,
        provenance=provenance,
        opening=opening,
        style=Markup(style_sheet_variables() + style),
    )


def _visible(value: object) -> object:
    """Return what stands on the page for a value: a text turns no line, from any author."""
    return visible(value) if type(value) is str else value


def subscripts(symbol: str) -> Markup:
    """Return a symbol such as ``σ_1 + σ_2`` with what follows an underscore set low."""
    return Markup(_SUBSCRIPT.sub(r"<sub>\1</sub>", str(escape(symbol))))
