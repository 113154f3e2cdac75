// Every channel by its whole name, with the limits that hold for it.

import { known, watch } from "./store.js";

const infos = new Map();

/** The channel `device.name`, or undefined: what the rig says of it, and its tightest `limits`. */
export const channelInfo = (name) => infos.get(name);

watch("describe", () => {
  const { streams, setpoints, interlocks } = known.describe;
  infos.clear();
  for (const stream of streams) {
    stream.channels.forEach((channel, place) => {
      const full = `${stream.name}.${channel.name}`;
      infos.set(full, { ...channel, full, stream, place, limits: [-Infinity, Infinity], by: [] });
    });
  }
  for (const { name, low, high } of setpoints) tighten(`${name}_setpoint`, low, high, "rig file");
  for (const { name, source, low, high } of interlocks) {
    const bottom = typeof low === "number" ? low : -Infinity; // a word names a channel
    const top = typeof high === "number" ? high : Infinity;
    if (Number.isFinite(bottom) || Number.isFinite(top)) tighten(source, bottom, top, `interlock ${name}`);
  }
});

function tighten(name, low, high, by) {
  const info = infos.get(name);
  if (info === undefined) return;
  info.limits = [Math.max(info.limits[0], low), Math.min(info.limits[1], high)];
  info.by.push(by);
}
