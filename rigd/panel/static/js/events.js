// What happened, newest first.

import { el, fill, setText } from "./dom.js";
import { clock, parameters, short, words } from "./format.js";
import { watchEvents, watchSkipped } from "./link.js";
import { read, watch } from "./store.js";
import { onShow } from "./tabs.js";

const KEPT = 1000;
/** @type {Record<string, string>} */
const MOODS = { interlock: "bad", fault: "bad", error: "bad", limit: "warn", late: "warn", prompt: "ask" };

/** @param {HTMLElement} root */
export function mountEvents(root) {
  const body = el("tbody");
  const wanted = el("input", { type: "search", id: "event-filter", placeholder: "such as interlock", autocomplete: "off" });
  const empty = el("p", { class: "empty" }, "Nothing has happened since the daemon started.");
  const notices = el("ul", { class: "notices" });
  const refused = el("p", { class: "quiet" });
  root.append(
    el("section", { class: "panel", "aria-label": "Notices of the daemon" },
      el("div", { class: "panel-head" }, el("h2", {}, "Notices of the daemon")), notices, refused),
    el("section", { class: "panel wide", "aria-label": "Events" },
    el("div", { class: "panel-head" }, el("h2", {}, "Events"),
      el("label", { for: "event-filter" }, "Only with"), wanted),
    el("div", { class: "scroll" },
      el("table", { class: "event-table" },
        el("thead", {}, el("tr", {}, ...["Time", "What", "Trial", ""].map((text) => el("th", { scope: "col" }, text)))),
        body), empty)));

  /** @type {(() => HTMLTableRowElement)[]} */
  const waiting = []; // rows that are made once the page is shown: most users watch another one
  const fillUp = () => {
    for (const make of waiting.splice(0)) {
      const row = make();
      filter(row);
      body.prepend(row);
    }
    while (body.rows.length > KEPT) body.lastElementChild?.remove();
    empty.hidden = body.rows.length > 0;
  };
  /** @param {() => HTMLTableRowElement} make */
  const add = (make) => {
    waiting.push(make);
    if (waiting.length > KEPT) waiting.shift();
    if (root.offsetParent) fillUp();
  };
  watchEvents((event) => add(() => line(event)));
  watchSkipped((skipped) => add(() => gap(skipped)));
  onShow("events", fillUp);
  wanted.addEventListener("input", () => [...body.rows].forEach(filter));

  let shown = "";
  watch("status", () => {
    const status = read("status");
    const key = JSON.stringify([status.notices, status.refused]);
    if (shown === key) return;
    shown = key;
    fill(notices, status.notices.length ? status.notices.toReversed().map(notice) : el("li", { class: "quiet" }, "None."));
    const counts = Object.entries(status.refused).filter(([, count]) => count > 0).map(([kind, count]) => `${count} ${kind}`);
    setText(refused, counts.length ? `Messages refused since it started: ${counts.join(", ")}.` : "");
  });

  /** @param {HTMLTableRowElement} row */
  function filter(row) {
    row.hidden = !row.textContent.toLowerCase().includes(wanted.value.trim().toLowerCase());
  }
}

/** @param {Api.PageEvent} event */
function line({ t_ns, kind, trial, data, scales }) {
  return el("tr", { data: { mood: MOODS[kind] ?? "calm" } },
    el("td", { class: "value" }, clock(t_ns / 1e6)),
    el("th", { scope: "row" }, words(kind)),
    el("td", { class: "value" }, trial < 0 ? "" : String(trial)),
    el("td", {}, describe(data, scales)));
}

/** @param {Api.OperatorNotice} notice */
const notice = ({ t_ns, level, text: note }) =>
  el("li", { data: { mood: { info: "calm", warning: "warn", error: "bad" }[level] } },
    el("span", { class: "value" }, clock(t_ns / 1e6)), note);

/** @param {number} skipped */
const gap = (skipped) => el("tr", { data: { mood: "warn" } },
  el("td", { colSpan: 4 }, `${skipped} events were left out: this computer is too slow for them. The recording has them all.`));

/**
 * What belongs to an event, as words: a name first, then the rest.
 * @param {Api.PageEvent["data"]} data
 * @param {Record<string, Api.UnitScale>} scales
 */
function describe(data, scales) {
  const { name, units, ...rest } = data;
  if (units !== undefined && rest.parameters !== undefined) {
    const trial = /** @type {Pick<Api.RecordedTrial, "parameters" | "units">} */ (data);
    rest.parameters = Object.fromEntries(parameters({ ...trial, scales }));
  }
  const parts = Object.entries(rest)
    .filter(([, value]) => value !== "" && value !== null)
    .map(([key, value]) => `${words(key)}: ${plain(value)}`);
  return [name === undefined ? null : plain(name), ...parts].filter((item) => item !== null).join(" · ");
}

/**
 * @param {Api.JsonValue} value
 * @returns {string}
 */
function plain(value) {
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : short(value);
  if (Array.isArray(value)) return value.map(plain).join(", ");
  if (typeof value === "object" && value !== null) {
    return Object.entries(value).map(([key, inner]) => `${words(key)} ${plain(inner)}`).join(", ");
  }
  return String(value);
}
