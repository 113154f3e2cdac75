// The history of every stream, filled from the frames.

import { History } from "./history.js";
import { watchFrames } from "./link.js";
import { known, watch } from "./store.js";

/** Number of a stream -> its history. */
export const histories = new Map();

watch("describe", () => {
  const shapes = new Map(known.describe.streams.map((one) => [one.number, one.channels.length]));
  for (const [number, history] of histories) {
    if (shapes.get(number) !== history.channels) histories.delete(number);
  }
  for (const [number, channels] of shapes) {
    if (!histories.has(number)) histories.set(number, new History(channels));
  }
});

watchFrames((frame) => histories.get(frame.stream)?.append(frame));

/** When the newest point of all was taken, in s since the epoch. */
export function newestTime() {
  let newest = -Infinity;
  for (const history of histories.values()) newest = Math.max(newest, history.newest);
  return newest;
}
