// The history of every stream, filled from the frames.

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
