// Warns above everything else when the page is disconnected: old values must never look live.

import { fill, el } from "./dom.js";
import { clock } from "./format.js";
import { known, watch } from "./store.js";

/** @type {Record<string, [string, string]>} */
const WHY = {
  no_panel: ["The panel does not answer.", "This page tries again by itself."],
  no_rig: ["The rig's daemon does not answer.", "The panel tries again by itself."],
};

/** @param {HTMLElement} root */
export function mountLost(root) {
  /** @type {number | null} */
  let since = null;
  watch("link", () => {
    const { link } = known;
    document.documentElement.dataset.link = link;
    root.hidden = !(link in WHY);
    if (root.hidden) {
      since = null;
      return;
    }
    since ??= Date.now();
    fill(
      root,
      el("strong", {}, `Not connected since ${clock(since)}. ${WHY[link][0]}`),
      el("span", {}, "Nothing shown here is live, and Stop does not reach the rig until this page is connected again: use the hardware emergency stop. "),
      el("span", {}, WHY[link][1]),
    );
  });
}
