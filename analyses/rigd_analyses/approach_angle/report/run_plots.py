"""Plots one run as in Figs. 6 to 10 of the paper, beside results of the corrected method."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, INK, MEASURED, series
from rigd.analysis.report.plots.axes import grid, label, shade_unused
from rigd.analysis.report.trace import thin
from rigd_analyses.approach_angle.paper.result import PaperCurves, PaperRun
from rigd_analyses.approach_angle.report.marks import Mark, dots
from rigd_analyses.approach_angle.run_result import RunResult

SLIDES = Mark("o", True, "sliding: limit")
ROLLS = Mark("o", False, "not sliding: demand")


def one_run(run: RunResult) -> Figure | None:
    """Return gauges, torque, positions, speeds and friction over time; None without curves."""
    curves = run.paper.curves
    if curves is None:
        return None
    figure, axes = grid(3, 2, 11.0, 7.4)
    _gauges(axes[0], curves)
    _torque(axes[1], run.paper, curves)
    _positions(axes[2], curves)
    _speeds(axes[3], run, curves)
    _blocks(axes[4], run)
    _smoothed_speeds(axes[5], run)
    for ax in axes[:-1]:
        ax.set_xlim(float(curves.t_s[0]), float(curves.t_s[-1]))
    return figure


def _gauges(ax: Axes, curves: PaperCurves) -> None:
    """Draw Fig. 6: both gauges, and the low harmonics fitted to them."""
    for raw, name in ((curves.gauge_a_v, "recorded"), (curves.gauge_b_v, None)):
        ax.plot(*thin(curves.t_s, raw), color=MEASURED, linewidth=0.6, label=name)
    for fitted, index, name in ((curves.fourier_a_v, 0, "a"), (curves.fourier_b_v, 1, "b")):
        colour = series(index)
        ax.plot(*thin(curves.t_s, fitted), color=colour, linewidth=1.4, label=f"Fourier, {name}")
    label(ax, "time", "s", "gauge signal", "V")
    ax.legend(loc="best", ncols=3)
    ax.set_title("Gauges and Fourier fit (Fig. 6)")


def _torque(ax: Axes, paper: PaperRun, curves: PaperCurves) -> None:
    """Draw Figs. 7 and 8: torque, Gaussian at its peak, and the steady segment."""
    ax.plot(*thin(curves.t_s, curves.torque_nm), color=series(0), label="torque")
    ax.plot(curves.gaussian_t_s, curves.gaussian_nm, color=FITTED, linewidth=1.6, label="Gaussian")
    if np.isfinite(paper.t_steady_s):
        _steady(ax, paper.t_steady_s)
    if np.isfinite(paper.torque_nm) and np.isfinite(paper.t_steady_s):
        ends = [paper.t_steady_s, float(curves.t_s[-1])]
        mean = f"steady mean {paper.torque_nm:.3f} N m"
        ax.plot(ends, [paper.torque_nm] * 2, color=INK, linewidth=1.4, label=mean)
    label(ax, "time", "s", "torque", "N m")
    ax.legend(loc="best")
    ax.set_title("Torque, Gaussian, steady segment (Figs. 7 and 8)")


def _positions(ax: Axes, curves: PaperCurves) -> None:
    """Draw Fig. 9: positions as recorded and smoothed, from their begin."""
    begin = curves.t_s <= curves.t_s[0] + 0.005
    for raw, smooth, index, name in (
        (curves.platform_raw_m, curves.platform_m, 0, "platform x"),
        (curves.rim_raw_m, curves.rim_m, 1, "wheel φ R"),
    ):
        zero = float(np.median(raw[begin]))
        recorded = "recorded" if index == 0 else None
        ax.plot(*thin(curves.t_s, raw - zero), color=MEASURED, linewidth=0.8, label=recorded)
        drawn = thin(curves.position_t_s, smooth - zero)
        ax.plot(*drawn, color=series(index), linewidth=1.4, label=name)
    label(ax, "time", "s", "travel", "m")
    ax.legend(loc="best")
    ax.set_title("Positions, smoothed (Fig. 9)")


def _speeds(ax: Axes, run: RunResult, curves: PaperCurves) -> None:
    """Draw Fig. 10: speeds by central differences, smoothed."""
    times = curves.speed_t_s
    ax.plot(*thin(times, curves.platform_speed_m_s), color=series(0), label="platform V")
    ax.plot(*thin(times, curves.rim_speed_m_s), color=series(1), label="rim ω R")
    rolls = curves.platform_speed_m_s * np.cos(run.run.alpha_rad)
    if run.run.alpha_rad:
        name = "V cos α: rim without slip"
        ax.plot(*thin(times, rolls), color=series(0), linestyle=(0, (3, 2)), label=name)
    if np.isfinite(run.paper.t_steady_s):
        _steady(ax, run.paper.t_steady_s)
    label(ax, "time", "s", "speed", "m/s")
    ax.legend(loc="best")
    ax.set_title("Speeds (Fig. 10)")


def _blocks(ax: Axes, run: RunResult) -> None:
    """Draw F_r/N by blocks, full if the wheel slides, beside the paper's one number."""
    blocks = run.better.blocks
    sliding = blocks.sliding
    colour = series(2)
    for mark, chosen in ((SLIDES, sliding), (ROLLS, ~sliding)):
        dots(ax, blocks.t_s[chosen], blocks.mu[chosen], colour, mark, size=3.5, label=mark.label)
    if np.isfinite(run.better.mu):
        ax.axhline(run.better.mu, color=colour, linewidth=1.2)
    if np.isfinite(run.paper.mu):
        dashed = (0, (4, 2))
        ax.axhline(run.paper.mu, color=FITTED, linestyle=dashed, label="paper's T/(R N)")
    label(ax, "time", "s", "F_r/N", "1")
    _legend_above(ax)
    ax.set_title("Friction by blocks (corrected method)")


def _smoothed_speeds(ax: Axes, run: RunResult) -> None:
    """Draw the speeds of the corrected method over the whole record; shaded: before and after."""
    curves = run.better.curves
    if curves is None:
        ax.remove()
        return
    blocks = run.better.blocks
    ax.plot(*thin(curves.t_s, curves.platform_speed_m_s), color=series(0), label="platform V")
    dot = Mark(".", True, "sliding speed")
    dots(ax, blocks.t_s, blocks.sliding_speed_m_s, series(2), dot, label=dot.label)
    driven = (curves.t_s >= 0.0) & (curves.t_s <= run.run.stop_s)
    shade_unused(ax, curves.t_s, driven)
    label(ax, "time", "s", "speed", "m/s")
    ax.legend(loc="best")
    ax.set_title("Speeds (corrected method)")


def _legend_above(ax: Axes) -> None:
    """Put the legend over all that is drawn: lines across the axes leave no gap for it."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.2 * (high - low))
    ax.legend(loc="upper center", ncols=3)


def _steady(ax: Axes, from_s: float) -> None:
    ax.axvline(from_s, color=INK, linewidth=0.7, linestyle=":")
