"""The report of a calibration."""

from __future__ import annotations

from rigd.analysis.calibration.result import CalibrationResult
from rigd.analysis.report.section import Provenance


def render_calibration(result: CalibrationResult, provenance: Provenance, *, title: str) -> str:
    """Return the report as a self-contained HTML page."""
    # matplotlib takes longer to import than a calibration to evaluate.
    from rigd.analysis.report.calibration_view import build_view
    from rigd.analysis.report.page import fill_template
    from rigd.analysis.report.svg import drawing_style

    with drawing_style():
        view = build_view(result)
    return fill_template("calibration.html.jinja", view, provenance, title)
