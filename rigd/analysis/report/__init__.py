"""From identification results to what a person reads: an HTML report and a parameter table."""

from rigd.analysis.report.render import render_report
from rigd.analysis.report.section import (
    Facts,
    Heading,
    Provenance,
    ReferenceCurve,
    ReportAttachment,
    ReportSection,
)
from rigd.analysis.report.summary import SummaryRow, summary_rows

__all__ = [
    "Facts",
    "Heading",
    "Provenance",
    "ReferenceCurve",
    "ReportAttachment",
    "ReportSection",
    "SummaryRow",
    "render_report",
    "summary_rows",
]
