"""The report as one HTML file that needs nothing but a browser."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.analysis.report.section import Provenance, ReportSection


def render_report(sections: Sequence[ReportSection], provenance: Provenance, *, title: str) -> str:
    """Return the report on ``sections`` as the text of a self-contained HTML page.

    The page loads nothing and runs no script; it prints, and follows the reader's choice of a
    light or dark screen. The same input gives the same text, byte for byte. Costs about 2.5 s for
    each group of ten trials; matplotlib is imported on the first call.

    Args:
        sections: one per group (such as a floor), in the order to show them.
        provenance: where the data come from; shown as given.
        title: heading of the page.

    Raises:
        ValueError: no sections, or two with the same label.

    """
    _check(sections)
    # Here, so that a command that only names this module does not wait for matplotlib.
    from rigd.analysis.report.page import fill_template
    from rigd.analysis.report.svg import drawing_style
    from rigd.analysis.report.view import build_view

    with drawing_style():
        view = build_view(sections)
    return fill_template("report.html.jinja", view, provenance, title)


def _check(sections: Sequence[ReportSection]) -> None:
    if not sections:
        raise ValueError("a report needs at least one section")
    labels = [section.label for section in sections]
    double = sorted({label for label in labels if labels.count(label) > 1})
    if double:
        raise ValueError(f"sections of a report need labels of their own; twice: {double}")
