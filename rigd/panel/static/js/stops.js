// Stop, abort, estop: always visible, for every user, each with one press. On the keyboard, hold Esc
// for a moment: the first time it requests a stop, then an abort, then an estop. A short press of Esc,
// which closes dialogs, does not stop.

import { asRefused } from "./api.js";
import { el, fill, setText } from "./dom.js";
import { clock, STATES } from "./format.js";
import { keepStopLine, stop } from "./stop_line.js";
import { known, watch } from "./store.js";

const HELD_MS = 350;
const AGAIN_MS = 700; // a second press within this time is the same press
const FORGET_MS = 20_000; // after that, Esc begins with stop again
const RETRY_MS = 250; // between attempts to deliver a request that failed
const KEPT_MS = 60_000; // after this time the request is obsolete
const SHOWN_MS = 4000; // a confirmation; a message without confirmation stays until the user closes it

/** @typedef {"stop" | "abort" | "estop"} Stop */

/** @type {Record<Stop, [string, string, string]>} */
const VERBS = {
  stop: ["Stop", "Ends the step, brings the rig to rest, then the procedure's finish plays", "The rig is brought to rest."],
  abort: ["Abort", "Setpoints go to rest now; nothing else follows", "Setpoints go to rest."],
  estop: ["E-stop", "Requests the devices to drop power at once. This is software: the safety function is the hardware emergency stop", "The devices are requested to drop power."],
};

/** @type {{ verb: Stop | null, at: number }} */
let last = { verb: null, at: -Infinity };
let presses = 0;
/**
 * The stop that is being delivered.
 * @type {Stop | null}
 */
let underWay = null;

/** @type {Stop[]} */
const ORDER = ["stop", "abort", "estop"];

/** The result of the newest press, beside the buttons. */
class Outcome {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;

  constructor() {
    this.element = el("div", { class: "stop-result", hidden: true, role: "alert" });
  }

  /** @param {string} name */
  wait(name) {
    const since = el("span", { class: "since", "aria-hidden": "true" });
    const begun = performance.now();
    this.#show("ask", `${name} is on its way …`, since);
    this.#timer = setInterval(() => {
      const seconds = (performance.now() - begun) / 1000;
      if (seconds > 0.5) setText(since, `Not confirmed for ${seconds.toFixed(1)} s. The hardware emergency stop needs no network.`);
    }, 100);
  }

  /**
   * Show that the request failed, and is repeated until `giveUp` is called.
   * @param {string} name
   * @param {number} begun
   * @param {() => void} giveUp
   */
  keep(name, begun, giveUp) {
    const since = this.element.querySelector(".kept .since") ?? el("span", { class: "since", "aria-hidden": "true" });
    setText(since, `${Math.round((performance.now() - begun) / 1000)} s`);
    if (since.isConnected) return;
    this.#show("bad", `${name} NOT DELIVERED YET. Use the hardware emergency stop.`,
      el("p", { class: "kept" }, "It is sent as soon as the rig can be reached. Not delivered for ", since, "."),
      el("button", { type: "button", onclick: giveUp }, "Stop sending it"));
  }

  /**
   * @param {string} text
   * @param {string} note
   */
  confirm(text, note) {
    this.#show("calm", text, note);
    this.#timer = setTimeout(() => { this.element.hidden = true; }, SHOWN_MS);
  }

  /**
   * @param {string} name
   * @param {string} reason
   */
  fail(name, reason) {
    this.#show("bad", `${name} WAS NOT CONFIRMED. Use the hardware emergency stop.`, `At ${clock(Date.now())}: ${reason} `,
      el("button", { type: "button", onclick: () => { this.element.hidden = true; } }, "Seen"));
  }

  /**
   * @param {string} mood
   * @param {string} text
   * @param {...Child} notes
   */
  #show(mood, text, ...notes) {
    clearInterval(this.#timer); // also ends a time-out
    this.element.dataset.mood = mood;
    fill(this.element, el("strong", {}, text), ...notes);
    this.element.hidden = false;
  }
}

const outcome = new Outcome();

