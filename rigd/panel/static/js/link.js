// The connection to the panel: what comes in goes to the store; silence is never taken for life.

import { reach } from "./api.js";
import { decode } from "./frame.js";
import { put, known, setClock } from "./store.js";

const SILENCE_MS = 2000; // the panel speaks every 0.5 s
// Between attempts to connect: a panel that died is back within a second or two.
const SOON_MS = 250;
const OFTEN = 40;
const LATER_MS = 1000;
const NO_SESSION = 4401;

const onFrames = new Set();
const onEvents = new Set();

/** Call `listener` with each frame as it comes. */
export const watchFrames = (listener) => onFrames.add(listener);
/** Call `listener` with each event, or with {skipped: n} where some were left out. */
export const watchEvents = (listener) => onEvents.add(listener);

let socket = null;
let attempts = 0;
let heard = now();
let last = { seq: -1, t_ns: 0 };

/** Two clocks in ms: the one that steps with the time of day goes on while a computer sleeps. */
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
  // A computer that slept finds its connection dead; do not wait for the browser to notice.
  window.addEventListener("online", () => attempts > 0 && open());
  document.addEventListener("visibilitychange", judge);
}

function open() {
  socket?.close();
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const mine = new WebSocket(`${scheme}://${location.host}/api/live`);
  socket = mine;
  mine.binaryType = "arraybuffer";
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
 * Open anew as soon as the panel answers. That is asked by plain requests: after some connections
 * that failed, a browser holds back the next WebSocket for ever longer.
 */
function again() {
  setTimeout(async () => {
    if (socket !== null) return;
    if (await reach()) open();
    else again();
  }, attempts++ < OFTEN ? SOON_MS : LATER_MS);
}

function hear(message) {
  switch (message.kind) {
    case "status":
      setClock(message.status.t_ns);
      put("status", message.status);
      break;
    case "describe":
    case "latest":
    case "panel":
      put(message.kind, message[message.kind]);
      break;
    case "event":
      // After a new connection the panel tells again what it has kept. A daemon that was started
      // anew counts from 0 again, but its time goes on.
      if (message.event.seq <= last.seq && message.event.t_ns <= last.t_ns) break;
      last = message.event;
      for (const listener of onEvents) listener(message.event);
      break;
    case "skipped":
      for (const listener of onEvents) listener({ skipped: message.skipped });
      break;
  }
  judge();
}

/** Take a batch of frames, and say so once it is drawn: a slow computer is then sent fewer. */
function draw(from, buffer) {
  for (const frame of decode(buffer)) for (const listener of onFrames) listener(frame);
  const done = () => from.readyState === WebSocket.OPEN && from.send("drawn");
  if (document.hidden) done();
  else requestAnimationFrame(() => setTimeout(done)); // behind the drawing of this frame
}

function judge() {
  const isSilent = socket === null || silentMs() > SILENCE_MS;
  let link = "ok";
  if (isSilent) link = "no_panel";
  else if (known.panel === null || known.status === null) link = known.panel?.alive === false ? "no_rig" : "connecting";
  else if (!known.panel.alive) link = "no_rig";
  if (isSilent && socket !== null && silentMs() > 2 * SILENCE_MS) {
    heard = now().map((clock) => clock - SILENCE_MS - 1); // try anew, at most every other second
    attempts += 1;
    open();
  }
  if (link !== known.link) put("link", link);
}
