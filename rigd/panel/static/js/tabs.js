// Pages within the page, by the address behind the #.

import { el } from "./dom.js";

const PAGES = { live: "Live", procedures: "Procedures", runs: "Runs", events: "Events" };
const shown = new Map();

/** Call `listener` whenever the page of that name is opened. */
export function onShow(name, listener) {
  shown.set(name, listener);
  if (current() === name) listener();
}

export const current = () => {
  const name = location.hash.slice(2);
  return name in PAGES ? name : "live";
};

export function show(name) {
  location.hash = `/${name}`;
}

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
      document.getElementById(`page-${name}`).hidden = name !== open;
    }
    window.scrollTo(0, 0);
    shown.get(open)?.();
  };
  window.addEventListener("hashchange", turn);
  turn();
}
