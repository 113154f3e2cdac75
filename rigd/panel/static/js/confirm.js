// Asks for confirmation before a rig moves: which rig, procedure and values, and how long it takes.

import { openDialog } from "./dialog.js";
import { el, icon } from "./dom.js";
import { read } from "./store.js";
import { attempt } from "./toasts.js";

/** @type {Record<string, string>} */
export const LOSS = {
  stop: "the run stops",
  finish_trial: "the trial is finished, then the run stops",
  continue: "the run continues without you",
};

/** @typedef {"" | NonNullable<Api.StartArguments["on_client_loss"]>} Loss */

/**
 * Ask whether to start a run. `facts` are names with a text or an element, or null to leave it
 * out; `usual` is
 * the action of the procedure when the page of its user disconnects, "" if unknown;
 * `go(loss)` starts the run, once `ready()` is true.
 * @param {{ title: string, facts: [string, Child][], note?: Child, action: string, usual: string, ready?: () => boolean, go: (loss: Loss) => Promise<void> }} question
 */
export function confirmRun({ title, facts, note = null, action, usual, ready = () => true, go }) {
  openDialog(title, (close) => {
    const loss = lossChoice(usual);
    /** @type {HTMLButtonElement} */
    const start = el("button", {
      type: "button", class: "primary big",
      onclick: async () => {
        if (!ready()) return null;
        const begun = await attempt(start, () => go(loss.value()));
        close();
        return begun;
      },
    }, icon("play"), action);
    const { title: called, rig: name, simulated } = read("describe");
    return [
      el("h2", {}, title),
      el("dl", { class: "facts" },
        el("dt", {}, "Rig"), el("dd", {}, el("strong", {}, name), called ? ` – ${called}` : "", simulated ? "" : " – it will move"),
        facts.filter(([, value]) => value !== null).map(([term, value]) => [el("dt", {}, term), el("dd", {}, value)])),
      note,
      loss.element,
      simulated ? null : el("p", {}, "Make sure that no person is within its reach."),
      el("div", { class: "row end" },
        el("button", { type: "button", onclick: close }, "Cancel"), start),
    ];
  });
}

/**
 * The choice of what happens to the run when this page closes; `value()` is "" for the
 * procedure's own choice.
 * @param {string} usual
 */
function lossChoice(usual) {
  /** @type {Record<string, string>} */
  const unknown = usual ? {} : { "": "as the procedure specifies" };
  const choices = Object.entries({ ...unknown, ...LOSS }).map(([value, text]) => {
    const input = el("input", { type: "radio", name: "on-loss", value, checked: value === usual });
    return el("label", {}, input, value && value === usual ? `${text} (as the procedure specifies)` : text);
  });
  const element = el("fieldset", { class: "choices loss" },
    el("legend", {}, "If you close this page, or it loses its connection"), choices);
  const value = () => {
    const chosen = /** @type {HTMLInputElement | null} */ (element.querySelector(":checked"))?.value ?? usual;
    return /** @type {Loss} */ (chosen === usual ? "" : chosen);
  };
  return { element, value };
}
