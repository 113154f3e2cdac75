// Every interlock with its condition and its state. The cycle of a run watches them: without a run
// no interlock is watched, and none is shown as clear.

import { el, fill, icon, mark, setText } from "./dom.js";
import { ACTIONS, clock, inUnit, quantity, words } from "./format.js";
import { channelInfo } from "./infos.js";
import { watchEvents } from "./link.js";
import { known, read, watch } from "./store.js";

/** The states of a run in which its cycle watches. */
const WATCHED = new Set(["armed", "running", "pausing", "held", "paused", "stopping", "finishing", "aborting"]);

/** The end of the last run, in ns since the Unix epoch; null if this page has not heard of it. */
let endedNs = /** @type {number | null} */ (null);
watchEvents(({ kind, t_ns }) => {
  if (kind === "run_start") endedNs = null;
  if (kind === "run_end") endedNs = t_ns;
});

/** @param {HTMLElement} root */
export function mountInterlocks(root) {
  const summary = el("summary", {});
  const title = el("h2", {}, "Interlocks");
  const verdict = el("span", { class: "verdict" });
  summary.append(title, verdict);
  const table = el("tbody");
  const details = el("details", {}, summary,
    el("table", { class: "interlock-table" },
      el("thead", { class: "unseen" }, el("tr", {}, el("th", {}, "Interlock"), el("th", {}, "Condition"), el("th", {}, "State"))),
      table));
  root.append(details);
  /** @type {Map<string, HTMLElement>} */
  const rows = new Map();

  watch("describe", () => {
    rows.clear();
    fill(table, read("describe").interlocks.map((item) => {
      const state = el("td", { class: "lock-state" });
      rows.set(item.name, state);
      return el("tr", {},
        el("th", { scope: "row", title: item.message }, words(item.name)),
        el("td", {}, condition(item), el("span", { class: "quiet" }, ` else ${words(item.action)}`)),
        state);
    }));
    update();
  });
  watch(["status", "describe", "link"], update);

  function update() {
    if (known.status === null || known.describe === null) return;
    const isWatched = known.link === "ok" && WATCHED.has(known.status.state);
    const calm = isWatched ? "clear" : known.link === "ok" ? "not watched" : "not known";
    const trips = new Map(known.status.trips.map((item) => [item.interlock, item]));
    for (const [name, cell] of rows) {
      const trip = trips.get(name);
      const text = trip === undefined ? calm : trip.acknowledged ? "acknowledged" : ACTIONS[trip.action];
      if (cell.dataset.text === text) continue;
      cell.dataset.text = text;
      cell.dataset.mood = trip === undefined ? (isWatched ? "calm" : "none") : trip.acknowledged ? "warn" : "bad";
      fill(cell, trip !== undefined || isWatched ? icon(trip === undefined ? "check" : "warn") : null, text);
    }
    const open = known.status.trips.filter((item) => !item.acknowledged).map((item) => words(item.interlock));
    setText(verdict, rows.size === 0 ? "none" : open.length === 0 ? verdictOf(isWatched, rows.size) : open.length > 2 ? `${open.length} tripped` : `${open.join(", ")} tripped`);
    mark(verdict, "mood", open.length ? "bad" : isWatched ? "calm" : "none");
  }
}

/**
 * The text for interlocks of which none has tripped: whether they are watched, and since when.
 * @param {boolean} isWatched
 * @param {number} count
 */
function verdictOf(isWatched, count) {
  const { link } = known;
  const status = read("status");
  if (link !== "ok") return "not known";
  if (isWatched) return `all ${count} clear, watched since ${clock(status.t_ns / 1e6 - status.run_s * 1e3)}`;
  if (status.run !== null) return "not watched yet";
  // A daemon that was killed has told no end: what it told before is of an earlier run.
  const begunNs = status.daemon.started_ns;
  if (endedNs !== null && endedNs >= begunNs) return `not watched since the run ended, ${clock(endedNs / 1e6)}`;
  return `not watched: no run since the daemon started, ${clock(begunNs / 1e6)}`;
}

/** @param {Api.InterlockView} interlock */
function condition({ source, low, high }) {
  const info = channelInfo(source);
  /** @param {number | string} value */
  const bound = (value) => (typeof value === "string" ? value : quantity(inUnit(value, info), info?.unit ?? "1"));
  if (low !== null && high !== null) return `${source} within ${bound(low)} … ${bound(high)}`;
  if (low !== null) return `${source} above ${bound(low)}`;
  if (high !== null) return `${source} below ${bound(high)}`;
  return `${source} gives values`;
}
