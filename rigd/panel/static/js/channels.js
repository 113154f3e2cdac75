// Every channel: value, unit, age, and its place within its limits.

import { el, fill, flag, mark, setText } from "./dom.js";
import { command } from "./api.js";
import { age, scaled, short, steady, unit, words } from "./format.js";
import { channelInfo } from "./infos.js";
import { EVERY_MS, isOld, newest } from "./newest.js";
import { chosen, colourOf, toggle, watchChosen } from "./choice.js";
import { hasControl, isMaintainer, read, watch } from "./store.js";
import { attempt, toast } from "./toasts.js";

/** @param {HTMLElement} root */
export function mountChannels(root) {
  const body = el("div", { class: "channel-list" });
  const actions = el("div", { class: "row actions" });
  root.append(el("div", { class: "panel-head" }, el("h2", {}, "Channels")), body, actions);
  /** @type {Row[]} */
  let rows = [];
  watch("describe", () => {
    rows = [];
    fill(body, read("describe").streams.map((stream) =>
      el("table", { class: "channel-table" },
        el("caption", {}, stream.name.replaceAll("_", " ")),
        el("colgroup", {}, ...["trace", "name", "number", "unit", "age", "limit"].map((name) => el("col", { class: `col-${name}` }))),
        el("thead", { class: "unseen" }, el("tr", {},
          ...["Trace", "Channel", "Value", "Unit", "Age", "Limits"].map((text) => el("th", { scope: "col" }, text)))),
        el("tbody", {}, stream.channels.map((channel) => {
          const row = makeRow(`${stream.name}.${channel.name}`);
          rows.push(row);
          return row.element;
        })))));
    update();
    fill(actions, isMaintainer() ? read("describe").actions.map(action) : null);
  });
  watch(["status", "link", "describe"], () => {
    const isOff = !hasControl() || read("status").run !== null;
    for (const button of actions.children) flag(button, "disabled", isOff);
  });
  watchChosen(() => rows.forEach(showChoice));
  setInterval(update, EVERY_MS);

  function update() {
    if (!root.offsetParent) return; // another page is open
    for (const row of rows) show(row);
  }
}

/**
 * A button for an action of a device, such as a tare.
 * @param {Api.ActionView} item
 */
function action(item) {
  /** @type {HTMLButtonElement} */
  const made = el("button", {
    type: "button", title: item.doc, onclick: () => attempt(made, async () => {
      const { said } = await command("act", { device: item.device, action: item.action });
      toast(`${words(item.device)}: ${said || "done"}`);
    }),
  }, `${words(item.device)}: ${words(item.action)}`);
  return made;
}

/** @typedef {ReturnType<typeof makeRow>} Row */

/** @param {string} name */
function makeRow(name) {
  const info = channelInfo(name);
  if (info === undefined) throw new Error(`unknown channel ${name}`);
  const limit = Math.max(...info.limits.map(Math.abs).filter(Number.isFinite), 0);
  const shown = scaled(limit, info.unit);
  const trace = el("button", {
    type: "button", class: "trace-toggle", "aria-label": `Trace of ${name}`, onclick: () => toggle(name),
  });
  const value = el("td", { class: "value" });
  const seconds = el("td", { class: "age" });
  const needle = el("i", {});
  const bar = el("div", { class: "limit-bar" }, needle);
  const [low, high] = info.limits;
  const limited = Number.isFinite(low) || Number.isFinite(high);
  bar.hidden = !limited;
  const limits = limited
    ? `Limits ${Number.isFinite(low) ? short(low) : "…"} to ${Number.isFinite(high) ? short(high) : "…"} ${unit(info.unit)} (${info.by.join(", ")})`
    : "No limits";
  const element = el("tr", {},
    el("td", {}, trace),
    el("th", { scope: "row", title: `${info.doc}\n${limits}`.trim() }, info.name.replaceAll("_", " ")),
    value, el("td", { class: "unit" }, shown.unit), seconds,
    el("td", { class: "limit", title: limits }, bar, el("span", { class: "unseen" }, limits)));
  const row = { name, info, shown, limit, peak: 0, trace, value, age: seconds, needle, bar, range: limited ? span(info) : null, element };
  showChoice(row);
  return row;
}

/**
 * The range of the bar; an open side ends at zero, or at the opposite of the other end.
 * @param {import("./infos.js").Info} info
 * @returns {[number, number]}
 */
function span({ limits: [low, high] }) {
  if (!Number.isFinite(low)) return [Math.min(0, high - Math.abs(high)), high];
  if (!Number.isFinite(high)) return [low, Math.max(0, low + Math.abs(low))];
  return [low, high];
}

/** @param {Pick<Row, "name" | "trace">} row */
function showChoice(row) {
  const on = chosen().includes(row.name);
  row.trace.setAttribute("aria-pressed", String(on));
  row.trace.style.setProperty("--trace", on ? colourOf(row.name) : "transparent");
}

/** @param {Row} row */
function show(row) {
  const [value, seconds] = newest(row.info);
  // As many decimals as a thousandth of the limit needs, or of the largest value seen.
  if (Math.abs(value) > row.peak) row.peak = Math.abs(value);
  const { factor } = row.shown;
  setText(row.value, steady(value / factor, (row.limit || row.peak) / factor));
  setText(row.age, age(seconds));
  flag(row.element, "data-stale", isOld(seconds));
  if (row.range === null) return;
  const [low, high] = row.range;
  row.needle.hidden = !Number.isFinite(value);
  const place = (value - low) / (high - low) || 0;
  row.needle.style.setProperty("--place", Math.max(0, Math.min(1, place)).toFixed(3));
  const [bottom, top] = row.info.limits;
  const margin = 0.08 * (high - low);
  const isOut = value < bottom || value > top;
  const isNear = value < bottom + margin || value > top - margin;
  mark(row.bar, "mood", isOut ? "bad" : isNear && bottom < 0 ? "warn" : "calm");
}
