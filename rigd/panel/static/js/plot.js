// One plot: the channels of one unit, drawn by uPlot as the extremes of each column of pixels.

import uPlot from "../vendor/uPlot.js";
import { colourOf, toggle } from "./choice.js";
import { el, flag, setText } from "./dom.js";
import { clock, short, steady, unit } from "./format.js";
import { columns as extremes, isOld, traceAge, valueAt } from "./newest.js";
import { panAndZoom } from "./gestures.js";

const AXIS_PX = 62; // the same in every plot, so that the plots are aligned
const BREAK_S = 1.5; // a trace is interrupted after this time without a point
const SHRINK_MS = 1500; // how long a scale waits before it becomes smaller
const LEAST_SHARE = 0.1; // smallest scale, as a share of the largest limit: otherwise noise at rest looks like motion
/** Intervals between ticks of time, in s: round values of a clock. */
const TIME_STEPS = [
  0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5,
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200,
];

/** @typedef {import("./infos.js").Info} Info */

export class Plot {
  /**
   * @param {HTMLElement} area
   * @param {string} symbol
   * @param {Info[]} infos
   * @param {import("./gestures.js").Actions} actions
   * @param {boolean} isLast
   */
  constructor(area, symbol, infos, actions, isLast) {
    this.infos = infos;
    this.symbol = symbol;
    this.isLast = isLast;
    this.limit = Math.max(0, ...infos.flatMap((info) => info.limits).map(Math.abs).filter(Number.isFinite));
    this.scale = /** @type {{ min: number, max: number } | null} */ (null);
    this.smallSince = /** @type {number | null} */ (null);
    this.cursor = /** @type {number | null} */ (null);
    this.start = NaN;
    this.end = NaN;
    this.columns = 50; // of pixels, each drawn from its lowest to its highest value
    /** @type {[number[], ...(number | null)[][]]} */
    this.data = this.#data(2);
    this.chips = infos.map((info) => this.#chip(info));
    this.canvas = el("div", { class: "plot-canvas" });
    this.element = el("div", { class: "plot" },
      el("div", { class: "legend" }, el("span", { class: "plot-unit" }, unit(symbol) || "–"), el("div", { class: "chips" }, this.chips.map((item) => item.element))),
      this.canvas);
    this.u = new uPlot(this.#options(), this.data, this.canvas);
    panAndZoom(this.u.over, actions, () => [this.start, this.end]);
  }

  destroy() {
    this.u.destroy();
    this.element.remove();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width > 0 && height > 0) this.u.setSize({ width, height });
    // Measured here: to measure before each drawing would lay out the page each time.
    this.columns = Math.max(50, Math.round(this.u.over.clientWidth));
  }

  /**
   * @param {number} start
   * @param {number} end
   */
  draw(start, end) {
    this.start = start;
    this.end = end;
    const { columns } = this;
    const step = (end - start) / columns;
    // Columns are fixed in time, so that the drawing does not flicker when time advances.
    const first = Math.floor(start / step) * step;
    const count = columns + 1;
    if (this.data[0].length !== 2 * count) this.data = this.#data(2 * count);
    const [x, ...ys] = this.data;
    for (let column = 0; column < count; column++) {
      x[2 * column] = first + (column + 0.25) * step;
      x[2 * column + 1] = first + (column + 0.75) * step;
    }
    let lowest = Infinity;
    let highest = -Infinity;
    this.infos.forEach((info, index) => {
      const [low, high] = extremes(info, first, step, count, ys[index]);
      lowest = Math.min(lowest, low);
      highest = Math.max(highest, high);
    });
    this.#fit(lowest, highest);
    this.u.batch(() => {
      this.u.setData(this.data, false);
      this.u.setScale("x", { min: start, max: end });
      this.u.setScale("y", this.scale ?? { min: -1, max: 1 });
    });
    this.#readOut();
  }

  /**
   * @param {number} length
   * @returns {[number[], ...(number | null)[][]]}
   */
  #data(length) {
    return [Array.from({ length }, (_, index) => index), ...this.infos.map(() => new Array(length).fill(null))];
  }

