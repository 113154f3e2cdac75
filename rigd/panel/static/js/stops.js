// Stop, abort, estop: always there, for everybody, each with one press. On the keyboard, Esc held for
// a moment: the first time it stops, again it aborts, again it asks for power to drop. A tap of Esc,
// which closes dialogs, does nothing.

import { stop } from "./api.js";
import { el, say } from "./dom.js";
import { known, watch } from "./store.js";
import { alarm, toast } from "./toasts.js";

const HELD_MS = 350;
const AGAIN_MS = 700; // a second press so soon is the same press
const FORGET_MS = 20_000; // after that, Esc begins with stop again

const VERBS = {
  stop: ["Stop", "Ends the step, brings the rig to rest, then the procedure's finish plays"],
  abort: ["Abort", "Setpoints go to rest now; nothing else follows"],
  estop: ["E-stop", "Asks for power to drop at once. This is software: the safety function is the hardware emergency stop"],
};

let last = { verb: null, at: -Infinity };

async function send(verb) {
  const now = performance.now();
  if (last.verb === verb && now - last.at < AGAIN_MS) return;
  last = { verb, at: now };
  try {
    const { acted } = await stop(verb);
    toast(acted ? `${VERBS[verb][0]}: the rig obeys.` : `${VERBS[verb][0]}: there is nothing to stop.`);
  } catch (refused) {
    alarm(`${VERBS[verb][0]} WAS NOT CONFIRMED. Use the hardware emergency stop. (${refused.message})`);
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
  const remind = () => say(hint, `hold Esc: ${VERBS[next()][0].toLowerCase()}`);
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
  window.addEventListener("blur", letGo);

  watch(["status", "link"], () => {
    const idle = known.status?.run === null;
    root.classList.toggle("resting", idle && known.link === "ok");
    if (idle && performance.now() - last.at > AGAIN_MS) last = { verb: null, at: -Infinity };
  });
}
