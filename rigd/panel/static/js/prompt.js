// A question of the procedure, with the answer it can take.

import { command } from "./api.js";
import { el, icon, say } from "./dom.js";
import { decimalPoint, quantity, unit } from "./format.js";
import { attempt } from "./toasts.js";

export function promptCard(prompt, mine) {
  const problem = el("p", { class: "problem", role: "alert", id: "prompt-problem" }, prompt.objection);
  const form = el("form", {
    class: "answer",
    onsubmit: async (event) => {
      event.preventDefault();
      const value = read(prompt, form, event.submitter);
      if (value instanceof Error) {
        say(problem, value.message);
        return;
      }
      say(problem, "");
      await attempt(event.submitter, () => command("answer", { prompt_id: prompt.id, value }));
    },
  }, ...fields(prompt, mine));
  if (!mine) form.append(el("p", { class: "quiet" }, "Only who has control can answer."));
  const card = el("section", { class: "card prompt", data: { mood: "ask" }, "aria-label": "A question", tabIndex: -1 },
    icon("question"),
    el("div", { class: "card-text" }, el("h2", {}, prompt.text), problem, form));
  // The keyboard comes to the question, to none of its answers, and is taken from nobody.
  if (mine) requestAnimationFrame(() => document.activeElement === document.body && card.focus({ preventScroll: true }));
  return card;
}

function fields(prompt, mine) {
  const send = (text, value = "") => el("button", { class: "primary", type: "submit", value, disabled: !mine }, text);
  switch (prompt.kind) {
    case "confirm":
      return [
        send("Yes, done", "yes"),
        el("button", { type: "submit", value: "no", disabled: !mine, title: "Ends the run" }, "No – end the run"),
      ];
    case "choice":
      return [
        el("fieldset", { class: "choices", disabled: !mine },
          el("legend", { class: "unseen" }, "Answer"),
          ...prompt.choices.map((one) =>
            el("label", {}, el("input", { type: "radio", name: "value", value: one, required: true }), one))),
        send("Answer"),
      ];
    case "number":
      return [
        el("label", { for: "prompt-value", class: "unseen" }, "Answer"),
        el("span", { class: "with-unit" },
          el("input", {
            id: "prompt-value", name: "value", inputMode: "decimal", autocomplete: "off", required: true,
            disabled: !mine, "aria-describedby": "prompt-bounds prompt-problem",
          }),
          el("span", { class: "unit" }, unit(prompt.unit))),
        send("Answer"),
        el("span", { class: "quiet", id: "prompt-bounds" }, bounds(prompt)),
      ];
    default:
      return [
        el("label", { for: "prompt-value", class: "unseen" }, "Answer"),
        el("input", { id: "prompt-value", name: "value", required: true, maxLength: 4000, disabled: !mine, autocomplete: "off" }),
        send("Answer"),
      ];
  }
}

/** The bounds as people read them; they come in SI. */
function bounds({ low, high, unit: symbol, factor, answer }) {
  const shown = (value) => quantity(value / factor, symbol);
  let text = "";
  if (low !== null && high !== null) text = `${shown(low)} to ${shown(high)}`;
  else if (low !== null) text = `at least ${shown(low)}`;
  else if (high !== null) text = `at most ${shown(high)}`;
  if (typeof answer === "number") text += `${text && "; "}planned: ${shown(answer)}`;
  return text;
}

/** The answer as it travels, or an Error that says what is wrong with it. */
function read(prompt, form, submitter) {
  if (prompt.kind === "confirm") return submitter?.value !== "no";
  const text = new FormData(form).get("value") ?? "";
  if (prompt.kind !== "number") return String(text);
  const given = Number(decimalPoint(text));
  if (text.trim() === "" || !Number.isFinite(given)) return new Error(`${text} is not a number.`);
  const value = given * prompt.factor;
  const tooLow = prompt.low !== null && value < prompt.low;
  const tooHigh = prompt.high !== null && value > prompt.high;
  if (tooLow || tooHigh) return new Error(`${quantity(given, prompt.unit)} is outside ${bounds({ ...prompt, answer: null })}.`);
  return value;
}
