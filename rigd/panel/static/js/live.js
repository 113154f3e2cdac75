// The live page: traces at the left; the run, the interlocks, the controllers and all channels at the right.

import { mountChannels } from "./channels.js";
import { mountControllers } from "./controllers.js";
import { el } from "./dom.js";
import { mountInterlocks } from "./interlocks.js";
import { mountRun } from "./run.js";
import { mountTraces } from "./traces.js";

/** @param {HTMLElement} root */
export function mountLive(root) {
  /** @type {(name: string, title: string) => HTMLElement} */
  const part = (name, title) => el("section", { class: `panel ${name}`, "aria-label": title });
  const traces = part("traces", "Traces");
  const run = part("run", "Run");
  const interlocks = part("interlocks", "Interlocks");
  const controllers = part("controllers", "Controllers");
  const channels = part("channels", "Channels");
  root.append(traces, el("div", { class: "side" }, run, interlocks, controllers, channels));
  mountTraces(traces);
  mountRun(run);
  mountInterlocks(interlocks);
  mountControllers(controllers);
  mountChannels(channels);
}
