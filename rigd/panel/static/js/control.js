// Shows which user has control, and lets users take, request, hand over and release it.

import { command } from "./api.js";
import { el, fill, icon } from "./dom.js";
import { hasControl, isMaintainer, isOperator, known, nameOf, watch } from "./store.js";
import { attempt, toast } from "./toasts.js";

const LOST_MS = 60_000;

/** The lease as it is shown, so that the page is rebuilt only if it changes. */
function key() {
  return JSON.stringify([known.status?.lease.holder, known.link]);
}

/** @param {HTMLElement} root */
export function mountControl(root) {
  let shown = "";
  let mine = false; // when the rig was last heard of
  watch(["status", "link"], () => {
    if (known.status === null || shown === key()) return;
    shown = key();
    const { holder } = known.status.lease;
    root.dataset.mine = String(hasControl());
    if (known.link === "ok") {
      if (mine && !hasControl()) toast(lost(holder), "warn", LOST_MS);
      mine = hasControl();
    }
    if (known.link !== "ok") {
      fill(root);
    } else if (hasControl()) {
      fill(root, icon("hand"), el("span", {}, "You have control"), button("Release", "lease_release"));
    } else if (holder === null) {
      fill(root, icon("hand"), el("span", {}, "Control is free"), isOperator() ? button("Take control", "lease_take", "primary") : null);
    } else {
      const name = nameOf(holder);
      fill(
        root, icon("lock"), el("span", {}, `${name} has control`),
        isOperator() ? button("Request it", "lease_request", "", `${name} was asked to hand over control.`) : null,
        isMaintainer() ? button("Take it from them", "lease_seize") : null,
      );
    }
  });
}

/**
 * What has become of the control that this page had.
 * @param {Api.ClientUser | null} holder
 */
const lost = (holder) => (holder === null ? "You no longer have control. Take control before you command again." : `${nameOf(holder)} has control now; you no longer have it.`);

/**
 * @param {string} text
 * @param {"lease_take" | "lease_release" | "lease_request" | "lease_seize"} verb
 */
function button(text, verb, style = "", note = "") {
  /** @type {HTMLButtonElement} */
  const made = el("button", {
    type: "button", class: style,
    onclick: () => attempt(made, async () => {
      await command(verb, {});
      if (note) toast(note);
    }),
  }, text);
  return made;
}
