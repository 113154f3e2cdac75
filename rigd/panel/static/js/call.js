// What waits for a person calls them: by sound, by the title of the page, by a notification where the
// browser allows it. Browsers play nothing before somebody has pressed something in the page.

import { el, icon, mark, say, visible } from "./dom.js";
import { words } from "./format.js";
import { known, watch } from "./store.js";

const AGAIN_MS = 10_000;
const BLINK_MS = 1000;
const NOTES = { ask: [660, 880], bad: [520, 390, 520, 390] }; // Hz, one after another
const NOTE_S = 0.18;

let isOn = read();
let audio = null;
let base = "rigd";
let calling = null; // what waits: key, mood, text
let calledAt = -Infinity;
let isBlinking = false;

/** Set the title of the page; while something waits it blinks. */
export function setTitle(text) {
  base = text;
  drawTitle();
}

function drawTitle() {
  const text = visible(calling !== null && isBlinking ? `❗ ${calling.text}` : base);
  if (document.title !== text) document.title = text;
}

export function mountCall(root) {
  const text = el("span");
  const button = el("button", {
    type: "button", class: "plain-button sound", onclick: () => {
      isOn = !isOn;
      keep();
      if (isOn) askToNotify();
      show();
      call();
    },
  }, icon("sound"), text);
  root.append(button);

  function show() {
    const isSilent = isOn && audio?.state !== "running";
    say(text, isOn ? (isSilent ? "Sound after a press" : "Sound on") : "Sound off");
    mark(button, "on", isOn);
    button.setAttribute("aria-pressed", String(isOn));
  }

  const wake = async () => {
    audio ??= new AudioContext();
    if (audio.state === "suspended") await audio.resume();
    show();
  };
  for (const kind of ["pointerup", "keydown"]) window.addEventListener(kind, wake, true);
  if (navigator.userActivation?.hasBeenActive) wake();
  show();
  watch(["status", "link"], look);
  setInterval(() => {
    isBlinking = !isBlinking;
    drawTitle();
    if (calling !== null && performance.now() - calledAt > AGAIN_MS) call();
  }, BLINK_MS);
}

function look() {
  const waits = known.link === "ok" && known.status !== null ? waiting(known.status) : null;
  if (waits?.key === calling?.key) return;
  calling = waits;
  isBlinking = true;
  drawTitle();
  if (calling !== null) {
    call();
    notify();
  }
}

/** What waits for a person now, or null. */
function waiting({ prompt, trips }) {
  if (prompt !== null) return { key: `prompt ${prompt.id}`, mood: "ask", text: prompt.text };
  const open = trips.filter((one) => !one.acknowledged);
  if (open.length === 0) return null;
  const names = open.map((one) => words(one.interlock)).join(", ");
  return { key: `trip ${names}`, mood: "bad", text: `Interlock ${names}` };
}

function call() {
  calledAt = performance.now();
  if (calling === null || !isOn || audio?.state !== "running") return;
  NOTES[calling.mood].forEach((hertz, index) => play(hertz, audio.currentTime + index * NOTE_S));
}

function play(hertz, at) {
  const tone = new OscillatorNode(audio, { type: "triangle", frequency: hertz });
  const loudness = new GainNode(audio, { gain: 0 });
  loudness.gain.setValueAtTime(0, at);
  loudness.gain.linearRampToValueAtTime(0.25, at + 0.01);
  loudness.gain.linearRampToValueAtTime(0, at + NOTE_S - 0.01);
  tone.connect(loudness).connect(audio.destination);
  tone.start(at);
  tone.stop(at + NOTE_S);
}

function askToNotify() {
  if (globalThis.Notification?.permission === "default") Notification.requestPermission();
}

function notify() {
  if (!document.hidden || globalThis.Notification?.permission !== "granted") return;
  try {
    new Notification(known.status.title || known.status.rig, { body: visible(calling.text), tag: "rigd" });
  } catch { /* some browsers on phones have them for installed pages only */ }
}

function read() {
  try {
    return localStorage.getItem("sound") !== "off";
  } catch {
    return true;
  }
}

function keep() {
  try {
    localStorage.setItem("sound", isOn ? "on" : "off");
  } catch { /* on again next time */ }
}
