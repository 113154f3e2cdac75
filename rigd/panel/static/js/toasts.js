// Short notes that disappear by themselves.

import { asRefused } from "./api.js";
import { byId, el } from "./dom.js";
import { withHint } from "./format.js";

const SHOWN_MS = 6000;

/** @param {string} text */
export function toast(text, mood = "calm", shownMs = SHOWN_MS) {
  const note = el("p", { class: "toast", data: { mood } }, text);
  show(note);
  setTimeout(() => note.remove(), shownMs);
}

/**
 * The error, with its remedy.
 * @param {import("./api.js").Refused} refused
 */
export function complain(refused) {
  const note = el("p", { class: "toast", role: "alert", data: { mood: "warn" } }, withHint(refused));
  show(note);
  setTimeout(() => note.remove(), 2 * SHOWN_MS);
}

/** @param {HTMLElement} note */
function show(note) {
  const root = byId("toasts");
  root.append(note);
  while (root.children.length > 5) root.firstElementChild?.remove();
}

/**
 * Carry out the action of a button, with the button disabled meanwhile; null if it was refused.
 * @template T
 * @param {Element | null} pressed
 * @param {() => Promise<T>} action
 * @returns {Promise<T | null>}
 */
export async function attempt(pressed, action) {
  const button = /** @type {HTMLButtonElement} */ (pressed);
  button.disabled = true;
  try {
    return await action();
  } catch (error) {
    complain(asRefused(error));
    return null;
  } finally {
    button.disabled = false;
  }
}
