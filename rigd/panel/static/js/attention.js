// Cards that need a person: prompts, trips, interrupted runs, and requests for control.

import { command } from "./api.js";
import { SETTLE_MS } from "./deliberate.js";
import { el, file, icon } from "./dom.js";
import { ACTIONS, clock, date, words } from "./format.js";
import { promptCard } from "./prompt.js";
import { resumeButton } from "./resume.js";
import { hasControl, known, nameOf, put, watch } from "./store.js";
import { attempt } from "./toasts.js";

/** How long the place of a removed card is kept after a press there: the next question comes to it. */
const KEPT_MS = SETTLE_MS;

/** @param {HTMLElement} root */
export function mountAttention(root) {
  let pressedAt = -Infinity;
  for (const kind of ["pointerdown", "keydown"]) root.addEventListener(kind, () => { pressedAt = performance.now(); });

  /**
   * Remove a card; while the user presses here, nothing else moves to its place.
   * @param {HTMLElement} card
   */
  function leave(card) {
    const empty = el("div", { class: "gone quiet", role: "status" }, card.dataset.done ?? "");
    empty.style.setProperty("--height", `${card.getBoundingClientRect().height}px`);
    card.replaceWith(empty);
    const close = () => {
      const left = pressedAt + KEPT_MS - performance.now();
      if (left > 0) setTimeout(close, left);
      else empty.remove();
    };
    close();
  }

  /**
   * By content: a card that is still valid is not replaced.
   * @type {Map<string, HTMLElement>}
   */
  const cards = new Map();
  watch(["status", "link"], () => {
    if (known.status === null) return;
    const wanted = new Map(known.link === "ok" ? list(known.status) : []);
    for (const [key, card] of cards) {
      if (wanted.has(key)) continue;
      leave(card);
      cards.delete(key);
    }
    /** @type {HTMLElement | null} */
    let place = null;
    for (const [key, make] of wanted) {
      let card = cards.get(key);
      if (card === undefined) {
        for (const empty of root.querySelectorAll(".gone")) empty.remove(); // a new card is there
        card = make();
        cards.set(key, card);
        if (place === null) root.prepend(card);
        else place.after(card);
        card.scrollIntoView({ block: "nearest" });
      }
      place = card;
    }
  });
}

/** @param {Api.PageStatus} status */
function list(status) {
  const mine = hasControl();
  /** @type {(kind: string, content: unknown) => string} */
  const key = (kind, content) => JSON.stringify([kind, content, mine]);
  /** @type {[string, () => HTMLElement][]} */
  const cards = [];
  const { prompt, lease } = status;
  if (prompt !== null) cards.push([key("prompt", prompt), () => promptCard(prompt, mine)]);
  for (const trip of status.trips) {
    if (!trip.acknowledged) cards.push([key("trip", trip), () => tripCard(trip, mine)]);
  }
  if (mine) {
    for (const other of lease.asked_by) cards.push([key("asking", other), () => askingCard(other)]);
  }
  for (const item of status.certificates) {
    if (!putOff.has(item.name)) cards.push([key("certificate", [item, item.until_ns < status.t_ns]), () => certificateCard(item, status.t_ns)]);
  }
  const [newest, ...older] = status.interrupted;
  if (status.run === null && newest !== undefined && !putOff.has(newest.run)) {
    cards.push([key("interrupted", [newest, older.length]), () => interruptedCard(newest, older.length, mine)]);
  }
  return cards;
}

/**
 * The interrupted runs and the certificates that this page does not show now.
 * @type {Set<string>}
 */
const putOff = new Set();

/** @param {string} name */
const notNow = (name) => el("button", {
  type: "button", onclick: () => {
    putOff.add(name);
    put("status", known.status);
  },
}, "Not now");

const WHOSE = { daemon: "The daemon's certificate", authority: "The authority that signs all certificates", client: "The certificate of the client" };

/**
 * A certificate that expires soon, or has expired.
 * @param {Api.CertificateView} item
 * @param {number} nowNs
 */
function certificateCard({ whose, name, until_ns: untilNs }, nowNs) {
  const isOver = untilNs < nowNs;
  const follows = whose === "client" ? `${name} cannot connect` : "no client can connect, nor stop the rig from elsewhere";
  return el("section", { class: "card", data: { mood: isOver ? "bad" : "ask" } },
    icon("warn"),
    el("div", { class: "card-text" },
      el("h2", {}, `${WHOSE[whose]} ${name} ${isOver ? "expired" : "expires"} on ${date(untilNs / 1e6)}`),
      el("p", { class: "quiet" }, `From then on ${follows}. The person who keeps the certificates of this rig has to renew it.`)),
    notNow(name));
}

/**
 * @param {Api.TripView} trip
 * @param {boolean} mine
 */
function tripCard(trip, mine) {
  /** @type {HTMLButtonElement} */
  const acknowledge = el("button", {
    type: "button", class: "primary", disabled: !mine,
    onclick: () => attempt(acknowledge, () => {
      card.dataset.done = `${words(trip.interlock)}: acknowledged`;
      return command("acknowledge", { interlock: trip.interlock, since_ns: trip.since_ns });
    }),
  }, icon("check"), "Acknowledge");
  const card = el("section", { class: "card trip", data: { mood: trip.action === "warn" ? "warn" : "bad" } },
    icon("warn"),
    el("div", { class: "card-text" },
      el("h2", {}, `Interlock ${words(trip.interlock)} ${ACTIONS[trip.action]}`),
      el("p", {}, trip.message),
      el("p", { class: "quiet" }, `At ${clock(trip.since_ns / 1e6)}. ${reminder(mine)}`)),
    acknowledge);
  return card;
}

/** @param {boolean} mine */
const reminder = (mine) => mine
  ? "Look at the rig before you acknowledge."
  : "Only the person who has control can acknowledge it.";

/**
 * @param {Api.Interrupted} item
 * @param {number} older
 * @param {boolean} mine
 */
function interruptedCard(item, older, mine) {
  const resume = resumeButton(item.run, mine);
  return el("section", { class: "card", data: { mood: "ask" } },
    icon("cut"),
    el("div", { class: "card-text" },
      el("h2", {}, `A run was interrupted after ${item.trials_done} of ${item.trials_total} trials`),
      el("p", {}, file(item.run)),
      el("p", { class: "quiet" }, `${item.reason}.${older ? ` ${older} more, in the list of runs.` : ""}`)),
    el("div", { class: "card-buttons" }, notNow(item.run), resume));
}

/** @param {Api.ClientUser} other */
function askingCard(other) {
  /** @type {HTMLButtonElement} */
  const give = el("button", {
    type: "button", class: "primary", onclick: () => attempt(give, () => command("lease_give", { to: other.identity, user: other.user })),
  }, icon("hand"), "Hand over");
  return el("section", { class: "card", data: { mood: "ask" } },
    icon("hand"),
    el("div", { class: "card-text" },
      el("h2", {}, `${nameOf(other)} requests control`),
      el("p", { class: "quiet" }, "Until you hand it over, you keep it.")),
    give);
}
