// The history of every stream, filled from the frames.

import { History } from "./history.js";
import { watchFrames } from "./link.js";
import { read, watch } from "./store.js";

/**
 * The history of each stream, by its number.
 * @type {Map<number, History>}
 */
export const histories = new Map();

watch("describe", () => {
  const shapes = new Map(read("describe").streams.map((stream) => [stream.number, stream.channels.length]));
  for (const [number, history] of histories) {
    if (shapes.get(number) !== history.channels) histories.delete(number);
  }
  for (const [number, channels] of shapes) {
    if (!histories.has(number)) histories.set(number, new History(channels));
  }
});

watchFrames((frame) => histories.get(frame.stream)?.append(frame));

/** The time of the newest point of all streams, in s since the epoch. */
export function newestTime() {
  let newest = -Infinity;
  for (const history of histories.values()) newest = Math.max(newest, history.newest);
  return newest;
}
