"""Every figure of a report is written as SVG, PDF and CSV, with all that is drawn."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import Provenance, ReportSection
from rigd.analysis.report.files import saving_figures
from rigd.analysis.report.plots.axes import grid
from rigd.analysis.report.svg import draw, drawing_style


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def section(make_section: Callable[..., ReportSection]) -> ReportSection:
    return make_section(trials=1, samples=900)


@pytest.fixture(scope="module")
def saved(section: ReportSection, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder of the figures of a report on one trial, and its page."""
    folder = tmp_path_factory.mktemp("figures")
    with saving_figures(folder):
        return folder, ParameterEvaluation("t", (section,), (), Provenance()).report()


def test_every_figure_of_a_report_has_three_files(
    section: ReportSection, saved: tuple[Path, str]
) -> None:
    folder, page = saved
    names = [row["figure"] for row in table(folder / "index.csv")]
    assert len(names) == page.count("<svg")
    for name in names:
        assert (folder / f"{name}.svg").read_text().startswith("<?xml")
        assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    again = ParameterEvaluation("t", (section,), (), Provenance()).report()
    assert again.count("<svg") == len(names)
    assert len(again) < 0.95 * len(page)  # nothing is left over: its traces are thinned again


def test_data_of_a_trial_are_whole(section: ReportSection, saved: tuple[Path, str]) -> None:
    (trial,) = section.result.trials
    rows = [row for row in table(saved[0] / "s1-t1.csv") if row["series"] == "measured"]
    assert rows[0]["x_axis"] == "time [s]"
    assert rows[0]["y_axis"] == "traction force [N]"
    np.testing.assert_array_equal([float(row["x"]) for row in rows], trial.t_s)
    np.testing.assert_array_equal([float(row["y"]) for row in rows], trial.measured)


def test_curve_has_its_band_in_the_table(section: ReportSection, saved: tuple[Path, str]) -> None:
    rows = table(saved[0] / "curve-1.csv")
    fitted = [row for row in rows if row["series"] == section.label]
    np.testing.assert_allclose([float(row["y"]) for row in fitted], section.result.curve.y)
    band = [row for row in rows if row["series"].startswith("band")]
    np.testing.assert_allclose([float(row["low"]) for row in band], section.result.curve.low)
    np.testing.assert_allclose([float(row["high"]) for row in band], section.result.curve.high)


def test_bars_and_histogram_are_written(tmp_path: Path) -> None:
    with drawing_style(), saving_figures(tmp_path):
        figure, (left, right) = grid(1, 2, 6.0, 3.0)
        left.errorbar([1.0, 2.0], [3.0, 4.0], yerr=[[0.5, 1.0], [1.0, 2.0]], linestyle="none")
        left.axhline(0.0)
        right.stairs([5.0, 6.0], [0.0, 1.0, 3.0])
        draw(figure, "both", "two axes")
    rows = [tuple(row[name] for name in ("x", "y", "low", "high")) for row in
            table(tmp_path / "both.csv")]  # fmt: skip
    assert rows == [
        ("1.0", "3.0", "2.5", "4.0"), ("2.0", "4.0", "3.0", "6.0"),
        ("0.5", "5.0", "0.0", "1.0"), ("2.0", "6.0", "1.0", "3.0"),
    ]  # fmt: skip


def test_histogram_that_lies_keeps_its_axes(tmp_path: Path) -> None:
    with drawing_style(), saving_figures(tmp_path):
        figure, (axes, _) = grid(1, 2, 6.0, 3.0)
        axes.stairs([5.0, 6.0], [0.0, 1.0, 3.0], orientation="horizontal")
        draw(figure, "side", "counts along x")
    rows = [tuple(row[name] for name in ("x", "y", "low", "high")) for row in
            table(tmp_path / "side.csv")]  # fmt: skip
    assert rows == [("5.0", "0.5", "0.0", "1.0"), ("6.0", "2.0", "1.0", "3.0")]


def test_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(OSError, match="exists"), saving_figures(tmp_path / "taken"):
        pass
