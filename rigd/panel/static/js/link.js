// The connection to the panel: received messages go to the store; a silent connection counts as lost.

import { reach } from "./api.js";
import { decode } from "./frame.js";
import { put, known, setClock } from "./store.js";

const SILENCE_MS = 2000; // the panel sends every 0.5 s
// Between attempts to connect: a panel that failed restarts within a second or two.
const SOON_MS = 250;
const OFTEN = 40;
const LATER_MS = 1000;
const NO_SESSION = 4401;

/**
 * @typedef {import("./frame.js").LiveFrame} LiveFrame
 * @type {Set<(frame: LiveFrame) => void>}
 */
const onFrames = new Set();
/** @type {Set<(event: Api.PageEvent) => void>} */
const onEvents = new Set();
/** @type {Set<(skipped: number) => void>} */
const onSkipped = new Set();

/**
 * Call `listener` with each frame when it arrives.
 * @param {(frame: LiveFrame) => void} listener
 */
export const watchFrames = (listener) => onFrames.add(listener);
/**
 * Call `listener` with each event.
 * @param {(event: Api.PageEvent) => void} listener
 */
export const watchEvents = (listener) => onEvents.add(listener);
/**
 * Call `listener` with the number of events that were left out.
 * @param {(skipped: number) => void} listener
 */
export const watchSkipped = (listener) => onSkipped.add(listener);

/** @type {WebSocket | null} */
let socket = null;
let points = 0; // of a stream in each second that this page can show; 0: not known

/**
 * Tell the panel how many points of a stream in each second this page can show.
 * @param {number} wanted
 */
export function showAtMost(wanted) {
  if (wanted === points) return;
  points = wanted;
  tellPoints();
}

const tellPoints = () => points > 0 && socket?.readyState === WebSocket.OPEN && socket.send(`points ${points}`);
let attempts = 0;
let heard = now();
let last = { seq: -1, t_ns: 0 };

/** Two clocks in ms: only the clock of the time of day advances while a computer sleeps. */
function now() {
  return [performance.now(), Date.now()];
}

function silentMs() {
  return Math.max(...now().map((clock, index) => clock - heard[index]));
}

export function connect() {
  heard = now();
  open();
  setInterval(judge, 250);
  // After a sleep the connection is lost; do not wait for the browser to notice.
  window.addEventListener("online", () => attempts > 0 && open());
  document.addEventListener("visibilitychange", judge);
}

function open() {
  socket?.close();
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const mine = new WebSocket(`${scheme}://${location.host}/api/live`);
  socket = mine;
  mine.binaryType = "arraybuffer";
  mine.onopen = tellPoints;
  mine.onmessage = ({ data }) => {
    heard = now();
    attempts = 0;
    if (typeof data === "string") hear(JSON.parse(data));
    else draw(mine, data);
  };
  mine.onclose = ({ code }) => {
    if (socket !== mine) return;
    socket = null;
    if (code === NO_SESSION) {
      window.dispatchEvent(new Event("sessionlost"));
      return;
    }
    judge();
    again();
  };
}

/**
 * Connect again as soon as the panel answers. Plain requests find that out: after some failed
 * connections, a browser delays the next WebSocket longer and longer.
 */
function again() {
  setTimeout(async () => {
    if (socket !== null) return;
    if (await reach()) open();
    else again();
  }, attempts++ < OFTEN ? SOON_MS : LATER_MS);
}

/** @param {Api.LiveMessage} message */
function hear(message) {
  switch (message.kind) {
    case "status":
      setClock(message.status.rows_ns);
      put("status", message.status);
      break;
    case "describe":
      put("describe", message.describe);
      break;
    case "latest":
      put("latest", message.latest);
      break;
    case "panel":
      put("panel", message.panel);
      break;
    case "event":
      // After a new connection the panel sends the stored events again. A restarted daemon counts
    // from 0 again, but its time continues.
      if (message.event.seq <= last.seq && message.event.t_ns <= last.t_ns) break;
      last = { seq: message.event.seq, t_ns: Math.max(last.t_ns, message.event.t_ns) };
      for (const listener of onEvents) listener(message.event);
      break;
    case "skipped":
      for (const listener of onSkipped) listener(message.skipped);
      break;
  }
  judge();
}

/**
 * Receive a batch of frames, and report when it is drawn: a slow computer then gets fewer batches.
 * @param {WebSocket} from
 * @param {ArrayBuffer} buffer
 */
function draw(from, buffer) {
  for (const frame of decode(buffer)) for (const listener of onFrames) listener(frame);
  const done = () => from.readyState === WebSocket.OPEN && from.send("drawn");
  if (document.hidden) done();
  else requestAnimationFrame(() => setTimeout(done)); // after the drawing of this frame
}

function judge() {
  const isSilent = socket === null || silentMs() > SILENCE_MS;
  /** @type {import("./store.js").Link} */
  let link = "ok";
  if (isSilent) link = "no_panel";
  else if (known.panel === null || known.status === null) link = known.panel?.alive === false ? "no_rig" : "connecting";
  else if (!known.panel.alive) link = "no_rig";
  if (isSilent && socket !== null && silentMs() > 2 * SILENCE_MS) {
    heard = now().map((clock) => clock - SILENCE_MS - 1); // try again, at most every other second
    attempts += 1;
    open();
  }
  if (link !== known.link) put("link", link);
}
