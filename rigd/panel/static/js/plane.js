// The plane: bodies by position and heading, each with its trail, both axes to the same scale.

import { el, flag, setText } from "./dom.js";
import { age, short, steady } from "./format.js";
import { histories } from "./histories.js";
import { read } from "./store.js";

const COLOURS = 8; // as --trace-0 to --trace-7 in tokens.css
const LEFT_PX = 62; // as the axis of a trace
const RIGHT_PX = 24;
const TOP_PX = 8;
const BOTTOM_PX = 22;
const TICK_PX = 56; // least distance between lines of the grid
const LOST_S = 0.5; // a body counts as lost after this time without a pose, a slow one after some usual intervals
const LOST_INTERVALS = 4;
const MOST_POINTS = 2000;
const JUMP = 10; // a step so many times as long as those beside it is a body that was put elsewhere
const SHADES = 8; // a trail fades in so many steps
const SHRINK_MS = 1500; // how long a scale waits before it becomes smaller
const LEAST_SHARE = 0.05; // smallest scale, as a share of the largest seen: otherwise noise at rest looks like motion
const WORDS_MS = 1000; // between changes of the text for readers who do not see the drawing

/**
 * @typedef {Api.PagePose} Pose
 * @typedef {{ low: number[], high: number[] }} Box
 * @typedef {object} Seen where a body was, and what of it is drawn
 * @property {number[][]} trail
 * @property {number[] | null} at time, x, y, heading
 * @property {number} age since then, in s
 * @property {boolean} isLost
 */

export class Plane {
  /** @param {Pose[]} poses at least one */
  constructor(poses) {
    this.poses = poses;
    this.shown = kept(poses);
    this.centre = [0, 0];
    this.perPixel = 0; // m
    this.largest = 0; // m
    this.smallSince = /** @type {number | null} */ (null);
    this.worded = -Infinity;
    this.drawn = /** @type {{ start: number, end: number, now: number } | null} */ (null);
    const style = getComputedStyle(document.documentElement);
    /** @type {(name: string) => string} */
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    this.ink = colour("quiet");
    this.grid = colour("grid");
    this.colours = poses.map((_, index) => colour(`trace-${index % COLOURS}`));
    this.chips = poses.map((pose, index) => this.#chip(pose, this.colours[index]));
    this.canvas = el("canvas", { role: "img" });
    this.area = el("div", { class: "plot-canvas" }, this.canvas);
    this.element = el("div", { class: "plot plane", role: "group", "aria-label": "Plane" },
      el("div", { class: "legend" }, el("span", { class: "plot-unit" }, "m"), el("div", { class: "chips" }, this.chips.map((chip) => chip.element))),
      this.area);
    flag(this.element, "data-empty", this.shown.size === 0);
  }

  destroy() {
    this.element.remove();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.area;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.canvas.getContext("2d")?.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  /**
   * @param {number} start
   * @param {number} end
   * @param {number} now the time to which ages count
   */
  draw(start, end, now) {
    this.drawn = { start, end, now };
    const seen = this.poses.map((pose) => look(pose, start, end, now));
    this.poses.forEach((pose, index) => {
      const { value, element } = this.chips[index];
      setText(value, this.shown.has(pose.body) ? where(seen[index]) : "");
      flag(element, "data-lost", seen[index].isLost);
    });
    const bodies = seen.flatMap((one, index) => (this.shown.has(this.poses[index].body) ? [{ ...one, colour: this.colours[index] }] : []));
    this.#describe(seen);
    const context = this.canvas.getContext("2d");
    const { clientWidth: width, clientHeight: height } = this.area;
    if (context === null || bodies.length === 0 || width <= LEFT_PX + RIGHT_PX || height <= TOP_PX + BOTTOM_PX) return;
    const size = [width - LEFT_PX - RIGHT_PX, height - TOP_PX - BOTTOM_PX];
    this.#fit(boxOf(bodies), size);
    context.clearRect(0, 0, width, height);
    /** @type {(x: number, y: number) => [number, number]} */
    const toPixel = (x, y) => [
      LEFT_PX + size[0] / 2 + (x - this.centre[0]) / this.perPixel,
      TOP_PX + size[1] / 2 - (y - this.centre[1]) / this.perPixel,
    ];
    this.#drawGrid(context, size, toPixel);
    context.save();
    context.beginPath();
    context.rect(LEFT_PX, TOP_PX, size[0], size[1]);
    context.clip();
    for (const { trail, colour } of bodies) drawTrail(context, trail, colour, JUMP * this.perPixel, toPixel);
    for (const { at, isLost, colour } of bodies) if (at !== null) drawBody(context, at, isLost, colour, toPixel);
    context.restore();
  }

  /**
   * Let the plane hold `box`: at once if it grows or moves out of sight, after a while if it becomes smaller.
   * @param {Box | null} box
   * @param {number[]} size in pixels
   */
  #fit(box, size) {
    if (box === null) {
      this.perPixel ||= 1 / Math.min(...size);
      return;
    }
    const extent = [0, 1].map((axis) => box.high[axis] - box.low[axis]);
    this.largest = Math.max(this.largest, ...extent);
    const least = Math.max(LEAST_SHARE * this.largest, 1e-3 * Math.max(...box.low.map(Math.abs), ...box.high.map(Math.abs))) || 1;
    const wanted = 1.25 * Math.max(...extent.map((item, axis) => Math.max(item, least) / size[axis]));
    const isInside = this.perPixel > 0 && [0, 1].every((axis) => {
      const half = (size[axis] * this.perPixel) / 2;
      return box.low[axis] >= this.centre[axis] - half && box.high[axis] <= this.centre[axis] + half;
    });
    if (isInside && wanted > 0.5 * this.perPixel) {
      this.smallSince = null;
      return;
    }
    this.smallSince ??= performance.now();
    if (isInside && performance.now() - this.smallSince < SHRINK_MS) return;
    this.smallSince = null;
    this.perPixel = wanted;
    this.centre = [0, 1].map((axis) => (box.low[axis] + box.high[axis]) / 2);
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {number[]} size
   * @param {(x: number, y: number) => [number, number]} toPixel
   */
  #drawGrid(context, size, toPixel) {
    const step = roundUp(TICK_PX * this.perPixel);
    context.font = "12px system-ui, sans-serif";
    context.lineWidth = 1;
    context.strokeStyle = this.grid;
    context.fillStyle = this.ink;
    const [left, right, top, bottom] = [LEFT_PX, LEFT_PX + size[0], TOP_PX, TOP_PX + size[1]];
    for (const axis of [0, 1]) {
      const half = (size[axis] * this.perPixel) / 2;
      const first = Math.ceil((this.centre[axis] - half) / step);
      const last = Math.floor((this.centre[axis] + half) / step);
      for (let tick = first; tick <= last; tick++) {
        const [x, y] = toPixel(tick * step, tick * step).map((pixel) => Math.round(pixel) + 0.5);
        const text = short(Number((tick * step).toPrecision(12)));
        context.beginPath();
        if (axis === 0) {
          context.moveTo(x, top);
          context.lineTo(x, bottom);
          write(context, text, x, bottom + 5, "center", "top");
        } else {
          context.moveTo(left, y);
          context.lineTo(right, y);
          write(context, text, left - 6, y, "right", "middle");
        }
        context.stroke();
      }
    }
    write(context, "x", right + 8, bottom + 5, "left", "top");
    write(context, "y", 12, top, "left", "top");
  }

  /**
   * What the drawing shows, as the text that stands for it.
   * @param {Seen[]} seen
   */
  #describe(seen) {
    if (performance.now() - this.worded < WORDS_MS) return;
    this.worded = performance.now();
    const bodies = this.poses.flatMap(({ body }, index) => (this.shown.has(body) ? [`${named(body)}: ${where(seen[index])}`] : []));
    this.canvas.setAttribute("aria-label", `Positions in the plane, x and y in m. ${bodies.join("; ")}`);
  }

