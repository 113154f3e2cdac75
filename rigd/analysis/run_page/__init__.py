"""Makes the report of a run from its recording alone, with or without an identification."""

from rigd.analysis.run_page.report import Selection, parse_selection, run_report

__all__ = ["Selection", "parse_selection", "run_report"]
