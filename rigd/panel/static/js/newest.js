// The newest value of a channel, and whether it is old.

import { histories } from "./histories.js";
import { known, rigNow } from "./store.js";

export const EVERY_MS = 200; // values that change faster cannot be read
const STALE_S = 1.5;

/**
 * Return the newest value of a channel (NaN: none) and its age in s.
 * @param {import("./infos.js").Info} info
 * @returns {[number, number | null]}
 */
export function newest({ full, stream, place }) {
  const history = histories.get(stream.number);
  const { latest } = known;
  const asked = latest?.values[full];
  const askedAt = latest === null || asked === undefined ? -Infinity : latest.t_ns / 1e9 - asked.age_s;
  if (history !== undefined && history.newest >= askedAt) {
    return [history.value(place), rigNow() / 1e3 - history.newest];
  }
  return asked === undefined ? [NaN, null] : [asked.value ?? NaN, rigNow() / 1e3 - askedAt];
}

/**
 * Whether a value of this age, or any value without connection, is no longer of now.
 * @param {number | null} seconds
 */
export const isOld = (seconds) => seconds === null || seconds > STALE_S || known.link !== "ok";
