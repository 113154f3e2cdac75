// Nothing moves by an accidental press. This guards every button of the page: a press counts
// only on a button that has been still, uncovered and enabled for a while, and
// only if it began on that button. Repeats of a key that is held count for nothing. The stops are
// exempt: they act at once.

import { toast } from "./toasts.js";

export const SETTLE_MS = 600;
const LOOK_MS = 200;
const TOLD_MS = 2000;

const CONTROL = "button";
/** Exempt: the stops, and buttons that only change this page. */
const EXEMPT = [
  "#stops *", ".login *", ".traces *", ".trace-toggle", ".picker *", ".row-button", ".run-search *", ".user *", ".sound",
].join();

/** How long a scroll goes on by itself after the user's wheel, finger or key. */
const SCROLL_MS = 500;
const SCROLL_KEYS = new Set(["ArrowUp", "ArrowDown", "PageUp", "PageDown", "Home", "End", " ", "Tab"]);

/**
 * The look of each button, its place among what scrolls with it, and the time since which it has them.
 * @type {WeakMap<Element, { is: string, place: Place | null, since: number }>}
 */
const standing = new WeakMap();
/**
 * The button on which the newest press of the pointer began, and the same for each key that is down.
 * @typedef {{ control: Element | null, counts: boolean }} Press
 * @type {Press | null}
 */
let pointer = null;
/** @type {Map<string, Press>} */
const keys = new Map();
let toldAt = -Infinity;
/** The newest sign that the user scrolls. */
let scrolledAt = -Infinity;

/** @type {(target: EventTarget | null) => Element | null} */
const controlOf = (target) => {
  const found = target instanceof Element ? target.closest(CONTROL) : null;
  return found?.matches(EXEMPT) ? null : found;
};

/** The button that Enter or Space presses: the focused button, or that of the form with the focused field. */
const pressedBy = (/** @type {KeyboardEvent} */ { key, target }) => {
  const form = target instanceof HTMLInputElement || target instanceof HTMLSelectElement ? target.form : null;
  return controlOf(target) ?? (key === "Enter" ? controlOf(form?.querySelector("[type=submit]:enabled") ?? null) : null);
};

/**
 * The properties that make a button a different button for its user.
 * @param {Element} control
 */
function how(control) {
  const box = control.getBoundingClientRect();
  if (box.width === 0 || control.matches(":disabled") || control.closest("[inert]")) return "away";
  const top = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
  const isCovered = top !== null && !control.contains(top);
  return `${Math.round(box.left)} ${Math.round(box.top)} ${isCovered} ${control.textContent}`;
}

/** @param {Element} control */
function hasSettled(control) {
  return performance.now() - (standing.get(control)?.since ?? Infinity) >= SETTLE_MS;
}

/**
 * Where a button stands among what scrolls with it, and its text: the same wherever the user scrolls.
 * @typedef {{ left: number, top: number, text: string | null }} Place
 * @param {Element} control
 * @returns {Place}
 */
function placeOf(control) {
  let { left, top } = control.getBoundingClientRect();
  for (let part = control.parentElement; part !== null; part = part.parentElement) {
    left += part.scrollLeft;
    top += part.scrollTop;
  }
  return { left, top, text: control.textContent };
}

/** @type {(one: Place | null, other: Place | null) => boolean} */
const isSamePlace = (one, other) => one !== null && other !== null && one.text === other.text
  && Math.abs(one.left - other.left) < 1 && Math.abs(one.top - other.top) < 1;

/**
 * Note buttons that have appeared, moved, or changed. What the user has scrolled there has not moved: they
 * see it come.
 */
function look() {
  const now = performance.now();
  const isScrolling = now - scrolledAt < SCROLL_MS;
  for (const control of document.querySelectorAll(CONTROL)) {
    if (control.matches(EXEMPT)) continue;
    const is = how(control);
    const before = standing.get(control);
    if (before?.is !== is) {
      const place = is === "away" ? null : placeOf(control);
      const isSame = isScrolling && isSamePlace(before?.place ?? null, place);
      standing.set(control, { is, place, since: isSame && before !== undefined ? before.since : now });
    }
    const text = String(!hasSettled(control));
    if (control.ariaDisabled !== text) control.ariaDisabled = text;
  }
}

/**
 * Whether a press that begins now on `control` counts; if not, the wait begins again.
 * @param {Element} control
 */
function begin(control) {
  look();
  if (hasSettled(control)) return true;
  const stands = standing.get(control);
  if (stands !== undefined) stands.since = performance.now();
  return false;
}

/** @param {Event} event */
function refuse(event) {
  event.preventDefault();
  event.stopImmediatePropagation();
  if (performance.now() - toldAt < TOLD_MS) return;
  toldAt = performance.now();
  toast("That press did not count: the page had just changed. Press again.", "warn", TOLD_MS);
}

/** @param {KeyboardEvent} event */
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

/** @param {MouseEvent} event */
function onClick(event) {
  const control = controlOf(event.target);
  if (control === null) return;
  let counts;
  if (event.detail > 0) counts = pointer?.control === control && pointer.counts;
  else if (keys.size > 0) counts = [...keys.values()].some((item) => item.control === control && item.counts);
  else counts = begin(control); // by a screen reader, which presses without pointer and key
  pointer = null;
  for (const item of keys.values()) item.counts = false;
  if (!counts) refuse(event);
}

/** Watch the buttons of this page from now on. */
export function guardPresses() {
  const first = { capture: true };
  window.addEventListener("pointerdown", ({ target }) => {
    const control = controlOf(target);
    pointer = { control, counts: control !== null && begin(control) };
  }, first);
  window.addEventListener("keydown", onKeyDown, first);
  // Space presses when the key is released, after the listeners of that event.
  window.addEventListener("keyup", ({ code }) => setTimeout(() => keys.delete(code)), first);
  window.addEventListener("blur", () => keys.clear());
  window.addEventListener("click", onClick, first);
  // At once when buttons appear or disappear, so that no button looks enabled too early. Other movements
  // are noticed a little later, and in any case at the press.
  new MutationObserver((changes) => {
    /** @param {MutationRecord} change */
    const counts = ({ type, addedNodes, removedNodes }) =>
      type === "attributes" || [...addedNodes, ...removedNodes].some((item) => item instanceof Element);
    if (changes.some(counts)) look();
  }).observe(document.body, { subtree: true, childList: true, attributeFilter: ["disabled", "hidden", "inert", "open"] });
  const scrolls = () => { scrolledAt = performance.now(); };
  for (const kind of ["wheel", "touchmove"]) window.addEventListener(kind, scrolls, { capture: true, passive: true });
  window.addEventListener("keydown", ({ key }) => SCROLL_KEYS.has(key) && scrolls(), first);
  window.addEventListener("pointerdown", ({ clientX }) => clientX >= document.documentElement.clientWidth && scrolls(), first); // the bar
  window.addEventListener("scroll", () => {
    if (performance.now() - scrolledAt < SCROLL_MS) scrolls(); // it goes on
    look();
  }, first);
  setInterval(look, LOOK_MS);
  look();
}
