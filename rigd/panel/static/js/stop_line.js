// Sends a stop to the panel over a WebSocket that is always open. A browser has six connections for
// all requests of a panel, and dry runs or downloads may use them all. If the WebSocket gives no
// answer, a request follows; the first answer counts.

import { postStop, Refused, UNREACHABLE } from "./api.js";
import { known, watch } from "./store.js";

const SILENT_MS = 300;
const LOST_MS = 6000;

/** @typedef {import("./stops.js").Stop} Stop */

/** @type {WebSocket | null} */
let line = null;
let count = 0;
/**
 * The promise that each stop waits for, by its number.
 * @type {Map<number, { line: WebSocket, resolve: (answer: Api.Stopped) => void, reject: (error: Refused) => void }>}
 */
const waiting = new Map();

/** Keep the WebSocket open while the page is connected. */
export function keepStopLine() {
  watch("link", () => {
    if (known.link !== "no_panel" && line === null) open();
  });
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
    for (const item of waiting.values()) if (item.line === mine) item.reject(new Refused(UNREACHABLE));
    setTimeout(() => known.link === "ok" && line === null && open(), SILENT_MS);
  };
}

/**
 * @param {Stop} verb
 * @returns {Promise<Api.Stopped>}
 */
async function byLine(verb) {
  const mine = line;
  if (mine?.readyState !== WebSocket.OPEN) throw new Refused(UNREACHABLE);
  const number = ++count;
  try {
    return await new Promise((resolve, reject) => {
      waiting.set(number, { line: mine, resolve, reject });
      setTimeout(reject, LOST_MS, new Refused(UNREACHABLE));
      mine.send(JSON.stringify({ number, verb }));
    });
  } finally {
    waiting.delete(number);
  }
}

/**
 * Request `stop`, `abort` or `estop`; the answer contains whether the request was new. If both ways
 * were taken, it counts as new: that one is not may be because the other was carried out.
 * @param {Stop} verb
 */
export async function stop(verb) {
  const isOnLine = line?.readyState === WebSocket.OPEN;
  const answered = byLine(verb);
  const silence = new Promise((done) => setTimeout(done, SILENT_MS, null));
  const first = Promise.race([answered.catch(() => null), silence]);
  let areBoth = false;
  const request = first.then((answer) => {
    if (answer !== null) return answer;
    areBoth = isOnLine;
    return postStop(verb);
  });
  try {
    const answer = await Promise.any([answered, request]);
    return areBoth ? { ...answer, acted: true } : answer;
  } catch (error) {
    throw /** @type {AggregateError} */ (error).errors.at(-1);
  }
}
