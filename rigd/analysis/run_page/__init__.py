"""What a recording shows by itself: the report of a run, with or without an identification."""

from rigd.analysis.run_page.report import Selection, parse_selection, run_report

__all__ = ["Selection", "parse_selection", "run_report"]
