// Every channel: value, unit, age, and where it stands within its limits.

import { el, fill, flag, mark, say } from "./dom.js";
import { command } from "./api.js";
import { age, scaled, short, steady, unit, words } from "./format.js";
import { histories } from "./histories.js";
import { channelInfo } from "./infos.js";
import { chosen, colourOf, toggle, watchChosen } from "./choice.js";
import { hasControl, isMaintainer, known, rigNow, watch } from "./store.js";
import { attempt, toast } from "./toasts.js";

const EVERY_MS = 200; // values that change faster cannot be read
const STALE_S = 1.5;

export function mountChannels(root) {
  const body = el("div", { class: "channel-list" });
  const actions = el("div", { class: "row actions" });
  root.append(el("div", { class: "panel-head" }, el("h2", {}, "Channels")), body, actions);
  let rows = [];
  watch("describe", () => {
    rows = [];
    fill(body, known.describe.streams.map((stream) =>
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
    fill(actions, isMaintainer() ? known.describe.actions.map(action) : null);
  });
  watch(["status", "link", "describe"], () => {
    for (const button of actions.children) button.disabled = !hasControl() || known.status.run !== null;
  });
  watchChosen(() => rows.forEach(showChoice));
  setInterval(update, EVERY_MS);

  function update() {
    if (!root.offsetParent) return; // another page is open
    for (const row of rows) show(row);
  }
}

/** A button that lets a device do something of its own, such as a tare. */
function action(one) {
  const made = el("button", {
    type: "button", title: one.doc, onclick: () => attempt(made, async () => {
      const { said } = await command("act", { device: one.device, action: one.action });
      toast(`${words(one.device)}: ${said || "done"}`);
    }),
  }, `${words(one.device)}: ${words(one.action)}`);
  return made;
}

function makeRow(name) {
  const info = channelInfo(name);
  const limit = Math.max(...info.limits.map(Math.abs).filter(Number.isFinite), 0);
  const row = { name, info, shown: scaled(limit, info.unit), limit, peak: 0 };
  row.trace = el("button", {
    type: "button", class: "trace-toggle", "aria-label": `Trace of ${name}`, onclick: () => toggle(name),
  });
  row.value = el("td", { class: "value" });
  row.age = el("td", { class: "age" });
  row.needle = el("i");
  row.bar = el("div", { class: "limit-bar" }, row.needle);
  const [low, high] = info.limits;
  const limited = Number.isFinite(low) || Number.isFinite(high);
  row.range = limited ? span(info) : null;
  row.bar.hidden = !limited;
  const limits = limited
    ? `Limits ${Number.isFinite(low) ? short(low) : "…"} to ${Number.isFinite(high) ? short(high) : "…"} ${unit(info.unit)} (${info.by.join(", ")})`
    : "No limits";
  row.element = el("tr", {},
    el("td", {}, row.trace),
    el("th", { scope: "row", title: `${info.doc}\n${limits}`.trim() }, info.name.replaceAll("_", " ")),
    row.value, el("td", { class: "unit" }, row.shown.unit), row.age,
    el("td", { class: "limit", title: limits }, row.bar, el("span", { class: "unseen" }, limits)));
  showChoice(row);
  return row;
}

/** What the bar spans; an open side ends at zero, or at as much beyond it. */
function span({ limits: [low, high] }) {
  if (!Number.isFinite(low)) return [Math.min(0, high - Math.abs(high)), high];
  if (!Number.isFinite(high)) return [low, Math.max(0, low + Math.abs(low))];
  return [low, high];
}

function showChoice(row) {
  const on = chosen().includes(row.name);
  row.trace.setAttribute("aria-pressed", on);
  row.trace.style.setProperty("--trace", on ? colourOf(row.name) : "transparent");
}

function newest({ full, stream, place }) {
  const history = histories.get(stream.number);
  const asked = known.latest?.values[full];
  const askedAt = asked === undefined ? -Infinity : known.latest.t_ns / 1e9 - asked.age_s;
  if (history !== undefined && history.newest >= askedAt) {
    return [history.value(place), rigNow() / 1e3 - history.newest];
  }
  return asked === undefined ? [NaN, null] : [asked.value ?? NaN, rigNow() / 1e3 - askedAt];
}

function show(row) {
  const [value, seconds] = newest(row.info);
  // As many decimals as a thousandth of the limit needs, or of the largest value seen.
  if (Math.abs(value) > row.peak) row.peak = Math.abs(value);
  const { factor } = row.shown;
  say(row.value, steady(value / factor, (row.limit || row.peak) / factor));
  say(row.age, age(seconds));
  flag(row.element, "data-stale", seconds === null || seconds > STALE_S || known.link !== "ok");
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
