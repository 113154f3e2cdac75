from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection

from rigd.analysis.report import ReportSection
from rigd.analysis.report.plots.axes import grid
from rigd.analysis.report.plots.curve import curves
from rigd.analysis.result import Seen

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


def test_binned_data_lie_below_curve_and_band(make_section: Maker) -> None:
    section = make_section(trials=1, samples=200)
    curve = section.result.curve
    points = zip(curve.x, curve.y, strict=True)
    seen = tuple(Seen(float(x), float(y), 0.9 * y, 1.1 * y, 50) for x, y in points)
    with_data = replace(section.result, curve=replace(curve, seen=seen))
    ax = curves([replace(section, result=with_data)], [0]).axes[0]
    fitted = next(line for line in ax.get_lines() if line.get_label() == section.label)
    dots = next(line for line in ax.get_lines() if line.get_marker() == "o")
    bars = next(item for item in ax.collections if isinstance(item, LineCollection))
    band = next(item for item in ax.collections if isinstance(item, PolyCollection))
    assert dots.get_zorder() < fitted.get_zorder()
    assert ax.get_children().index(bars) < ax.get_children().index(band)
    assert bars.get_zorder() <= band.get_zorder()


@pytest.mark.parametrize("most", [7.0, 27.0, 430.0])
def test_ticks_stand_at_one_two_and_five(most: float) -> None:
    _, (ax,) = grid(1, 1, 5.0, 3.0)
    ax.plot([0.0, most], [0.0, 0.3 * most])
    for axis in (ax.xaxis, ax.yaxis):
        step = float(np.diff(axis.get_majorticklocs())[0])
        first_digit = float(f"{step:.3e}".partition("e")[0])
        assert first_digit in (1.0, 2.0, 5.0)
