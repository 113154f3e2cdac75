// What a dry run found: how long, which steps, and how near the limits.

import { el, fill, icon } from "./dom.js";
import { duration, quantities, scaled, short, steady, words } from "./format.js";

const BLOCKS = { prepare: "Before the trials", trial: "In each trial", after: "After each trial", finish: "At the end" };

export function drawPreview(root, found) {
  fill(
    root,
    el("p", { class: "verdict-line", data: { mood: found.ok ? "calm" : "bad" } },
      icon(found.ok ? "check" : "warn"),
      el("strong", {}, found.ok ? "Fit to run" : "Would not run clean"),
      el("span", {}, `${found.trials} ${found.trials === 1 ? "trial" : "trials"}, about ${duration(found.duration_s)} of rig time`)),
    found.refusals.length ? el("ul", { class: "problems" }, found.refusals.map((one) => el("li", {}, one))) : null,
    el("h3", {}, "How near the limits"),
    el("div", { class: "peaks" }, heading(), found.peaks.map((one) => peak(one, found.ok))),
    el("h3", {}, "Steps"),
    el("div", { class: "scroll" },
      el("table", { class: "steps" },
        el("thead", {}, el("tr", {}, ...["Step", "Setpoints", "Ends when", "Times", "Seconds"].map((text) => el("th", { scope: "col" }, text)))),
        Object.entries(BLOCKS).map(([block, title]) => steps(found.steps.filter((one) => one.block === block), title)))),
  );
}

function steps(rows, title) {
  if (rows.length === 0) return null;
  return el("tbody", {},
    el("tr", { class: "block" }, el("th", { colSpan: 5, scope: "rowgroup" }, title)),
    rows.map((one) => el("tr", {},
      el("th", { scope: "row" }, one.name),
      el("td", {}, lines(one.setpoints)),
      el("td", {}, lines(one.ends)),
      el("td", { class: "value" }, String(one.played)),
      el("td", { class: "value" }, spread(one)))));
}

const lines = (texts) => texts.map((text) => el("div", {}, quantities(text)));

function spread({ shortest_s: shortest, longest_s: longest }) {
  const low = shortest.toFixed(2);
  return longest - shortest < 0.005 ? low : `${low} … ${longest.toFixed(2)}`;
}

/** The predicted extremes as a bar within the limits; beyond them without a trip it was too brief for one. */
function peak(one, isFit) {
  const low = one.low ?? Math.min(one.lowest ?? 0, 0);
  const high = one.high ?? Math.max(one.highest ?? 0, 0);
  const room = high - low || 1;
  const bar = el("i");
  const from = Math.max(0, ((one.lowest ?? low) - low) / room);
  const to = Math.min(1, ((one.highest ?? low) - low) / room);
  bar.style.setProperty("--from", from);
  bar.style.setProperty("--to", Math.max(to, from + 0.005));
  const end = (value) => (value === null ? "" : short(value));
  const scale = Math.max(Math.abs(low), Math.abs(high), Math.abs(one.lowest ?? 0), Math.abs(one.highest ?? 0));
  const shown = scaled(scale, one.unit);
  const found = (value) => steady(value === null ? null : value / shown.factor, scale / shown.factor);
  const beyond = isFit ? "beyond, too briefly to trip" : "beyond the limit";
  return el("div", { class: "peak", data: { mood: one.inside ? "calm" : isFit ? "warn" : "bad" } },
    el("span", { class: "peak-name" }, words(one.channel)),
    el("span", { class: "peak-end" }, end(one.low)),
    el("span", { class: "peak-bar" }, bar),
    el("span", { class: "peak-end" }, end(one.high)),
    el("span", { class: "peak-values" },
      el("span", { class: "whole" }, found(one.lowest)), " … ", el("span", { class: "whole" }, `${found(one.highest)}\u202f${shown.unit}`),
      one.inside ? null : el("span", { class: "peak-note" }, beyond)),
    el("span", { class: "peak-by" }, one.limit_by));
}

const heading = () => el("div", { class: "peak peak-head", "aria-hidden": "true" },
  ...["Channel", "Lowest", "", "Highest", "Predicted", "Limits set by"].map((text) => el("span", {}, text)));
