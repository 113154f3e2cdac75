// The result of a dry run: duration, steps, and distance from the limits.

import { el, fill, icon } from "./dom.js";
import { duration, inUnit, quantities, scaled, short, steady, words } from "./format.js";

const BLOCKS = { prepare: "Before the trials", trial: "In each trial", after: "After each trial", finish: "At the end" };

/**
 * @param {HTMLElement} root
 * @param {Api.PageDryRun} found
 */
export function drawPreview(root, found) {
  const isPlayed = found.physics !== "none";
  const mood = !found.ok ? "bad" : isPlayed ? "calm" : "warn";
  fill(
    root,
    el("p", { class: "verdict-line", data: { mood } },
      icon(mood === "calm" ? "check" : "warn"),
      el("strong", {}, !found.ok ? "The run would fail" : isPlayed ? "Fit to run" : "Not refused, peaks not known"),
      el("span", {}, `${found.trials} ${found.trials === 1 ? "trial" : "trials"}, ${expected(found)} of rig time`)),
    found.refusals.length ? el("ul", { class: "problems" }, found.refusals.map((item) => el("li", {}, item))) : null,
    found.physics === "sibling" ? el("p", {}, `Played on the plant of the sibling ${found.sibling}.`) : null,
    found.notes.length ? el("ul", { class: "notes" }, found.notes.map((item) => el("li", {}, item))) : null,
    isPlayed ? [
      el("h3", {}, "Distance from the limits"),
      el("div", { class: "peaks" }, heading(), found.peaks.map((item) => peak(item, found.ok))),
    ] : null,
    found.differences.length ? differences(found.differences) : null,
    el("h3", {}, "Steps"),
    el("div", { class: "scroll" },
      el("table", { class: "steps" },
        el("thead", {}, el("tr", {}, ...["Step", "Setpoints", "Ends when", "Times", "Seconds"].map((text) => el("th", { scope: "col" }, text)))),
        Object.entries(BLOCKS).map(([block, title]) => steps(found.steps.filter((item) => item.block === block), title)))),
  );
}

/**
 * The duration in words: predicted, or without physics at most.
 * @param {Api.PageDryRun} found
 */
export function expected(found) {
  return found.physics === "none" ? `at most ${duration(found.duration_s)}` : `about ${duration(found.duration_s)}`;
}

/** @param {Api.DifferenceView[]} rows */
const differences = (rows) => el("details", { class: "more" },
  el("summary", {}, `${rows.length} ${rows.length === 1 ? "difference" : "differences"} between rig file and sibling`),
  el("div", { class: "scroll" },
    el("table", { class: "steps" },
      el("thead", {}, el("tr", {}, ...["What", "Rig file", "Sibling"].map((text) => el("th", { scope: "col" }, text)))),
      el("tbody", {}, rows.map((item) => el("tr", {},
        el("th", { scope: "row" }, item.what), el("td", {}, item.here), el("td", {}, item.there)))))));

/**
 * @param {Api.StepView[]} rows
 * @param {string} title
 */
function steps(rows, title) {
  if (rows.length === 0) return null;
  return el("tbody", {},
    el("tr", { class: "block" }, el("th", { colSpan: 5, scope: "rowgroup" }, title)),
    rows.map((item) => el("tr", {},
      el("th", { scope: "row" }, item.name),
      el("td", {}, lines(item.setpoints)),
      el("td", {}, lines(item.ends)),
      el("td", { class: "value" }, String(item.played)),
      el("td", { class: "value" }, spread(item)))));
}

/** @param {string[]} texts */
const lines = (texts) => texts.map((text) => el("div", {}, quantities(text)));

/** @param {Api.StepView} step */
function spread({ shortest_s: shortest, longest_s: longest, timing }) {
  if (timing === "at_most") return `at most ${longest.toFixed(2)}`;
  const low = shortest.toFixed(2);
  return longest - shortest < 0.005 ? low : `${low} … ${longest.toFixed(2)}`;
}

/**
 * The predicted extremes as a bar within the limits; an excess without a trip was too short for a trip.
 * @param {Api.PagePeak} item
 * @param {boolean} isFit
 */
function peak(item, isFit) {
  const [bottom, top, lowest, highest] = [item.low, item.high, item.lowest, item.highest]
    .map((value) => (value === null ? null : inUnit(value, item)));
  const low = bottom ?? Math.min(lowest ?? 0, 0);
  const high = top ?? Math.max(highest ?? 0, 0);
  const room = high - low || 1;
  const bar = el("i", {});
  const from = Math.max(0, ((lowest ?? low) - low) / room);
  const to = Math.min(1, ((highest ?? low) - low) / room);
  bar.style.setProperty("--from", String(from));
  bar.style.setProperty("--to", String(Math.max(to, from + 0.005)));
  const scale = Math.max(Math.abs(low), Math.abs(high), Math.abs(lowest ?? 0), Math.abs(highest ?? 0));
  const shown = scaled(scale, item.display);
  /** @param {number | null} value */
  const end = (value) => (value === null ? "" : short(value / shown.factor));
  /** @param {number | null} value */
  const found = (value) => steady(value === null ? null : value / shown.factor, scale / shown.factor);
  const beyond = isFit ? "beyond, too briefly to trip" : "beyond the limit";
  return el("div", { class: "peak", data: { mood: item.inside ? "calm" : isFit ? "warn" : "bad" } },
    el("span", { class: "peak-name" }, words(item.channel)),
    el("span", { class: "peak-end" }, end(bottom)),
    el("span", { class: "peak-bar" }, bar),
    el("span", { class: "peak-end" }, end(top)),
    el("span", { class: "peak-values" },
      el("span", { class: "whole" }, found(lowest)), " … ", el("span", { class: "whole" }, `${found(highest)}\u202f${shown.unit}`),
      item.inside ? null : el("span", { class: "peak-note" }, beyond)),
    el("span", { class: "peak-by" }, item.limit_by));
}

const heading = () => el("div", { class: "peak peak-head", "aria-hidden": "true" },
  ...["Channel", "Lowest", "", "Highest", "Predicted", "Limits set by"].map((text) => el("span", {}, text)));