  /**
   * Let the scale grow at once, and shrink only after a while: a scale that changes often cannot be read.
   * @param {number} lowest
   * @param {number} highest
   */
  #fit(lowest, highest) {
    if (lowest > highest) return; // nothing to fit to
    const least = Math.max(1e-3 * Math.max(Math.abs(lowest), Math.abs(highest)), LEAST_SHARE * this.limit) || 1;
    const middle = (lowest + highest) / 2;
    const half = 0.6 * Math.max(highest - lowest, least);
    const wanted = { min: middle - half, max: middle + half };
    const { scale } = this;
    if (scale === null || lowest < scale.min || highest > scale.max) {
      this.scale = wanted;
      this.smallSince = null;
    } else if (wanted.max - wanted.min > 0.5 * (scale.max - scale.min)) {
      this.smallSince = null;
    } else {
      this.smallSince ??= performance.now();
      if (performance.now() - this.smallSince > SHRINK_MS) this.scale = wanted;
    }
  }

  /** @param {Info} info */
  #chip(info) {
    const value = el("span", { class: "chip-value" });
    const colour = colourOf(info.full);
    const element = el("button", {
      type: "button", class: "chip", title: `${info.full}: ${info.doc}\nPress to remove it`, onclick: () => toggle(info.full),
    }, el("span", { class: "swatch", data: { setpoint: isSetpoint(info) }, "aria-hidden": "true" }), info.full.replaceAll("_", " "), value);
    element.style.setProperty("--trace", colour);
    return { element, value, colour };
  }

  /** The value under the pointer, or the newest. */
  #readOut() {
    const at = this.cursor === null ? null : this.start + this.cursor * (this.end - this.start);
    const size = this.scale === null ? 1 : Math.max(Math.abs(this.scale.min), Math.abs(this.scale.max));
    this.infos.forEach((info, index) => {
      setText(this.chips[index].value, steady(valueAt(info, at ?? this.end), size));
    });
  }

  /**
   * Mark values that are no longer of now; `isHeld`: they are of another time, which the page states.
   * @param {boolean} isHeld
   */
  age(isHeld) {
    this.infos.forEach((info, index) =>
      flag(this.chips[index].element, "data-stale", !isHeld && isOld(traceAge(info))));
  }

  /** @returns {uPlot.Options} */
  #options() {
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--quiet").trim();
    const grid = { stroke: style.getPropertyValue("--grid").trim(), width: 1 };
    const font = "12px system-ui, sans-serif";
    return {
      width: 400, height: 150, padding: [8, 24, this.isLast ? 0 : 6, 0],
      legend: { show: false },
      cursor: { sync: { key: "traces", setSeries: false }, drag: { x: false, y: false, setScale: false }, points: { show: false }, y: false },
      scales: { x: { time: false, auto: false }, y: { auto: false } },
      axes: [
        {
          stroke: ink, grid, font, space: 90, size: this.isLast ? 26 : 0, gap: 4, ticks: { ...grid, size: 4 },
          incrs: TIME_STEPS,
          values: (_, splits, __, ___, step) => splits.map((t) => (this.isLast ? timeLabel(t, step) : "")),
        },
        { stroke: ink, grid, font, size: AXIS_PX, gap: 6, ticks: { ...grid, size: 4 }, space: 28,
          values: (_, splits, __, ___, step) => splits.map((v) => (Math.abs(v) < step / 1e3 ? "0" : short(v))) },
      ],
      series: [{}, ...this.infos.map((info, index) => ({
        stroke: this.chips[index].colour, width: 1.5, dash: isSetpoint(info) ? [6, 3] : [], points: { show: false }, spanGaps: false,
        /** @type {uPlot.Series.GapsRefiner} */
        gaps: (u, _index, _from, _to, gaps) => {
          const { min = 0, max = 0 } = u.scales.x;
          const least = (BREAK_S / (max - min)) * u.bbox.width;
          return gaps.filter(([from, to]) => to - from > Math.max(least, 3));
        },
      }))],
      hooks: {
        setCursor: [(u) => {
          const { left = -1 } = u.cursor;
          this.cursor = left >= 0 ? left / u.over.clientWidth : null;
          if (!Number.isNaN(this.start)) this.#readOut();
        }],
        draw: [(u) => this.#drawLimits(u)],
      },
    };
  }

  /**
   * Limits as dashed lines, if the scale reaches them.
   * @param {uPlot} u
   */
  #drawLimits(u) {
    const { ctx, bbox } = u;
    const { min = 0, max = 0 } = u.scales.y;
    ctx.save();
    ctx.setLineDash([6, 6]);
    ctx.globalAlpha = 0.7;
    this.infos.forEach((info, index) => {
      for (const limit of info.limits) {
        if (!(limit > min && limit < max)) continue;
        const y = Math.round(u.valToPos(limit, "y", true)) + 0.5;
        ctx.strokeStyle = this.chips[index].colour;
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
      }
    });
    ctx.restore();
  }
}

/**
 * Setpoints are dashed, so that colour is not the only difference from measurements.
 * @param {Info} info
 */
const isSetpoint = (info) => info.name.endsWith("_setpoint");

/**
 * Time of day, with decimals if ticks are closer than a second.
 * @param {number} t
 * @param {number} step
 */
function timeLabel(t, step) {
  const text = clock(t * 1000);
  if (step >= 1) return step >= 60 ? text.slice(0, 5) : text;
  return text.slice(6) + (t % 1).toFixed(Math.min(4, Math.ceil(-Math.log10(step)))).slice(1);
}
