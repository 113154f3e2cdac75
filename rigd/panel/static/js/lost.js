// A page that is cut off says so over everything: old values must never look alive.

import { fill, el } from "./dom.js";
import { clock } from "./format.js";
import { known, watch } from "./store.js";

const WHY = {
  no_panel: ["The panel does not answer.", "This page tries again by itself."],
  no_rig: ["The rig's daemon does not answer.", "The panel tries again by itself."],
};

export function mountLost(root) {
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
      el("span", {}, "Nothing shown here is live, and Stop does not get through before this page is connected again: use the hardware emergency stop. "),
      el("span", {}, WHY[link][1]),
    );
  });
}
