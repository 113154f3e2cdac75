"""Writes a layout of Foxglove: JSON, with its panels by an identifier and a tree of splits.

The keys are those that the app exports and imports, and that of the panels those of
https://docs.foxglove.dev/docs/visualization/panels (Plot, State Transitions, Tab).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Final

from rigd.model.channels import ECHO
from rigd.record.layout.plots import Plot, Tab
from rigd.record.mcap.schema import TRIAL_TOPIC

#: Of the height of the window, in percent: the bars of trials and steps.
BARS_PERCENT: Final = 16
_TIME: Final = {"enabled": True, "timestampMethod": "receiveTime"}

Json = dict[str, Any]


def text(tabs: Sequence[Tab]) -> str:
    """Return the layout: trials and steps as bars, below them the tabs."""
    bars = {
        "paths": [
            {"value": f"{TRIAL_TOPIC}.number", "label": "trial", **_TIME},
            {"value": f"{TRIAL_TOPIC}.step_name", "label": "step", **_TIME},
        ],
        "isSynced": True,
        "foxglovePanelTitle": "trial and step",
    }
    panels: Json = {"StateTransitions!trial": bars}
    shown: list[Json] = []
    for tab in tabs:
        names = [f"Plot!{tab.title}_{number}" for number in range(len(tab.plots))]
        panels |= dict(zip(names, map(_panel, tab.plots), strict=True))
        shown.append({"title": tab.title, "layout": _column(names)})
    panels["Tab!streams"] = {"activeTabIdx": 0, "tabs": shown}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "first": "StateTransitions!trial",
            "second": "Tab!streams",
            "direction": "column",
            "splitPercentage": BARS_PERCENT,
        },
    }
    return json.dumps(layout, indent=2, ensure_ascii=False) + "\n"


def _panel(plot: Plot) -> Json:
    return {
        "paths": [
            {
                "value": f"/{plot.stream}.{name}",
                "label": name,
                **({"lineStyle": "dashed"} if name.endswith(ECHO) else {}),
                **_TIME,
            }
            for name in plot.fields
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "foxglovePanelTitle": plot.title,
    }


def _column(names: Sequence[str]) -> Json | str:
    """Return a tree of splits in which all panels have the same height."""
    first, *others = names
    if not others:
        return first
    return {
        "first": first,
        "second": _column(others),
        "direction": "column",
        "splitPercentage": 100 / len(names),
    }
