// Calls a person when something waits: by sound, by the title of the page, and by a notification if
// the browser allows it. Browsers play no sound before the user has pressed something in the page.

import { el, icon, mark, setText, visible } from "./dom.js";
import { words } from "./format.js";
import { known, read, watch } from "./store.js";

const AGAIN_MS = 10_000;
const BLINK_MS = 1000;
/** @type {Record<string, number[]>} */
const NOTES = { ask: [660, 880], bad: [520, 390, 520, 390] }; // Hz, one after another
const NOTE_S = 0.18;

let isOn = stored();
/** @type {AudioContext | null} */
let audio = null;
let base = "rigd";
/**
 * The present reason to call a person.
 * @typedef {{ key: string, mood: string, text: string }} Call
 * @type {Call | null}
 */
let calling = null;
let calledAt = -Infinity;
let isBlinking = false;

/**
 * Set the title of the page; it blinks while something waits.
 * @param {string} text
 */
export function setTitle(text) {
  base = text;
  drawTitle();
}

function drawTitle() {
  const text = visible(calling !== null && isBlinking ? `❗ ${calling.text}` : base);
  if (document.title !== text) document.title = text;
}

/** @param {HTMLElement} root */
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
    setText(text, isOn ? (isSilent ? "Sound after a press" : "Sound on") : "Sound off");
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
    notify(calling.text);
  }
}

/**
 * The present reason to call a person, or null.
 * @param {Api.PageStatus} status
 * @returns {Call | null}
 */
function waiting({ prompt, trips }) {
  if (prompt !== null) return { key: `prompt ${prompt.id}`, mood: "ask", text: prompt.text };
  const open = trips.filter((item) => !item.acknowledged);
  if (open.length === 0) return null;
  const names = open.map((item) => words(item.interlock)).join(", ");
  return { key: `trip ${names}`, mood: "bad", text: `Interlock ${names}` };
}

function call() {
  calledAt = performance.now();
  if (calling === null || !isOn || audio?.state !== "running") return;
  const context = audio;
  NOTES[calling.mood].forEach((hertz, index) => play(context, hertz, context.currentTime + index * NOTE_S));
}

/**
 * @param {AudioContext} context
 * @param {number} hertz
 * @param {number} at
 */
function play(context, hertz, at) {
  const tone = new OscillatorNode(context, { type: "triangle", frequency: hertz });
  const loudness = new GainNode(context, { gain: 0 });
  loudness.gain.setValueAtTime(0, at);
  loudness.gain.linearRampToValueAtTime(0.25, at + 0.01);
  loudness.gain.linearRampToValueAtTime(0, at + NOTE_S - 0.01);
  tone.connect(loudness).connect(context.destination);
  tone.start(at);
  tone.stop(at + NOTE_S);
}

function askToNotify() {
  if (globalThis.Notification?.permission === "default") Notification.requestPermission();
}

/** @param {string} text */
function notify(text) {
  if (!document.hidden || globalThis.Notification?.permission !== "granted") return;
  try {
    const { title, rig } = read("status");
    new Notification(title || rig, { body: visible(text), tag: "rigd" });
  } catch { /* some browsers on phones have them for installed pages only */ }
}

function stored() {
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
