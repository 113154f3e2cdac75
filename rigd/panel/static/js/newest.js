// The values of a channel in its unit, the newest with its age, and whether it is old.

import { inUnit } from "./format.js";
import { histories, historyOf } from "./histories.js";
import { known, rigNow } from "./store.js";

export const EVERY_MS = 250; // values that change faster cannot be read
const STALE_S = 1.5;

/**
 * Return the newest value of a channel (NaN: none) and its age in s.
 * @param {import("./infos.js").Info} info
 * @returns {[number, number | null]}
 */
export function newest(info) {
  const { full, stream, place } = info;
  const history = histories.get(stream.number);
  const { latest } = known;
  const asked = latest?.values[full];
  const askedAt = latest === null || asked === undefined ? -Infinity : latest.t_ns / 1e9 - asked.age_s;
  if (history !== undefined && history.newest >= askedAt) {
    return [inUnit(history.value(place), info), rigNow() / 1e3 - history.newest];
  }
  return asked === undefined ? [NaN, null] : [inUnit(asked.value ?? NaN, info), rigNow() / 1e3 - askedAt];
}

/**
 * The value at the time `t`; undefined if nothing has come.
 * @param {import("./infos.js").Info} info
 * @param {number} t
 */
export function valueAt(info, t) {
  const value = historyOf(info.stream.number, t, t)?.at(info.place, t);
  return typeof value === "number" ? inUnit(value, info) : value;
}

/**
 * Fill `values` with the extremes of each column, see `History.columns`; returns those of all.
 * @param {import("./infos.js").Info} info
 * @param {number} first
 * @param {number} step
 * @param {number} count
 * @param {(number | null)[]} values
 * @returns {[number, number]}
 */
export function columns({ stream, place, factor, offset }, first, step, count, values) {
  const [low, high] = historyOf(stream.number, first, first + step * (count - 1))?.columns(place, first, step, count, values) ?? [Infinity, -Infinity];
  if (factor === 1 && offset === 0) return [low, high];
  values.forEach((value, index) => {
    if (value !== null) values[index] = (value - offset) / factor;
  });
  return [(low - offset) / factor, (high - offset) / factor];
}

/**
 * The age of the newest point of a channel's trace in s; null if it has none.
 * @param {import("./infos.js").Info} info
 */
export function traceAge({ stream }) {
  const history = histories.get(stream.number);
  return history === undefined ? null : rigNow() / 1e3 - history.newest;
}

/**
 * Whether a value of this age, or any value without connection, is no longer of now.
 * @param {number | null} seconds
 */
export const isOld = (seconds) => seconds === null || seconds > STALE_S || known.link !== "ok";
