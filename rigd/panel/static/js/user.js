// Who sits here, day or night, and links for other screens.

import { invite, logout } from "./api.js";
import { openDialog } from "./dialog.js";
import { el, fill, icon } from "./dom.js";
import { known } from "./store.js";
import { attempt, toast } from "./toasts.js";

export function mountUser(root) {
  root.append(el("button", {
    type: "button", class: "plain-button", "aria-haspopup": "dialog",
    onclick: () => openDialog("You and this page", contents),
  }, icon("user"), el("span", {}, known.me.name)));
}

function contents(close) {
  const link = el("output", { class: "link" });
  const invitation = (role, text) => {
    const made = el("button", {
      type: "button", onclick: () => attempt(made, async () => {
        const { code } = await invite(role);
        const address = `${location.origin}/#${code}`;
        fill(link, el("code", {}, address), copy(address), el("p", { class: "quiet" }, "Works once, within 15 minutes."));
      }),
    }, text);
    return made;
  };
  const role = known.me.role === "operator" ? "may command the rig, with control" : "watches, and may stop the rig";
  return [
    el("h2", {}, known.me.name),
    el("p", { class: "quiet" }, `This page ${role}.`),
    el("fieldset", { class: "choices" }, el("legend", {}, "Light"), ...["auto", "light", "dark"].map(theme)),
    el("h3", {}, "Another screen"),
    el("div", { class: "row" },
      known.me.role === "operator" ? invitation("operator", "Link to command") : null,
      invitation("observer", "Link to watch")),
    link,
    el("div", { class: "row end" },
      el("button", { type: "button", class: "plain-button", onclick: leave }, "Log out"),
      el("button", { type: "button", onclick: close }, "Close")),
  ];
}

function theme(name) {
  const titles = { auto: "As the system", light: "Day", dark: "Night" };
  return el("label", {},
    el("input", {
      type: "radio", name: "theme", checked: window.rigdTheme.chosen === name,
      onchange: () => window.rigdTheme.choose(name),
    }),
    titles[name]);
}

function copy(address) {
  // Without TLS a page from elsewhere than this computer has no clipboard.
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
