"""The report as one HTML file that needs nothing but a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigd.identify.report.section import Provenance, ReportSection

_TEMPLATES = Path(__file__).parent / "templates"


def render_report(sections: Sequence[ReportSection], provenance: Provenance, *, title: str) -> str:
    """Return the report on ``sections`` as the text of a self-contained HTML page.

    The page loads nothing and runs no script; it prints, and follows the reader's choice of a
    light or dark screen. The same input gives the same text, byte for byte. Costs about 2 s for
    each group of ten trials; matplotlib is imported on the first call.

    Args:
        sections: one per group (such as a floor), in the order to show them.
        provenance: where the data come from; shown as given.
        title: heading of the page.

    Raises:
        ValueError: no sections, or two with the same label.

    """
    _check(sections)
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    from rigd.identify.report.palette import style_sheet_variables
    from rigd.identify.report.plots.axes import unit_text, words
    from rigd.identify.report.svg import drawing_style
    from rigd.identify.report.view import build_view

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(unit=unit_text, words=words)
    style = (_TEMPLATES / "report.css").read_text(encoding="utf-8")
    with drawing_style():
        view = build_view(sections)
    return environment.get_template("report.html.jinja").render(
        title=title,
        view=view,
        provenance=provenance,
        style=Markup(style_sheet_variables() + style),
    )


def _check(sections: Sequence[ReportSection]) -> None:
    if not sections:
        raise ValueError("a report needs at least one section")
    labels = [section.label for section in sections]
    double = sorted({label for label in labels if labels.count(label) > 1})
    if double:
        raise ValueError(f"sections of a report need labels of their own; twice: {double}")
