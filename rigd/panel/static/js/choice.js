// Stores which channels are drawn, and in which colour, also for the next visit.

import "./infos.js"; // knows the channels before they are drawn
import { read, watch } from "./store.js";

const COLOURS = 8; // --trace-0 to --trace-7 in tokens.css
const FIRST = 6;

/** @type {Set<() => void>} */
const listeners = new Set();
/** @type {string[]} */
let names = [];
/**
 * The colour of each channel; it does not change while the channel is shown.
 * @type {Map<string, number>}
 */
const places = new Map();

export const chosen = () => names;
/** @param {() => void} listener */
export const watchChosen = (listener) => listeners.add(listener);

/** @param {string} name */
export function colourOf(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--trace-${places.get(name) ?? 0}`).trim();
}

/** @param {string} name */
export function toggle(name) {
  set(names.includes(name) ? names.filter((item) => item !== name) : [...names, name]);
  try {
    localStorage.setItem(`traces ${read("describe").rig}`, JSON.stringify(names));
  } catch { /* chosen anew next time */ }
}

/** @param {string[]} wanted */
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

/**
 * The channels drawn at first: quantities with limits, because those must be watched.
 * @param {Api.PageDescription} describe
 */
function usual({ streams, setpoints, interlocks }) {
  const units = new Map(streams.flatMap((item) => item.channels.map(({ name, unit }) => [`${item.name}.${name}`, unit])));
  const watched = [
    ...interlocks.filter(({ low, high }) => low !== null || high !== null).map(({ source }) => source),
    ...setpoints.flatMap(({ name }) => [name, `${name}_setpoint`]),
  ];
  // A share or a switch, whose unit is 1, says little as a trace.
  const first = [...new Set(watched)].filter((name) => units.has(name) && units.get(name) !== "1");
  return (first.length ? first : [...units.keys()]).slice(0, FIRST);
}

watch("describe", () => {
  const describe = read("describe");
  const all = new Set(describe.streams.flatMap((item) => item.channels.map((channel) => `${item.name}.${channel.name}`)));
  let kept = null;
  try {
    kept = JSON.parse(localStorage.getItem(`traces ${describe.rig}`) ?? "null");
  } catch { /* nothing kept */ }
  const still = Array.isArray(kept) ? kept.filter((name) => all.has(name)) : [];
  set(still.length ? still : usual(describe));
});
window.addEventListener("themechange", () => listeners.forEach((listener) => listener()));
