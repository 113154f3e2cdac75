"""Makes an HTML report and a parameter table from the results of an identification."""

from rigd.analysis.report.section import (
    Facts,
    Heading,
    Opening,
    Provenance,
    ReferenceCurve,
    ReportAttachment,
    ReportSection,
)
from rigd.analysis.report.tables.summary import SummaryRow, summary_rows

__all__ = [
    "Facts",
    "Heading",
    "Opening",
    "Provenance",
    "ReferenceCurve",
    "ReportAttachment",
    "ReportSection",
    "SummaryRow",
    "summary_rows",
]
