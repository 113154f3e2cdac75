// Every channel by its full name, with its limits.

import { inUnit } from "./format.js";
import { read, watch } from "./store.js";

/**
 * A channel: its `limits` and the values of `newest.js` are in `unit`,
 * the unit in which people read it.
 * @typedef {Omit<Api.PageChannel, "display" | "low" | "high"> & { full: string, stream: Api.PageStream, place: number, limits: [number, number], by: string[] }} Info
 * @type {Map<string, Info>}
 */
const infos = new Map();

/**
 * The channel `device.name`, or undefined: its description, and its tightest `limits`.
 * @param {string} name
 */
export const channelInfo = (name) => infos.get(name);

watch("describe", () => {
  const { streams, setpoints, interlocks } = read("describe");
  infos.clear();
  for (const stream of streams) {
    stream.channels.forEach(({ name, display, doc, raw_of, factor, offset }, place) => {
      const full = `${stream.name}.${name}`;
      infos.set(full, { name, unit: display, doc, raw_of, factor, offset, full, stream, place, limits: [-Infinity, Infinity], by: [] });
    });
  }
  for (const { name, low, high } of setpoints) tighten(`${name}_setpoint`, low, high, "rig file");
  for (const { name, source, low, high } of interlocks) {
    const bottom = typeof low === "number" ? low : -Infinity; // a string is the name of a channel
    const top = typeof high === "number" ? high : Infinity;
    if (Number.isFinite(bottom) || Number.isFinite(top)) tighten(source, bottom, top, `interlock ${name}`);
  }
});

/**
 * @param {string} name
 * @param {number} low in SI, as `high`
 * @param {number} high
 * @param {string} by
 */
function tighten(name, low, high, by) {
  const info = infos.get(name);
  if (info === undefined) return;
  info.limits = [Math.max(info.limits[0], inUnit(low, info)), Math.min(info.limits[1], inUnit(high, info))];
  info.by.push(by);
}
