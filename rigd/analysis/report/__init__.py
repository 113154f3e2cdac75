"""From identification results to what a person reads: an HTML report and a parameter table."""

from rigd.analysis.report.render import render_report
from rigd.analysis.report.section import (
    Attachment,
    Facts,
    Heading,
    Provenance,
    ReferenceCurve,
    ReportSection,
)
from rigd.analysis.report.summary import SummaryRow, summary_rows

__all__ = [
    "Attachment",
    "Facts",
    "Heading",
    "Provenance",
    "ReferenceCurve",
    "ReportSection",
    "SummaryRow",
    "render_report",
    "summary_rows",
]
