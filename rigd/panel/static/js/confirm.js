// What is asked before a rig moves: which rig, by what, with which values, for how long.

import { openDialog } from "./dialog.js";
import { el, icon } from "./dom.js";
import { known } from "./store.js";
import { attempt } from "./toasts.js";

export const LOSS = {
  stop: "the run stops",
  finish_trial: "the trial is finished, then the run stops",
  continue: "the run goes on without you",
};

/**
 * Ask whether a run is to begin. `facts` are names with what they are, a text or an element; `usual` is
 * what the procedure does when the page of its user is gone, "" where this page does not know that;
 * `go(loss)` begins it.
 */
export function confirmRun({ title, facts, note = null, action, usual, go }) {
  openDialog(title, (close) => {
    const loss = lossChoice(usual);
    const start = el("button", {
      type: "button", class: "primary big",
      onclick: async () => {
        const begun = await attempt(start, () => go(loss.value()));
        close();
        return begun;
      },
    }, icon("play"), action);
    const { title: rig, rig: name, simulated } = known.describe;
    return [
      el("h2", {}, title),
      el("dl", { class: "facts" },
        el("dt", {}, "Rig"), el("dd", {}, `${rig || name}${simulated ? "" : " – it will move"}`),
        facts.map(([term, what]) => [el("dt", {}, term), el("dd", {}, what)])),
      note,
      loss.element,
      simulated ? null : el("p", {}, "Is nobody within its reach?"),
      el("div", { class: "row end" },
        el("button", { type: "button", onclick: close }, "Cancel"), start),
    ];
  });
}

/** What happens to the run when this page is closed; `value()` is "" where it is as the procedure says. */
function lossChoice(usual) {
  const unknown = usual ? {} : { "": "what the procedure says" };
  const choices = Object.entries({ ...unknown, ...LOSS }).map(([value, text]) => {
    const input = el("input", { type: "radio", name: "on-loss", value, checked: value === usual });
    return el("label", {}, input, value && value === usual ? `${text} (as the procedure says)` : text);
  });
  const element = el("fieldset", { class: "choices loss" },
    el("legend", {}, "If you close this page, or it is cut off"), choices);
  const value = () => {
    const chosen = element.querySelector(":checked")?.value ?? usual;
    return chosen === usual ? "" : chosen;
  };
  return { element, value };
}
