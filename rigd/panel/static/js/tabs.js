// The tabs of the page, selected by the part of the address after #.

import { byId, el } from "./dom.js";

/** @type {Record<string, string>} */
const PAGES = { live: "Live", procedures: "Procedures", runs: "Runs", events: "Events" };
/** @type {Map<string, () => void>} */
const shown = new Map();

/**
 * Call `listener` whenever the page of that name is opened.
 * @param {string} name
 * @param {() => void} listener
 */
export function onShow(name, listener) {
  shown.set(name, listener);
  if (current() === name) listener();
}

export const current = () => {
  const name = location.hash.slice(2);
  return name in PAGES ? name : "live";
};

/** @param {string} name */
export function show(name) {
  location.hash = `/${name}`;
}

/** @param {HTMLElement} root */
export function mountTabs(root) {
  const tabs = Object.entries(PAGES).map(([name, title]) =>
    el("a", { href: `#/${name}`, class: "tab", data: { name } }, title),
  );
  root.append(...tabs);
  const turn = () => {
    const open = current();
    for (const tab of tabs) {
      if (tab.dataset.name === open) tab.setAttribute("aria-current", "page");
      else tab.removeAttribute("aria-current");
    }
    for (const name of Object.keys(PAGES)) {
      byId(`page-${name}`).hidden = name !== open;
    }
    window.scrollTo(0, 0);
    shown.get(open)?.();
  };
  window.addEventListener("hashchange", turn);
  turn();
}
