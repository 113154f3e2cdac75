// How a stop gets to the panel: by a connection of its own, which stands ready. A browser has six
// connections for all requests of a panel, and dry runs or downloads may hold them all. Where that
// line says nothing, a request follows; whichever is answered first is believed.

import { postStop, Refused, UNREACHABLE } from "./api.js";
import { known, watch } from "./store.js";

const SILENT_MS = 300;
const LOST_MS = 6000;

let line = null;
let count = 0;
const waiting = new Map(); // number -> how it is answered

/** Keep the line open while the page is connected. */
export function keepStopLine() {
  watch("link", () => known.link !== "no_panel" && line === null && open());
}

function open() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const mine = new WebSocket(`${scheme}://${location.host}/api/stop/line`);
  line = mine;
  mine.onmessage = ({ data }) => {
    const { number, answer, error } = JSON.parse(data);
    const found = waiting.get(number);
    if (error) found?.reject(new Refused(error));
    else found?.resolve(answer);
  };
  mine.onclose = () => {
    if (line === mine) line = null;
    for (const one of waiting.values()) if (one.line === mine) one.reject(new Refused(UNREACHABLE));
    setTimeout(() => known.link === "ok" && line === null && open(), SILENT_MS);
  };
}

async function byLine(verb) {
  if (line?.readyState !== WebSocket.OPEN) throw new Refused(UNREACHABLE);
  const number = ++count;
  try {
    return await new Promise((resolve, reject) => {
      waiting.set(number, { line, resolve, reject });
      setTimeout(reject, LOST_MS, new Refused(UNREACHABLE));
      line.send(JSON.stringify({ number, verb }));
    });
  } finally {
    waiting.delete(number);
  }
}

/** Ask for `stop`, `abort` or `estop`; the answer says whether that was news. */
export async function stop(verb) {
  const said = byLine(verb);
  const silence = new Promise((done) => setTimeout(done, SILENT_MS, null));
  const request = Promise.race([said.catch(() => null), silence]).then((answer) => answer ?? postStop(verb));
  try {
    return await Promise.any([said, request]);
  } catch ({ errors }) {
    throw errors.at(-1);
  }
}
