// Which channels are drawn, and in which colour; kept for the rig's next visit.

import "./infos.js"; // knows the channels before anybody draws them
import { known, watch } from "./store.js";

const COLOURS = 8; // --trace-0 to --trace-7 in tokens.css
const FIRST = 6;

const listeners = new Set();
let names = [];
const places = new Map(); // name -> colour; a channel keeps its own while it is shown

export const chosen = () => names;
export const watchChosen = (listener) => listeners.add(listener);

export function colourOf(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--trace-${places.get(name) ?? 0}`).trim();
}

export function toggle(name) {
  set(names.includes(name) ? names.filter((one) => one !== name) : [...names, name]);
  try {
    localStorage.setItem(`traces ${known.describe.rig}`, JSON.stringify(names));
  } catch { /* chosen anew next time */ }
}

function set(wanted) {
  names = wanted;
  for (const name of places.keys()) if (!names.includes(name)) places.delete(name);
  for (const name of names) {
    if (places.has(name)) continue;
    const uses = new Array(COLOURS).fill(0);
    for (const colour of places.values()) uses[colour] += 1;
    places.set(name, uses.indexOf(Math.min(...uses)));
  }
  for (const listener of listeners) listener();
}

/** What is drawn at first: quantities with limits, for those one must watch. */
function usual({ streams, setpoints, interlocks }) {
  const units = new Map(streams.flatMap((one) => one.channels.map(({ name, unit }) => [`${one.name}.${name}`, unit])));
  const watched = [
    ...interlocks.filter(({ low, high }) => low !== null || high !== null).map(({ source }) => source),
    ...setpoints.flatMap(({ name }) => [name, `${name}_setpoint`]),
  ];
  // A share or a switch, whose unit is 1, says little as a trace.
  const first = [...new Set(watched)].filter((name) => units.has(name) && units.get(name) !== "1");
  return (first.length ? first : [...units.keys()]).slice(0, FIRST);
}

watch("describe", () => {
  if (known.describe === null) return;
  const all = new Set(known.describe.streams.flatMap((one) => one.channels.map((channel) => `${one.name}.${channel.name}`)));
  let kept = null;
  try {
    kept = JSON.parse(localStorage.getItem(`traces ${known.describe.rig}`));
  } catch { /* nothing kept */ }
  const still = Array.isArray(kept) ? kept.filter((name) => all.has(name)) : [];
  set(still.length ? still : usual(known.describe));
});
window.addEventListener("themechange", () => listeners.forEach((listener) => listener()));
