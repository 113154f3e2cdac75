// A dialog that keeps the stops usable. The browser's own modal dialogs disable everything else, the
// stops too; this dialog does not change the head of the page. The dialog itself gets the focus, not
// its buttons: Enter does nothing until the user has moved the focus to a button.

import { byId, el, fill } from "./dom.js";

const BEHIND = ["bar", "attention", "main"].map(byId);

/**
 * Open a dialog with what `contents(close)` returns; Esc, or a press outside, closes it.
 * @param {string} label
 * @param {(close: () => void) => Child} contents
 */
export function openDialog(label, contents) {
  const before = document.activeElement;
  const dialog = el("dialog", { "aria-label": label, tabIndex: -1 });
  const shade = el("div", { class: "shade", onclick: () => dialog.close() });
  /** @param {KeyboardEvent} event */
  const onKey = (event) => event.key === "Escape" && dialog.close();
  dialog.addEventListener("close", () => {
    window.removeEventListener("keydown", onKey);
    for (const part of BEHIND) part.inert = false;
    shade.remove();
    dialog.remove();
    if (before instanceof HTMLElement && before.isConnected) before.focus();
  });
  window.addEventListener("keydown", onKey);
  for (const part of BEHIND) part.inert = true;
  fill(dialog, contents(() => dialog.close()));
  byId("app").append(shade, dialog);
  dialog.show();
  dialog.focus();
}
