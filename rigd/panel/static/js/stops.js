// Stop, abort, estop: always there, for everybody, each with one press. On the keyboard, Esc held for
// a moment: the first time it stops, again it aborts, again it asks for power to drop. A tap of Esc,
// which closes dialogs, does nothing.

import { el, fill, say } from "./dom.js";
import { clock, STATES } from "./format.js";
import { keepStopLine, stop } from "./stop_line.js";
import { known, watch } from "./store.js";

const HELD_MS = 350;
const AGAIN_MS = 700; // a second press so soon is the same press
const FORGET_MS = 20_000; // after that, Esc begins with stop again
const RETRY_MS = 250; // between attempts to deliver what did not get through
const KEPT_MS = 60_000; // after that, what was meant by it is long past
const SHOWN_MS = 8000; // a confirmation; what was not confirmed stays until somebody has seen it

const VERBS = {
  stop: ["Stop", "Ends the step, brings the rig to rest, then the procedure's finish plays", "The rig is brought to rest."],
  abort: ["Abort", "Setpoints go to rest now; nothing else follows", "Setpoints go to rest."],
  estop: ["E-stop", "Asks for power to drop at once. This is software: the safety function is the hardware emergency stop", "Power is asked to drop."],
};

let last = { verb: null, at: -Infinity };
let presses = 0;
let underWay = null; // the verb that is being delivered

const ORDER = Object.keys(VERBS);

/** What became of the newest press, beside the buttons. */
class Outcome {
  #timer = null;

  constructor() {
    this.element = el("div", { class: "stop-told", hidden: true, role: "alert" });
  }

  wait(name) {
    const since = el("span", { class: "since", "aria-hidden": "true" });
    const begun = performance.now();
    this.#show("ask", `${name} is on its way …`, since);
    this.#timer = setInterval(() => {
      const seconds = (performance.now() - begun) / 1000;
      if (seconds > 0.5) say(since, `Not confirmed for ${seconds.toFixed(1)} s. The hardware emergency stop needs no network.`);
    }, 100);
  }

  /** It did not get through, and is tried again until `giveUp` is called. */
  keep(name, begun, giveUp) {
    const since = this.element.querySelector(".kept .since") ?? el("span", { class: "since", "aria-hidden": "true" });
    say(since, `${Math.round((performance.now() - begun) / 1000)} s`);
    if (since.isConnected) return;
    this.#show("bad", `${name} NOT DELIVERED YET. Use the hardware emergency stop.`,
      el("p", { class: "kept" }, "It is sent as soon as the rig can be reached. Not delivered for ", since, "."),
      el("button", { type: "button", onclick: giveUp }, "Do not send it any more"));
  }

  confirm(text, note) {
    this.#show("calm", text, note);
    this.#timer = setTimeout(() => { this.element.hidden = true; }, SHOWN_MS);
  }

  fail(name, reason) {
    this.#show("bad", `${name} WAS NOT CONFIRMED. Use the hardware emergency stop.`, `At ${clock(Date.now())}: ${reason} `,
      el("button", { type: "button", onclick: () => { this.element.hidden = true; } }, "Seen"));
  }

  #show(mood, text, ...notes) {
    clearInterval(this.#timer); // which ends a time-out as well
    this.element.dataset.mood = mood;
    fill(this.element, el("strong", {}, text), ...notes);
    this.element.hidden = false;
  }
}

const outcome = new Outcome();

async function send(verb) {
  const now = performance.now();
  if (last.verb === verb && now - last.at < AGAIN_MS) return;
  if (ORDER.indexOf(verb) < ORDER.indexOf(underWay)) return; // what was asked for goes further
  last = { verb, at: now };
  const mine = ++presses;
  underWay = verb;
  const [name, , follows] = VERBS[verb];
  outcome.wait(name);
  try {
    const { acted } = await deliver(verb, name, () => mine !== presses);
    if (mine !== presses) return; // something was pressed since, and is told instead
    if (acted) outcome.confirm(`${name}: confirmed`, follows);
    else if (known.status?.run == null) outcome.confirm(`${name}: nothing is running`, "");
    else outcome.confirm(`${name}: was asked for already`, STATES[known.status.state][1]);
  } catch (refused) {
    if (refused.code === undefined) throw refused;
    if (mine === presses) outcome.fail(name, refused.message);
  } finally {
    if (mine === presses) underWay = null;
  }
}

/** Ask until somebody answers: a panel or a daemon that died is started anew within seconds. */
async function deliver(verb, name, isOver) {
  const begun = performance.now();
  let isGivenUp = false;
  for (;;) {
    try {
      return await stop(verb);
    } catch (refused) {
      if (refused.code !== "unreachable" || isOver() || isGivenUp) throw refused;
      if (performance.now() - begun > KEPT_MS) throw refused;
      outcome.keep(name, begun, () => { isGivenUp = true; });
      await new Promise((done) => setTimeout(done, RETRY_MS));
      if (isOver() || isGivenUp) throw refused;
    }
  }
}

/** What Esc does next: one more than the last, while that is not long ago and something still plays. */
function next() {
  if (performance.now() - last.at > FORGET_MS) return "stop";
  return { stop: "abort", abort: "estop", estop: "estop" }[last.verb] ?? "stop";
}

export function mountStops(root) {
  const buttons = Object.entries(VERBS).map(([verb, [name, meaning]]) =>
    el("button", {
      type: "button", class: `stop-${verb}`, title: meaning, "aria-description": meaning,
      // At the press, not at the release: this is the one button where that matters.
      onpointerdown: (event) => event.button === 0 && send(verb),
      onclick: (event) => event.detail === 0 && send(verb), // by keyboard or a reader
    }, name),
  );
  const hint = el("span", { class: "stop-hint", "aria-hidden": "true" });
  const ring = el("span", { class: "stop-ring", "aria-hidden": "true" });
  buttons[0].append(hint, ring);
  root.append(...buttons);
  keepStopLine();
  root.closest(".head").append(outcome.element);
  // What is typed into a report stays there: it is a document of its own.
  const isInReport = () => document.activeElement?.tagName === "IFRAME";
  const remind = () => say(hint, isInReport() ? "Esc: leave the report first" : `hold Esc: ${VERBS[next()][0].toLowerCase()}`);
  setInterval(remind, 1000);
  remind();

  let timer = null;
  const letGo = () => {
    clearTimeout(timer);
    timer = null;
    ring.classList.remove("held");
  };
  window.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || event.repeat || timer !== null) return;
    ring.classList.add("held");
    timer = setTimeout(() => {
      ring.classList.remove("held");
      send(next()).then(remind);
    }, HELD_MS);
  }, true);
  window.addEventListener("keyup", (event) => event.key === "Escape" && letGo(), true);
  window.addEventListener("blur", () => {
    letGo();
    setTimeout(remind); // when the browser has noted who has the keyboard now
  });
  window.addEventListener("focus", remind);

  watch(["status", "link"], () => {
    const idle = known.status?.run === null;
    root.classList.toggle("resting", idle && known.link === "ok");
    // The next run begins with stop again.
    if (idle && performance.now() - last.at > AGAIN_MS) last = { verb: null, at: -Infinity };
  });
}
