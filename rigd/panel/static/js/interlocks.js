// Every interlock with its condition and how it stands.

import { el, fill, icon, mark, say } from "./dom.js";
import { ACTIONS, quantity, words } from "./format.js";
import { channelInfo } from "./infos.js";
import { known, watch } from "./store.js";

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
  watch(["status", "describe"], update);

  function update() {
    if (known.status === null || known.describe === null) return;
    const trips = new Map(known.status.trips.map((one) => [one.interlock, one]));
    for (const [name, cell] of rows) {
      const trip = trips.get(name);
      const text = trip === undefined ? "clear" : trip.acknowledged ? "acknowledged" : ACTIONS[trip.action];
      if (cell.dataset.text === text) continue;
      cell.dataset.text = text;
      cell.dataset.mood = trip === undefined ? "calm" : trip.acknowledged ? "warn" : "bad";
      fill(cell, icon(trip === undefined ? "check" : "warn"), text);
    }
    const open = known.status.trips.filter((one) => !one.acknowledged).map((one) => words(one.interlock));
    const all = rows.size === 0 ? "none" : `all ${rows.size} clear`;
    say(verdict, open.length === 0 ? all : open.length > 2 ? `${open.length} tripped` : `${open.join(", ")} tripped`);
    mark(verdict, "mood", open.length ? "bad" : "calm");
  }
}

function condition({ source, low, high }) {
  const symbol = channelInfo(source)?.unit ?? "1";
  const bound = (value) => (typeof value === "string" ? value : quantity(value, symbol));
  if (low !== null && high !== null) return `${source} within ${bound(low)} … ${bound(high)}`;
  if (low !== null) return `${source} above ${bound(low)}`;
  if (high !== null) return `${source} below ${bound(high)}`;
  return `${source} gives values`;
}