  /**
   * @param {Pose} pose
   * @param {string} colour
   */
  #chip({ body }, colour) {
    const value = el("span", { class: "chip-value" });
    const element = el("button", {
      type: "button", class: "chip", title: `${named(body)}\nPress to show or to hide it`,
      "aria-pressed": String(this.shown.has(body)), onclick: () => this.#toggle(body),
    }, el("span", { class: "swatch", "aria-hidden": "true" }), named(body), value);
    element.style.setProperty("--trace", colour);
    return { element, value };
  }

  /** @param {string} body */
  #toggle(body) {
    if (!this.shown.delete(body)) this.shown.add(body);
    this.poses.forEach((pose, index) =>
      this.chips[index].element.setAttribute("aria-pressed", String(this.shown.has(pose.body))));
    flag(this.element, "data-empty", this.shown.size === 0);
    try {
      localStorage.setItem(`plane ${read("describe").rig}`, JSON.stringify([...this.shown]));
    } catch { /* chosen anew next time */ }
    this.worded = -Infinity;
    this.resize();
    if (this.drawn !== null) this.draw(this.drawn.start, this.drawn.end, this.drawn.now);
  }
}

/**
 * The bodies that are shown: those chosen before, else those that an interlock watches, else all.
 * @param {Pose[]} poses
 */
function kept(poses) {
  let found = null;
  try {
    found = JSON.parse(localStorage.getItem(`plane ${read("describe").rig}`) ?? "null");
  } catch { /* nothing kept */ }
  if (Array.isArray(found)) return new Set(found);
  const watched = poses.filter((pose) => pose.watched);
  return new Set((watched.length ? watched : poses).map((pose) => pose.body));
}

/** @param {string} body */
const named = (body) => body.replaceAll("_", " ");

/**
 * @param {Pose} pose
 * @param {number} start
 * @param {number} end
 * @param {number} now
 * @returns {Seen}
 */
