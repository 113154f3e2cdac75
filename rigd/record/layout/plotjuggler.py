"""Writes a layout of PlotJuggler 3: XML, with tabs of plots one above the other.

Elements and attributes are those that PlotJuggler saves and loads (``PlotDocker``, ``PlotWidget``
and ``TabbedPlotWidget`` of https://github.com/facontidavide/PlotJuggler). There are no color maps:
PlotJuggler 3 ends without a message if a layout has one that its user does not have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rigd.record.layout.plots import Plot, Tab
from rigd.record.mcap.schema import TRIAL_TOPIC

#: Of the height of a tab: the plot of trial and step.
TRIAL_SHARE: Final = 0.16
#: Colors that stay apart for most people (Okabe and Ito 2008), used in turn.
COLORS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


def text(tabs: Sequence[Tab]) -> str:
    """Return the layout: in each tab first the trial and the step, then its plots."""
    root = Element("root")
    window = SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for tab in tabs:
        container = SubElement(
            SubElement(window, "Tab", tab_name=tab.title, containers="1"), "Container"
        )
        shares = [TRIAL_SHARE, *[(1 - TRIAL_SHARE) / len(tab.plots)] * len(tab.plots)]
        sizes = ";".join(f"{share:.6f}" for share in shares)
        column = SubElement(
            container, "DockSplitter", orientation="-", count=str(len(shares)), sizes=sizes
        )
        marks = (f"{TRIAL_TOPIC}/number", f"{TRIAL_TOPIC}/step")
        _area(column, "trial and step", marks, "Steps")
        for plot in tab.plots:
            _area(column, plot.title, _curves(plot), "Lines")
    SubElement(window, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    indent(root)
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{tostring(root, encoding='unicode')}\n"


def _curves(plot: Plot) -> Sequence[str]:
    return [f"/{plot.stream}/{name}" for name in plot.fields]


def _area(column: Element, title: str, curves: Sequence[str], style: str) -> None:
    area = SubElement(column, "DockArea", name=title)
    plot = SubElement(
        area,
        "plot",
        style=style,
        mode="TimeSeries",
        flip_x="false",
        flip_y="false",
        line_width="1.0",
    )
    for number, name in enumerate(curves):
        SubElement(plot, "curve", name=name, color=COLORS[number % len(COLORS)])
