// The login: the link contains a code that works once; the user enters a name.

import { asRefused, login } from "./api.js";
import { el, fill, setText } from "./dom.js";
import { withHint } from "./format.js";

/**
 * @param {HTMLElement} root
 * @param {string} rig
 * @param {string} code
 * @param {(me: Api.SessionView) => void} enter
 */
export function mountLogin(root, rig, code, enter) {
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
          if (session !== null) enter(session);
        } catch (error) {
          setText(problem, withHint(asRefused(error)));
          send.disabled = false;
        }
      },
    },
    el("h1", {}, rig),
    el("p", {}, "Panel of this rig, by rigd"),
    el("p", { class: "quiet" }, "The panel shows and records the name of each person who takes control or stops the rig."),
    el("label", { for: "login-name" }, "Your name"),
    name,
    code ? null : el("label", { for: "login-code" }, "Link or code, as printed at the start of the panel"),
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

/** @param {string} name */
function remember(name) {
  try {
    localStorage.setItem("name", name);
  } catch { /* typed again next time */ }
}
