"""The report on a campaign of the approach-angle rig: one HTML page that needs only a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rigd.analysis.report.section import Provenance
from rigd_analyses.approach_angle.result import CampaignResult

_TEMPLATES: Final = Path(__file__).parent / "templates"


def render_campaign(
    result: CampaignResult, provenance: Provenance, *, title: str, calibrations: Sequence[str] = ()
) -> str:
    """Return the report on ``result`` as the text of a self-contained HTML page.

    The page loads nothing and runs no script; it prints, and follows the reader's choice of a
    light or dark screen. The same input gives the same text. Costs about 4 s for five sets;
    matplotlib is imported on the first call.

    Args:
        result: what the analysis of the campaign found.
        provenance: where the data come from; shown as given.
        title: heading of the page.
        calibrations: which were used for which recordings, and what they changed, a line each.
    """
    # Here, so that a command that only names this module does not wait for matplotlib.
    from rigd.analysis.report.page import fill_template
    from rigd.analysis.report.svg import drawing_style
    from rigd_analyses.approach_angle.report.view import build_campaign_view

    with drawing_style():
        view = build_campaign_view(result, calibrations)
    return fill_template("campaign.html.jinja", view, provenance, title, _TEMPLATES)