function look({ stream, x, y, heading }, start, end, now) {
  const history = histories.get(stream);
  const places = heading === null ? [x, y] : [x, y, heading];
  const at = history?.last(places, end) ?? null;
  const trail = history?.points([x, y], start, end, MOST_POINTS) ?? [];
  // Points of a long time are coarse: the newest is none of them.
  if (at !== null && at[0] >= start) trail.push(at.slice(0, 3));
  const seconds = at === null ? Infinity : now - at[0];
  const most = Math.max(LOST_S, LOST_INTERVALS * (history?.interval() || 0));
  return { trail, at, age: seconds, isLost: seconds > most };
}

/**
 * The pose as text.
 * @param {Seen} seen
 */
function where({ at, age: seconds, isLost }) {
  if (at === null) return "not seen yet";
  if (isLost) return `not seen for ${age(seconds)}`;
  const [, x, y, heading] = at;
  const text = `x ${steady(x, 1)}, y ${steady(y, 1)}`;
  return heading === undefined ? text : `${text}, ${steady((heading * 180) / Math.PI, 1000)}°`;
}

/**
 * The box around all trails and bodies; null if there is nothing.
 * @param {Seen[]} bodies
 * @returns {Box | null}
 */
function boxOf(bodies) {
  const low = [Infinity, Infinity];
  const high = [-Infinity, -Infinity];
  for (const { trail, at } of bodies) {
    for (const point of at === null ? trail : [...trail, at]) {
      for (const axis of [0, 1]) {
        // Written so that NaN is skipped.
        if (point[axis + 1] < low[axis]) low[axis] = point[axis + 1];
        if (point[axis + 1] > high[axis]) high[axis] = point[axis + 1];
      }
    }
  }
  return low[0] <= high[0] ? { low, high } : null;
}

/**
 * The trail, the older the fainter, interrupted while the body was lost and if it was put elsewhere.
 * @param {CanvasRenderingContext2D} context
 * @param {number[][]} trail
 * @param {string} colour
 * @param {number} least a step shorter than this is drawn in any case, in m
 * @param {(x: number, y: number) => [number, number]} toPixel
 */
function drawTrail(context, trail, colour, least, toPixel) {
  if (trail.length < 2) return;
  const first = trail[0][0];
  const whole = trail[trail.length - 1][0] - first;
  const longest = Math.max(LOST_S, (LOST_INTERVALS * whole) / trail.length);
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.lineJoin = "round";
  const steps = trail.map(([, x, y], index) => (index === 0 ? 0 : Math.hypot(x - trail[index - 1][1], y - trail[index - 1][2])));
  let shade = -1;
  trail.forEach(([t, x, y], index) => {
    if (index === 0) return;
    const [before, fromX, fromY] = trail[index - 1];
    const isMove = steps[index] <= JUMP * Math.max(steps[index - 1], steps[index + 1] ?? Infinity);
    if (Number.isNaN(x + y + fromX + fromY) || t - before > longest || !(isMove || steps[index] < least)) return;
    const now = Math.min(SHADES - 1, Math.floor((SHADES * (t - first)) / whole));
    if (now !== shade) {
      if (shade >= 0) context.stroke();
      shade = now;
      context.globalAlpha = 0.25 + (0.75 * (now + 1)) / SHADES;
      context.beginPath();
    }
    context.moveTo(...toPixel(fromX, fromY));
    context.lineTo(...toPixel(x, y));
  });
  if (shade >= 0) context.stroke();
  context.globalAlpha = 1;
}

/**
 * The body as an arrow, without a heading as a disc; one that is lost as its outline, crossed out.
 * @param {CanvasRenderingContext2D} context
 * @param {number[]} at
 * @param {boolean} isLost
 * @param {string} colour
 * @param {(x: number, y: number) => [number, number]} toPixel
 */
function drawBody(context, [, x, y, heading], isLost, colour, toPixel) {
  context.save();
  context.translate(...toPixel(x, y));
  context.fillStyle = context.strokeStyle = colour;
  context.lineWidth = 1.5;
  if (isLost) {
    context.beginPath();
    for (const way of [-1, 1]) {
      context.moveTo(-10, -10 * way);
      context.lineTo(10, 10 * way);
    }
    context.stroke();
  }
  context.beginPath();
  if (heading === undefined) context.arc(0, 0, 6, 0, 2 * Math.PI);
  else {
    context.rotate(-heading);
    context.moveTo(16, 0);
    context.lineTo(-9, 8);
    context.lineTo(-5, 0);
    context.lineTo(-9, -8);
    context.closePath();
  }
  if (isLost) {
    context.setLineDash([3, 2]);
    context.stroke();
  } else context.fill();
  context.restore();
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 * @param {number} x
 * @param {number} y
 * @param {CanvasTextAlign} align
 * @param {CanvasTextBaseline} baseline
 */
function write(context, text, x, y, align, baseline) {
  context.textAlign = align;
  context.textBaseline = baseline;
  context.fillText(text, x, y);
}

/**
 * The next of 1, 2 and 5 times a power of ten.
 * @param {number} value above 0
 */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 2, 5].find((factor) => factor * power >= value) ?? 10);
}
