// What waits for a person: questions, trips, runs that were interrupted, and who asks for control.

import { command, control } from "./api.js";
import { el, file, icon } from "./dom.js";
import { ACTIONS, clock, words } from "./format.js";
import { promptCard } from "./prompt.js";
import { resumeButton } from "./resume.js";
import { hasControl, known, put, watch } from "./store.js";
import { attempt } from "./toasts.js";

/** How long the place of a card that went stays empty after a press there. */
const EMPTY_MS = 3000;

export function mountAttention(root) {
  let pressedAt = -Infinity;
  for (const kind of ["pointerdown", "keydown"]) root.addEventListener(kind, () => { pressedAt = performance.now(); });

  /** Take a card away; while somebody presses here, nothing else moves to its place. */
  function leave(card) {
    const empty = el("div", { class: "gone" });
    empty.style.setProperty("--height", `${card.getBoundingClientRect().height}px`);
    card.replaceWith(empty);
    const close = () => {
      const left = pressedAt + EMPTY_MS - performance.now();
      if (left > 0) setTimeout(close, left);
      else empty.remove();
    };
    close();
  }

  const cards = new Map(); // what it says -> its element: a card that still holds is left alone
  watch(["status", "link"], () => {
    if (known.status === null) return;
    const wanted = new Map(known.link === "ok" ? list(known.status) : []);
    for (const [key, card] of cards) {
      if (wanted.has(key)) continue;
      leave(card);
      cards.delete(key);
    }
    let place = null;
    for (const [key, make] of wanted) {
      if (!cards.has(key)) {
        for (const empty of root.querySelectorAll(".gone")) empty.remove(); // something new stands there
        cards.set(key, make());
        if (place === null) root.prepend(cards.get(key));
        else place.after(cards.get(key));
        cards.get(key).scrollIntoView({ block: "nearest" });
      }
      place = cards.get(key);
    }
  });
}

function list(status) {
  const mine = hasControl();
  const key = (kind, what) => JSON.stringify([kind, what, mine]);
  const cards = [];
  const { prompt, control: lease } = status;
  if (prompt !== null) cards.push([key("prompt", prompt), () => promptCard(prompt, mine)]);
  for (const trip of status.trips) {
    if (!trip.acknowledged) cards.push([key("trip", trip), () => tripCard(trip, mine)]);
  }
  if (mine) {
    for (const user of lease.users_asking) cards.push([key("user", user), () => askingCard(user.name, { session: user.session })]);
    for (const client of lease.asked_by) cards.push([key("client", client), () => askingCard(client, { client })]);
  }
  const [newest, ...older] = status.interrupted;
  if (status.run === null && newest !== undefined && newest.run !== putOff) {
    cards.push([key("interrupted", [newest, older.length]), () => interruptedCard(newest, older.length, mine)]);
  }
  return cards;
}

/** The interrupted run that nobody at this page wants to go on with now. */
let putOff = null;

function tripCard(trip, mine) {
  const acknowledge = el("button", {
    type: "button", class: "primary", disabled: !mine,
    onclick: () => attempt(acknowledge, () => command("acknowledge", { interlock: trip.interlock })),
  }, icon("check"), "Acknowledge");
  return el("section", { class: "card trip", data: { mood: trip.action === "warn" ? "warn" : "bad" } },
    icon("warn"),
    el("div", { class: "card-text" },
      el("h2", {}, `Interlock ${words(trip.interlock)} ${ACTIONS[trip.action]}`),
      el("p", {}, trip.message),
      el("p", { class: "quiet" }, `At ${clock(trip.since_ns / 1e6)}. ${reminder(mine)}`)),
    acknowledge);
}

const reminder = (mine) => mine
  ? "Look at the rig before you acknowledge."
  : "Only who has control can acknowledge it.";

function interruptedCard(one, older, mine) {
  const resume = resumeButton(one.run, mine);
  const later = el("button", {
    type: "button", onclick: () => {
      putOff = one.run;
      put("status", known.status);
    },
  }, "Not now");
  return el("section", { class: "card", data: { mood: "ask" } },
    icon("cut"),
    el("div", { class: "card-text" },
      el("h2", {}, `A run was interrupted after ${one.trials_done} of ${one.trials_total} trials`),
      el("p", {}, file(one.run)),
      el("p", { class: "quiet" }, `${one.reason}.${older ? ` ${older} more, in the list of runs.` : ""}`)),
    el("div", { class: "card-buttons" }, later, resume));
}

function askingCard(name, to) {
  const give = el("button", {
    type: "button", class: "primary", onclick: () => attempt(give, () => control("give", to)),
  }, icon("hand"), "Hand over");
  return el("section", { class: "card", data: { mood: "ask" } },
    icon("hand"),
    el("div", { class: "card-text" },
      el("h2", {}, `${name} asks for control`),
      el("p", { class: "quiet" }, "Until you hand it over, you keep it.")),
    give);
}
