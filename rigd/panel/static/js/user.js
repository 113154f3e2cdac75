// The user of this page, the theme, and links for other screens.

import { invite, logout } from "./api.js";
import { openDialog } from "./dialog.js";
import { el, fill, icon } from "./dom.js";
import { read } from "./store.js";
import { attempt, toast } from "./toasts.js";

/** @param {HTMLElement} root */
export function mountUser(root) {
  root.append(el("button", {
    type: "button", class: "plain-button", "aria-haspopup": "dialog",
    onclick: () => openDialog("You and this page", contents),
  }, icon("user"), el("span", {}, read("me").name)));
}

/** @param {() => void} close */
function contents(close) {
  const me = read("me");
  const link = el("output", { class: "link" });
  /**
   * @param {Api.SessionView["role"]} role
   * @param {string} text
   */
  const invitation = (role, text) => {
    /** @type {HTMLButtonElement} */
    const made = el("button", {
      type: "button", onclick: () => attempt(made, async () => {
        const { code } = await invite(role);
        const address = `${location.origin}/#${code}`;
        fill(link, el("code", {}, address), copy(address), el("p", { class: "quiet" }, "Works once, within 15 minutes."));
      }),
    }, text);
    return made;
  };
  const role = me.role === "operator" ? "may command the rig, with control" : "watches, and may stop the rig";
  return [
    el("h2", {}, me.name),
    el("p", { class: "quiet" }, `This page ${role}.`),
    el("fieldset", { class: "choices" }, el("legend", {}, "Light"), ...["auto", "light", "dark"].map(theme)),
    el("h3", {}, "Another screen"),
    el("div", { class: "row" },
      me.role === "operator" ? invitation("operator", "Link to command") : null,
      invitation("observer", "Link to watch")),
    link,
    el("div", { class: "row end" },
      el("button", { type: "button", class: "plain-button", onclick: leave }, "Log out"),
      el("button", { type: "button", onclick: close }, "Close")),
  ];
}

/** @param {string} name */
function theme(name) {
  /** @type {Record<string, string>} */
  const titles = { auto: "As the system", light: "Day", dark: "Night" };
  return el("label", {},
    el("input", {
      type: "radio", name: "theme", checked: window.rigdTheme.chosen === name,
      onchange: () => window.rigdTheme.choose(name),
    }),
    titles[name]);
}

/** @param {string} address */
function copy(address) {
  // Without TLS a page from another computer has no access to the clipboard.
  if (!navigator.clipboard) return null;
  return el("button", {
    type: "button", onclick: async () => {
      await navigator.clipboard.writeText(address);
      toast("The link was copied.");
    },
  }, "Copy");
}

async function leave() {
  try {
    await logout();
  } finally {
    location.reload();
  }
}
