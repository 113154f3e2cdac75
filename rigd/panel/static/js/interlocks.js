// Every interlock with its condition and how it stands. They are watched by the cycle of a run: while
// none plays nobody watches, and nothing is called clear.

import { el, fill, icon, mark, say } from "./dom.js";
import { ACTIONS, clock, quantity, words } from "./format.js";
import { channelInfo } from "./infos.js";
import { watchEvents } from "./link.js";
import { known, watch } from "./store.js";

/** The states of a run in which its cycle watches. */
const WATCHED = new Set(["armed", "running", "pausing", "paused", "stopping", "finishing", "aborting"]);

/** When a run ended last, as far as this page knows, in ns since the Unix epoch. */
let endedNs = null;
watchEvents(({ kind, t_ns }) => {
  if (kind === "run_end") endedNs = t_ns;
});

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
  const rows = new Map();

  watch("describe", () => {
    rows.clear();
    fill(table, known.describe.interlocks.map((one) => {
      const state = el("td", { class: "lock-state" });
      rows.set(one.name, state);
      return el("tr", {},
        el("th", { scope: "row", title: one.message }, words(one.name)),
        el("td", {}, condition(one), el("span", { class: "quiet" }, ` else ${words(one.action)}`)),
        state);
    }));
    update();
  });
  watch(["status", "describe", "link"], update);

  function update() {
    if (known.status === null || known.describe === null) return;
    const isWatched = known.link === "ok" && WATCHED.has(known.status.state);
    const calm = isWatched ? "clear" : known.link === "ok" ? "not watched" : "not known";
    const trips = new Map(known.status.trips.map((one) => [one.interlock, one]));
    for (const [name, cell] of rows) {
      const trip = trips.get(name);
      const text = trip === undefined ? calm : trip.acknowledged ? "acknowledged" : ACTIONS[trip.action];
      if (cell.dataset.text === text) continue;
      cell.dataset.text = text;
      cell.dataset.mood = trip === undefined ? (isWatched ? "calm" : "none") : trip.acknowledged ? "warn" : "bad";
      fill(cell, trip !== undefined || isWatched ? icon(trip === undefined ? "check" : "warn") : null, text);
    }
    const open = known.status.trips.filter((one) => !one.acknowledged).map((one) => words(one.interlock));
    say(verdict, rows.size === 0 ? "none" : open.length === 0 ? verdictOf(isWatched, rows.size) : open.length > 2 ? `${open.length} tripped` : `${open.join(", ")} tripped`);
    mark(verdict, "mood", open.length ? "bad" : isWatched ? "calm" : "none");
  }
}

/** What is known of interlocks of which none has acted, and since when. */
function verdictOf(isWatched, count) {
  const { status, link } = known;
  if (link !== "ok") return "not known";
  if (isWatched) return `all ${count} clear, watched since ${clock(status.t_ns / 1e6 - status.run_s * 1e3)}`;
  if (status.run !== null) return "not watched yet";
  return endedNs === null ? "not watched: nothing runs" : `not watched since the run ended, ${clock(endedNs / 1e6)}`;
}

function condition({ source, low, high }) {
  const symbol = channelInfo(source)?.unit ?? "1";
  const bound = (value) => (typeof value === "string" ? value : quantity(value, symbol));
  if (low !== null && high !== null) return `${source} within ${bound(low)} … ${bound(high)}`;
  if (low !== null) return `${source} above ${bound(low)}`;
  if (high !== null) return `${source} below ${bound(high)}`;
  return `${source} gives values`;
}
