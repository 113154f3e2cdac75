"""The ways of bodies in the plane: their scale, what was not seen, and how far the fit is off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.report import ReportSection
from rigd.analysis.report.plots.tracks import bends, furthest, tracks
from rigd.analysis.report.view import build_view
from rigd.analysis.result import Track

Maker = Callable[..., ReportSection]


def circle(radius: float, off: float = 0.0) -> Track:
    angle = np.linspace(0.0, 2 * math.pi, 400)
    fitted = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    measured = fitted + np.array([off, 0.0])
    measured[100:120] = np.nan
    return Track("the front marker", measured, fitted)


def test_both_axes_have_one_scale_and_leave_gaps() -> None:
    figure = tracks([("wide", circle(1.0)), ("small", circle(0.2))])
    figure.draw_without_rendering()
    for ax in figure.axes:
        box = ax.get_window_extent()
        (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
        assert box.width / (x1 - x0) == pytest.approx(box.height / (y1 - y0), rel=1e-6)
    measured = np.asarray(figure.axes[0].lines[0].get_xdata())
    assert np.isnan(measured).sum() == 20


def test_straight_way_is_none_that_bends() -> None:
    along = np.column_stack([np.linspace(0.0, 2.0, 50), np.linspace(0.0, 0.05, 50)])
    assert bends(circle(1.0))
    assert not bends(Track("the front marker", along, along))


def test_largest_distance_is_that_of_places_seen() -> None:
    assert furthest([circle(1.0, 0.002), circle(0.2, 0.005)]) == pytest.approx(0.005)


def test_report_shows_only_ways_in_the_plane(make_section: Maker) -> None:
    section = make_section(trials=1, samples=200)
    (chapter,) = build_view([section]).chapters
    assert chapter.tracks is None
    (trial,) = section.result.trials
    moved = replace(trial, track=circle(0.5, 0.003))
    section = replace(section, result=replace(section.result, trials=(moved,)))
    (chapter,) = build_view([section]).chapters
    assert chapter.tracks is not None
    assert "up to 3.0 mm apart" in chapter.tracks.alt
