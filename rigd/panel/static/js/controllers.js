// Every controller: what it holds, its setpoint, and whether its output is at a limit.

import { el, fill, flag, mark, setText } from "./dom.js";
import { scaled, steady, words } from "./format.js";
import { channelInfo } from "./infos.js";
import { EVERY_MS, isOld, newest } from "./newest.js";
import { read, watch } from "./store.js";

/** @param {HTMLElement} root */
export function mountControllers(root) {
  const table = el("tbody");
  root.append(
    el("div", { class: "panel-head" }, el("h2", {}, "Controllers")),
    el("table", { class: "controller-table" },
      el("thead", {}, el("tr", {},
        el("th", { class: "unseen", scope: "col" }, "Controller"),
        ...["Setpoint", "Measured"].map((text) => el("th", { scope: "col" }, text)),
        ...["Unit", "Output"].map((text) => el("th", { class: "unseen", scope: "col" }, text)))),
      table));
  /** @type {Row[]} */
  let rows = [];
  watch("describe", () => {
    rows = read("describe").controllers.flatMap((item) => makeRow(item) ?? []);
    fill(table, rows.map(({ element }) => element));
    root.hidden = rows.length === 0;
    update();
  });
  setInterval(update, EVERY_MS);

  function update() {
    if (root.offsetParent) rows.forEach(show);
  }
}

/** @typedef {NonNullable<ReturnType<typeof makeRow>>} Row */

/** @param {Api.ControllerView} controller */
function makeRow({ setpoint, output }) {
  const stream = setpoint.split(".")[0];
  const infos = {
    measured: channelInfo(setpoint), setpoint: channelInfo(`${setpoint}_setpoint`),
    saturated: channelInfo(`${stream}.saturated`), active: channelInfo(`${stream}.active`),
  };
  const { measured, setpoint: goal, saturated, active } = infos;
  if (measured === undefined || goal === undefined || saturated === undefined || active === undefined) return null;
  const limit = Math.max(...goal.limits.map(Math.abs).filter(Number.isFinite), 0);
  const shown = scaled(limit, measured.unit);
  const cells = { goal: el("td", { class: "value" }), measured: el("td", { class: "value" }), state: el("td", { class: "lock-state" }) };
  const element = el("tr", {},
    el("th", { scope: "row", title: `holds ${measured.name.replaceAll("_", " ")} by ${output}` }, words(stream)),
    cells.goal, cells.measured, el("td", { class: "unit" }, shown.unit), cells.state);
  return { element, cells, shown, limit, peak: 0, goal, measured, saturated, active };
}

/** @param {Row} row */
function show(row) {
  const [measured, seconds] = newest(row.measured);
  const [goal] = newest(row.goal);
  const [saturated] = newest(row.saturated);
  const [active] = newest(row.active);
  row.peak = Math.max(row.peak, Math.abs(measured) || 0, Math.abs(goal) || 0);
  const { factor } = row.shown;
  const scale = (row.limit || row.peak) / factor;
  setText(row.cells.measured, steady(measured / factor, scale));
  setText(row.cells.goal, active === 1 ? steady(goal / factor, scale) : "–"); // else it follows the measured value
  const [text, mood] = active !== 1 ? ["off", "none"]
    : saturated > 0 ? ["at its highest output", "warn"]
    : saturated < 0 ? ["at its lowest output", "warn"]
    : ["acts", "calm"];
  setText(row.cells.state, text);
  mark(row.cells.state, "mood", mood);
  flag(row.element, "data-stale", isOld(seconds));
}
