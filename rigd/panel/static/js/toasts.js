// Short notes that go by themselves.

import { el } from "./dom.js";
import { withHint } from "./format.js";

const SHOWN_MS = 6000;

export function toast(text, mood = "calm", shownMs = SHOWN_MS) {
  const note = el("p", { class: "toast", data: { mood } }, text);
  show(note);
  setTimeout(() => note.remove(), shownMs);
}

/** What went wrong, with what to do about it. */
export function complain(refused) {
  const note = el("p", { class: "toast", role: "alert", data: { mood: "warn" } }, withHint(refused));
  show(note);
  setTimeout(() => note.remove(), 2 * SHOWN_MS);
}

function show(note) {
  const root = document.getElementById("toasts");
  root.append(note);
  while (root.children.length > 5) root.firstChild.remove();
}

/** Do what a button asks for, with the button switched off meanwhile. */
export async function attempt(button, action) {
  button.disabled = true;
  try {
    return await action();
  } catch (refused) {
    if (refused.code === undefined) throw refused;
    complain(refused);
    return null;
  } finally {
    button.disabled = false;
  }
}
