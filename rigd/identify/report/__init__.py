"""From identification results to what a person reads: an HTML report and a parameter table."""

from rigd.identify.report.render import render_report
from rigd.identify.report.section import (
    Attachment,
    Facts,
    Heading,
    Provenance,
    ReferenceCurve,
    ReportSection,
)
from rigd.identify.report.summary import SummaryRow, summary_rows

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
