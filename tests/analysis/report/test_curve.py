from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.report import ReportSection
from rigd.analysis.report.plots.curve import curves

Maker = Callable[..., ReportSection]


def test_wide_band_does_not_flatten_the_curves(make_section: Maker) -> None:
    section = make_section(trials=1, samples=200)
    curve = section.result.curve
    lost = replace(curve, high=curve.y * np.geomspace(1e6, 1.01, curve.y.size))
    figure = curves([replace(section, result=replace(section.result, curve=lost))], [0])
    low, high = figure.axes[0].get_ylim()
    assert high < 3 * curve.y.max()
    assert low < curve.y.min()


def test_whole_band_is_shown_where_it_is_narrow(make_section: Maker) -> None:
    section = make_section("PVC floor covering", trials=1, samples=200)
    low, high = curves([section], [0]).axes[0].get_ylim()
    assert low < section.result.curve.low.min()
    assert high > section.result.curve.high.max()


def test_reference_is_drawn_over_the_visited_range_only(make_section: Maker) -> None:
    section = make_section(trials=1, samples=200)
    fitted, reference = curves([section], [0]).axes[0].get_lines()
    assert reference.get_label() == "Natural stone: Table I"
    x = np.asarray(reference.get_xdata())
    visited = np.asarray(fitted.get_xdata())
    assert x.min() >= visited.min()
    assert x.max() <= visited.max()
    assert x.size > 50


@pytest.mark.parametrize(("first", "scale"), [(0.001, "log"), (0.05, "linear")])
def test_axis_is_logarithmic_over_decades_only(
    make_section: Maker, first: float, scale: str
) -> None:
    section = make_section(trials=1, samples=200)
    curve = replace(section.result.curve, x=np.geomspace(first, 0.1, 80))
    figure = curves([replace(section, result=replace(section.result, curve=curve))], [0])
    assert figure.axes[0].get_xscale() == scale


@pytest.mark.parametrize(
    ("first", "numbers"),
    [(2e-3, {"0.002", "0.005", "0.01", "0.02", "0.05", "0.1"}), (1e-6, {"1e-05", "0.01", "0.1"})],
)
def test_few_decades_have_numbers_between(
    make_section: Maker, first: float, numbers: set[str]
) -> None:
    section = make_section(trials=1, samples=200)
    curve = replace(section.result.curve, x=np.geomspace(first, 0.1, 80))
    figure = curves([replace(section, result=replace(section.result, curve=curve))], [0])
    figure.canvas.draw()
    axis = figure.axes[0].xaxis
    low, high = figure.axes[0].get_xlim()
    ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
    shown = {text.get_text() for at, text in ticks if low <= at <= high}
    assert numbers <= shown
    assert ("0.05" in shown) == (first > 1e-4)
