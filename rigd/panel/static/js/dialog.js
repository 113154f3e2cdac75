// A dialog that leaves the stops within reach. The browser's own modal dialogs make everything else
// inert, the stops too; this one leaves the head of the page as it is. The dialog itself gets the
// keyboard, none of its buttons: Enter answers nothing until somebody has gone to a button.

import { el, fill } from "./dom.js";

const BEHIND = ["bar", "attention", "main"].map((id) => document.getElementById(id));

/** Open a dialog with what `contents(close)` returns; Esc, or a press beside it, closes it. */
export function openDialog(label, contents) {
  const before = document.activeElement;
  const dialog = el("dialog", { "aria-label": label, tabIndex: -1 });
  const shade = el("div", { class: "shade", onclick: () => dialog.close() });
  const onKey = (event) => event.key === "Escape" && dialog.close();
  dialog.addEventListener("close", () => {
    window.removeEventListener("keydown", onKey);
    for (const part of BEHIND) part.inert = false;
    shade.remove();
    dialog.remove();
    if (before.isConnected) before.focus();
  });
  window.addEventListener("keydown", onKey);
  for (const part of BEHIND) part.inert = true;
  fill(dialog, contents(() => dialog.close()));
  document.getElementById("app").append(shade, dialog);
  dialog.show();
  dialog.focus();
}
