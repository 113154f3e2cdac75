// The history of every stream, filled from the frames; and, of a short time that is looked at while
// the traces are held, the rows as finely as the panel still has them.

import { past } from "./api.js";
import { decode } from "./frame.js";
import { History } from "./history.js";
import { watchFrames } from "./link.js";
import { read, watch } from "./store.js";

/**
 * The history of each stream, by its number.
 * @type {Map<number, History>}
 */
export const histories = new Map();

/**
 * What each history contains: stream, channels and units.
 * @type {Map<number, string>}
 */
let contents = new Map();

watch("describe", () => {
  const before = contents;
  contents = new Map();
  for (const { number, name, channels } of read("describe").streams) {
    const content = JSON.stringify([name, ...channels.map((channel) => [channel.name, channel.unit])]);
    contents.set(number, content);
    if (before.get(number) !== content) histories.set(number, new History(channels.length));
  }
  for (const number of histories.keys()) {
    if (!contents.has(number)) histories.delete(number);
  }
});

watchFrames((frame) => histories.get(frame.stream)?.append(frame));

/** The time of the newest point of all streams, in s since the epoch. */
export function newestTime() {
  let newest = -Infinity;
  for (const history of histories.values()) newest = Math.max(newest, history.newest);
  return newest;
}

/**
 * What the panel sent of a time that is looked at, each stream from `start` to `end`.
 * @type {{ start: number, end: number, streams: Map<number, History> } | null}
 */
let detail = null;

/**
 * The history of a stream that shows the time from `start` to `end` best.
 * @param {number} stream
 * @param {number} start
 * @param {number} end
 */
export function historyOf(stream, start, end) {
  const isWithin = detail !== null && start >= detail.start && end <= detail.end;
  return (isWithin ? detail?.streams.get(stream) : undefined) ?? histories.get(stream);
}

/** Whether the time from `start` to `end` has been fetched. */
export const hasDetail = (/** @type {number} */ start, /** @type {number} */ end) =>
  detail !== null && start >= detail.start && end <= detail.end;

/** Forget what was fetched. */
export function dropDetail() {
  detail = null;
}

/**
 * Fetch the time from `start` to `end`; what the panel no longer has remains as it is.
 * @param {number} start
 * @param {number} end
 * @param {number} points
 */
export async function fetchDetail(start, end, points) {
  /** @type {Map<number, History>} */
  const streams = new Map();
  for (const frame of decode(await past(start, end, points))) {
    const found = new History(frame.low.length, 1);
    found.append(frame);
    // A stream of which the beginning is missing is better shown coarser, but whole.
    const before = histories.get(frame.stream);
    if (before !== undefined && before.find(start) < before.find(found.oldest)) continue;
    streams.set(frame.stream, found);
  }
  detail = { start, end, streams };
}
