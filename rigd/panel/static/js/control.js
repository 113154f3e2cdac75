// Who has control, and how it changes hands.

import { control } from "./api.js";
import { el, fill, icon } from "./dom.js";
import { hasControl, isMaintainer, isOperator, known, watch } from "./store.js";
import { attempt, toast } from "./toasts.js";

/** What is shown of the lease, so that the page is only rebuilt where it differs. */
function key() {
  const { holder, ours, session, user } = known.status.control;
  return JSON.stringify([holder, ours, session, user, known.link]);
}

export function mountControl(root) {
  let shown = "";
  watch(["status", "link"], () => {
    if (known.status === null || shown === key()) return;
    shown = key();
    const { holder, ours, user } = known.status.control;
    root.dataset.mine = hasControl();
    if (known.link !== "ok") {
      fill(root);
    } else if (hasControl()) {
      fill(root, icon("hand"), el("span", {}, "You have control"), button("Release", "release"));
    } else if (holder === null) {
      fill(root, icon("hand"), el("span", {}, "Control is free"), isOperator() ? button("Take control", "take", "primary") : null);
    } else if (ours && user === null) {
      fill(root, icon("lock"), el("span", {}, "Nobody here uses this panel's control"), isOperator() ? button("Take control", "take") : null);
    } else {
      const who = ours ? user : holder;
      fill(
        root, icon("lock"), el("span", {}, `${who} has control`),
        isOperator() ? button("Ask for it", "ask", "", `${who} was asked to hand over control.`) : null,
        isMaintainer() ? button("Take it from them", "seize") : null,
      );
    }
  });
}

function button(text, verb, style = "", said = "") {
  const made = el("button", {
    type: "button", class: style,
    onclick: () => attempt(made, async () => {
      await control(verb);
      if (said) toast(said);
    }),
  }, text);
  return made;
}