/** @param {Stop} verb */
async function send(verb) {
  const now = performance.now();
  if (last.verb === verb && now - last.at < AGAIN_MS) return;
  if (underWay !== null && ORDER.indexOf(verb) < ORDER.indexOf(underWay)) return; // a more severe request is in progress
  last = { verb, at: now };
  const mine = ++presses;
  underWay = verb;
  const [name, , follows] = VERBS[verb];
  outcome.wait(name);
  try {
    const { acted } = await deliver(verb, name, () => mine !== presses);
    if (mine !== presses) return; // a newer press is shown instead
    if (acted) outcome.confirm(`${name}: confirmed`, follows);
    else if (known.status === null || known.status.run === null) outcome.confirm(`${name}: nothing is running`, "");
    else outcome.confirm(`${name}: was requested already`, STATES[known.status.state][1]);
  } catch (error) {
    const { message } = asRefused(error);
    if (mine === presses) outcome.fail(name, message);
  } finally {
    if (mine === presses) underWay = null;
  }
}

/**
 * Send the request until there is an answer: a panel or a daemon that failed restarts within seconds.
 * @param {Stop} verb
 * @param {string} name
 * @param {() => boolean} isOver
 */
async function deliver(verb, name, isOver) {
  const begun = performance.now();
  let isGivenUp = false;
  for (;;) {
    try {
      return await stop(verb);
    } catch (error) {
      const refused = asRefused(error);
      if (refused.code !== "unreachable" || isOver() || isGivenUp) throw refused;
      if (performance.now() - begun > KEPT_MS) throw refused;
      outcome.keep(name, begun, () => { isGivenUp = true; });
      await new Promise((done) => setTimeout(done, RETRY_MS));
      if (isOver() || isGivenUp) throw refused;
    }
  }
}

/** The next stop by Esc: more severe than the last, if that is recent and the run still plays. */
function next() {
  if (last.verb === null || performance.now() - last.at > FORGET_MS) return "stop";
  return ORDER[Math.min(ORDER.indexOf(last.verb) + 1, ORDER.length - 1)];
}

/** @param {HTMLElement} root */
export function mountStops(root) {
  const buttons = ORDER.map((verb) => {
    const [name, meaning] = VERBS[verb];
    return el("button", {
      type: "button", class: `stop-${verb}`, title: meaning, "aria-description": meaning,
      // At the press, not at the release: only for this button that difference matters.
      onpointerdown: (event) => event.button === 0 && send(verb),
      onclick: (event) => event.detail === 0 && send(verb), // by keyboard or a screen reader
      onkeydown: (event) => event.repeat && event.preventDefault(), // a key held is one press
    }, name);
  });
  const hint = el("span", { class: "stop-hint", "aria-hidden": "true" });
  const ring = el("span", { class: "stop-ring", "aria-hidden": "true" });
  buttons[0].append(hint, ring);
  root.append(...buttons);
  keepStopLine();
  root.closest(".head")?.append(outcome.element);
  // Keys typed into a report stay there: it is a separate document.
  const isInReport = () => document.activeElement?.tagName === "IFRAME";
  const remind = () => setText(hint, isInReport() ? "Esc: leave the report first" : `hold Esc: ${VERBS[next()][0].toLowerCase()}`);
  setInterval(remind, 1000);
  remind();

  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const letGo = () => {
    clearTimeout(timer);
    timer = undefined;
    ring.classList.remove("held");
  };
  window.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || event.repeat || timer !== undefined) return;
    ring.classList.add("held");
    timer = setTimeout(() => {
      ring.classList.remove("held");
      send(next()).then(remind);
    }, HELD_MS);
  }, true);
  window.addEventListener("keyup", (event) => {
    if (event.key === "Escape") letGo();
  }, true);
  window.addEventListener("blur", () => {
    letGo();
    setTimeout(remind); // when the browser has updated the focus
  });
  window.addEventListener("focus", remind);

  watch(["status", "link"], () => {
    const idle = known.status?.run === null;
    root.classList.toggle("resting", idle && known.link === "ok");
    // The next run begins with stop again.
    if (idle && performance.now() - last.at > AGAIN_MS) last = { verb: null, at: -Infinity };
  });
}
