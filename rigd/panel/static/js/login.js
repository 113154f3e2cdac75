// Letting a person in: the link brings a code that works once, the person says who they are.

import { login } from "./api.js";
import { el, fill, say } from "./dom.js";
import { withHint } from "./format.js";

export function mountLogin(root, code, enter) {
  const problem = el("p", { class: "problem", role: "alert" });
  const name = el("input", {
    id: "login-name", required: true, maxLength: 40, autocomplete: "name", value: remembered(),
  });
  const typed = el("input", {
    id: "login-code", required: true, value: code, autocomplete: "off", spellcheck: false,
  });
  const send = el("button", { class: "primary", type: "submit" }, "Open the panel");
  const form = el(
    "form",
    {
      class: "card",
      onsubmit: async (event) => {
        event.preventDefault();
        send.disabled = true;
        try {
          const { session } = await login(typed.value.trim().replace(/^.*#/, ""), name.value);
          remember(name.value);
          fill(root);
          enter(session);
        } catch (refused) {
          say(problem, withHint(refused));
          send.disabled = false;
        }
      },
    },
    el("h1", {}, "rigd"),
    el("p", { class: "quiet" }, "Whoever has control, and whoever stops the rig, is shown by name and written down."),
    el("label", { for: "login-name" }, "Your name"),
    name,
    code ? null : el("label", { for: "login-code" }, "Link or code, as printed when the panel was started"),
    code ? null : typed,
    problem,
    send,
  );
  fill(root, form);
  name.focus();
}

function remembered() {
  try {
    return localStorage.getItem("name") ?? "";
  } catch {
    return "";
  }
}

function remember(name) {
  try {
    localStorage.setItem("name", name);
  } catch { /* typed again next time */ }
}
