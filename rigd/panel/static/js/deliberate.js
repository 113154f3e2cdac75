// Nothing moves by a press that nobody meant. Every button of the page is looked after here, whoever
// made it: a press counts only on a button that has stood still, uncovered and ready for a while, and
// only if it began on that button. Repeats of a key that is held count for nothing. The stops are
// exempt: they act at once.

import { toast } from "./toasts.js";

const SETTLE_MS = 600;
const LOOK_MS = 100;
const TOLD_MS = 2000;

const CONTROL = "button";
/** The stops, and what changes nothing but what this page shows. */
const EXEMPT = [
  "#stops *", ".login *", ".traces *", ".trace-toggle", ".picker *", ".row-button", ".user *", ".sound",
].join();

/** Of each button: how it stands, and since when. */
const standing = new WeakMap();
/** Where the newest press of the pointer began, and of each key that is down. */
let pointer = null;
const keys = new Map();
let toldAt = -Infinity;

const controlOf = (target) => {
  const found = target instanceof Element ? target.closest(CONTROL) : null;
  return found?.matches(EXEMPT) ? null : found;
};

/** The button that Enter or Space presses: itself, or that of the form whose field has the keyboard. */
const pressedBy = ({ key, target }) =>
  controlOf(target) ?? (key === "Enter" && target.form ? controlOf(target.form.querySelector("[type=submit]:enabled")) : null);

/** All that makes a button another one for whoever presses it. */
function how(control) {
  const box = control.getBoundingClientRect();
  if (box.width === 0 || control.matches(":disabled") || control.closest("[inert]")) return "away";
  const top = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
  const isCovered = top !== null && !control.contains(top);
  return `${Math.round(box.left)} ${Math.round(box.top)} ${isCovered} ${control.textContent}`;
}

function hasSettled(control) {
  return performance.now() - standing.get(control).since >= SETTLE_MS;
}

/** Note what has appeared, moved, or become another. */
function look() {
  const now = performance.now();
  for (const control of document.querySelectorAll(CONTROL)) {
    if (control.matches(EXEMPT)) continue;
    const is = how(control);
    if (standing.get(control)?.is !== is) standing.set(control, { is, since: now });
    const text = String(!hasSettled(control));
    if (control.ariaDisabled !== text) control.ariaDisabled = text;
  }
}

/** Whether a press that begins now on `control` counts; one that does not begins the wait anew. */
function begin(control) {
  look();
  if (hasSettled(control)) return true;
  standing.get(control).since = performance.now();
  return false;
}

function refuse(event) {
  event.preventDefault();
  event.stopImmediatePropagation();
  if (performance.now() - toldAt < TOLD_MS) return;
  toldAt = performance.now();
  toast("That press did not count: the page had just changed. Press again.", "warn", TOLD_MS);
}

function onKeyDown(event) {
  if (event.key !== "Enter" && event.key !== " ") return;
  const control = pressedBy(event);
  if (event.repeat) {
    if (control !== null) refuse(event);
    return;
  }
  const counts = control !== null && begin(control);
  keys.set(event.code, { control, counts });
  if (control !== null && !counts) refuse(event);
}

function onClick(event) {
  const control = controlOf(event.target);
  if (control === null) return;
  let counts;
  if (event.detail > 0) counts = pointer?.control === control && pointer.counts;
  else if (keys.size > 0) counts = [...keys.values()].some((one) => one.control === control && one.counts);
  else counts = begin(control); // by a screen reader, which presses without pointer and key
  pointer = null;
  for (const one of keys.values()) one.counts = false;
  if (!counts) refuse(event);
}

/** Look after the buttons of this page, from now on. */
export function guardPresses() {
  const first = { capture: true };
  window.addEventListener("pointerdown", ({ target }) => {
    const control = controlOf(target);
    pointer = { control, counts: control !== null && begin(control) };
  }, first);
  window.addEventListener("keydown", onKeyDown, first);
  // Space presses when it is let go, behind the listeners of that event.
  window.addEventListener("keyup", ({ code }) => setTimeout(() => keys.delete(code)), first);
  window.addEventListener("blur", () => keys.clear());
  window.addEventListener("click", onClick, first);
  // At once where buttons come and go, so that none looks ready that is not; whatever else moves
  // them is seen a little later, and at the press itself in any case.
  new MutationObserver((changes) => {
    const counts = ({ type, addedNodes, removedNodes }) =>
      type === "attributes" || [...addedNodes, ...removedNodes].some((one) => one instanceof Element);
    if (changes.some(counts)) look();
  }).observe(document.body, { subtree: true, childList: true, attributeFilter: ["disabled", "hidden", "inert", "open"] });
  window.addEventListener("scroll", look, first);
  setInterval(look, LOOK_MS);
  look();
}
