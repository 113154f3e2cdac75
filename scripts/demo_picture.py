"""The picture of the demo: Stribeck curves of three floors, and loops that the fit has not seen."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

import rigd
from rigd.analysis.report.palette import FITTED, INK, MEASURED, series

FloatArray = NDArray[np.float64]
Published = Mapping[str, Mapping[str, str]]
#: Of the rig's constants, as its file has them: mass, wheel, and what slows the carriage down.
MASS_KG, GRAVITY, RADIUS_M, GUIDE_N, ROLLING = 3.9593, 9.81, 0.05, 0.304, 0.022
WINDOW_S: Final = 0.031  #: of the filter of speeds and acceleration, as in identification
PUBLISHED: Final = (0, (4, 2))  #: how published curves are drawn: dashes
DRAWS: Final = 200  #: of the parameters, for the band of the prediction
ROLLERS: Final = 18  #: that take turns under the wheel in one revolution: two rows of nine


def write(
    result: rigd.Result, published: Published, rows: list[tuple[str, ...]], folder: Path
) -> None:
    """Draw the picture, and write it and the page with it to ``folder``."""
    picture = drawn(result, published, folder)
    picture.savefig(folder / "friction.png", dpi=150)
    text = StringIO()
    picture.savefig(text, format="svg")
    svg = text.getvalue()
    (folder / "index.html").write_text(as_page(svg[svg.index("<svg") :], rows), "utf-8")


def drawn(result: rigd.Result, published: Published, folder: Path) -> plt.Figure:
    """Return the picture: friction curves of the floors, and loops that the fit has not seen."""
    groups = {group["group"]: group for group in result.to_json()["groups"]}  # type: ignore[attr-defined]
    figure, (left, right) = plt.subplots(1, 2, figsize=(12.5, 5.4), layout="constrained")
    for index, (floor, paper) in enumerate(published.items()):
        draw_curve(left, groups[floor]["friction_curve"], paper, floor, series(index))
    left.set(xscale="log", xlabel="slip speed in mm/s", ylabel="friction over normal force, g")
    left.set_title("Stribeck curves of three floors", fontsize=11)
    left.fill_between([], [], color=INK, alpha=0.3, linewidth=0, label="95 % band of each")
    left.plot([], [], color=INK, linewidth=1, linestyle=PUBLISHED, label="as published")
    left.legend(frameon=False)
    draw_loops(right, groups["pvc"]["fit"]["point"], folder / "loops.mcap")
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(color="#e2e5e9", linewidth=0.6)
        ax.set_axisbelow(True)
    return figure


def draw_curve(
    ax: plt.Axes,
    points: list[dict[str, float]],
    published: Mapping[str, str],
    floor: str,
    colour: str,
) -> None:
    """Draw g over slip with its band, and dashed what the paper has."""
    slip, g, low, high = (np.array([p[key] for p in points]) for key in ("V_r", "g", "low", "high"))
    table = {name: float(str(value).split()[0]) for name, value in published.items()}
    paper = stribeck(slip, table["V_s"], table["mu_c"], table["mu_s"])
    ax.fill_between(1e3 * slip, low, high, color=colour, alpha=0.3, linewidth=0)
    ax.plot(1e3 * slip, g, color=colour, linewidth=2, label=floor)
    ax.plot(1e3 * slip, paper, color=INK, linewidth=1, linestyle=PUBLISHED)


def draw_loops(ax: plt.Axes, point: Mapping[str, Any], recording: Path) -> None:
    """Draw measured friction over the distance slipped, and the band that the model predicts."""
    period_s, slip, way_m, friction, moving, push = measured(recording)
    drawn_from = np.random.default_rng(1).multivariate_normal(
        np.zeros(len(point["values"])), np.array(point["covariance"]), DRAWS
    )
    predicted = lugre(slip, period_s, natural(point, np.vstack([drawn_from[:1] * 0, drawn_from])))
    low, high = np.quantile(predicted, [0.025, 0.975], axis=1)
    way = 1e3 * way_m
    off, rest = swing((friction - predicted[:, 0])[moving], push[moving])
    half = np.median(high - low) / 2.0
    band = f"its 95 % band: ± {half:.4f},\nthinner than the line"
    told = (
        f"measured, a point each {1e3 * period_s:.0f} ms;\nswings as the {ROLLERS} rollers of\n"
        f"the wheel take turns (rms\n{off:.3f}, {rest:.3f} without that)"
    )
    ax.plot(way[moving], friction[moving], ".", color=MEASURED, markersize=2.5, label=told)
    ax.plot(
        way, predicted[:, 0], color=FITTED, linewidth=1.5, label="predicted by\nthe model of PVC"
    )
    ax.fill_between(way, low, high, color=FITTED, alpha=0.35, linewidth=0, label=band)
    ax.set(xlabel="distance slipped in mm", ylabel="friction over normal force")
    ax.set_title("PVC: hysteresis loops of a test that the fit has not seen", fontsize=11)
    ax.legend(frameon=False, loc="lower left", fontsize=9, handlelength=1.2)


def swing(off: FloatArray, push: FloatArray) -> tuple[float, float]:
    """Return the rms of ``off`` (n,), and that of what ``push`` (n, 2) does not explain of it."""
    found, *_ = np.linalg.lstsq(push, off, rcond=None)
    return float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean((off - push @ found) ** 2)))


def measured(
    recording: Path,
) -> tuple[float, FloatArray, FloatArray, FloatArray, NDArray[np.bool_], FloatArray]:
    """Return period, slip speed, distance slipped, friction over normal force, and where it moves.

    Friction is what accelerates the carriage and what its guide and its rolling take (Eq. 34); so
    it holds what the transitions between the rollers do to the carriage, which is no friction. What
    they push with goes as the last array (n, 2), sine and cosine: speed times that of their angle.
    """
    trial = rigd.open(recording).trial(1)
    carriage, wheel, shaken = (
        trial[name] for name in ("carriage", "wheel_encoder", "accelerometer")
    )
    time = carriage["trial_time"]
    period_s = float(np.median(np.diff(time)))
    window = round(WINDOW_S / period_s) // 2 * 2 + 1
    rim = RADIUS_M * np.interp(time, wheel["trial_time"], wheel["angle"])
    acceleration = np.interp(time, shaken["trial_time"], shaken["acceleration"])
    acceleration -= acceleration[carriage["step"] == "rest"].mean()
    driven = np.isin(carriage["step"], ["push", "swing"])
    speed, rim_speed = (
        savgol_filter(x[driven], window, 2, deriv=1, delta=period_s)
        for x in (carriage["position"], rim)
    )
    weight = MASS_KG * GRAVITY
    force = MASS_KG * savgol_filter(acceleration[driven], window, 2)
    force += (GUIDE_N + ROLLING * weight) * np.sign(speed)
    way = (rim - carriage["position"])[driven]
    turned = ROLLERS * rim[driven] / RADIUS_M
    push = np.column_stack([speed * np.sin(turned), speed * np.cos(turned)])
    return period_s, rim_speed - speed, way - way[0], force / weight, speed > 0.03, push


def natural(point: Mapping[str, Any], steps: FloatArray) -> FloatArray:
    """Return (n, p) parameters that lie ``steps`` (n, p), in scaled coordinates, from the point."""
    values = np.array(point["values"])
    logarithmic = np.array([scale == "log" for scale in point["scaling"]])
    return np.where(logarithmic, values * np.exp(steps), values + steps)


def stribeck(slip: FloatArray, speed: Any, coulomb: Any, static: Any) -> FloatArray:
    """Return g at ``slip`` in m/s (corrected Eq. 6 of the paper)."""
    return np.asarray(coulomb + (static - coulomb) * np.exp(-np.sqrt(np.abs(slip) / speed)))


def lugre(slip: FloatArray, period_s: float, parameters: FloatArray) -> FloatArray:
    """Return (samples, n) friction over normal force for ``slip`` and n sets of parameters.

    The bristle's equation is implicit in its deflection, which is exact at rest and in sliding.
    """
    speed, coulomb, ratio, stiffness, damping, viscous = parameters.T
    z, out = np.zeros(len(parameters)), np.empty((len(slip), len(parameters)))
    for sample, v in enumerate(slip):
        rate = stiffness * abs(v) / stribeck(v, speed, coulomb, coulomb * np.exp(ratio))
        out[sample] = stiffness * z + damping * (v - rate * z) + viscous * v
        z = (z + period_s * v) / (1.0 + period_s * rate)
    return out


def as_page(svg: str, rows: list[tuple[str, ...]]) -> str:
    """Return the page: the picture, the table, links to the reports."""
    head, *body = rows
    cells = "".join(
        "<tr>" + "".join(f"<td>{escape(text.strip())}</td>" for text in row) + "</tr>"
        for row in body
    )
    heads = "".join(f"<th>{escape(text.strip())}</th>" for text in head)
    return (
        "<!doctype html><html lang=en><meta charset=utf-8><title>rigd: the demo</title>"
        "<style>body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;"
        "padding:0 1rem}svg{width:100%;height:auto}td,th{padding:.1rem .8rem .1rem 0;"
        "text-align:left}</style><h1>Friction of an omni-wheel on three floors</h1>"
        "<p>Simulated with the published parameters of the paper; rigd has found them again from "
        "the samples of the sensors. Right: the model of PVC, found from constant currents, "
        "predicts loops of another test. The measured points swing about them because friction is "
        "found from the acceleration of the carriage, which the wheel pushes each time when one of "
        f"its {ROLLERS} rollers follows another: it is no friction, and the model has no such "
        f"push.</p>{svg}<table><tr>{heads}</tr>{cells}</table>"
        "<p>All of it: "
        '<a href="report.html">omni-wheel</a>, <a href="angles.html">approach-angle rig</a>, '
        '<a href="robot.html">articulated robot</a>.</p></html>'
    )
