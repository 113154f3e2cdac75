// A prompt of the procedure, with the form for its answer.

import { command } from "./api.js";
import { el, icon, setText } from "./dom.js";
import { decimalPoint, inUnit, quantity, unit } from "./format.js";
import { attempt } from "./toasts.js";

/**
 * @param {Api.PagePrompt} prompt
 * @param {boolean} mine
 */
export function promptCard(prompt, mine) {
  const problem = el("p", { class: "problem", role: "alert", id: "prompt-problem" }, prompt.objection);
  /** @type {HTMLFormElement} */
  const form = el("form", {
    class: "answer",
    onsubmit: async (event) => {
      event.preventDefault();
      const value = read(prompt, form, event.submitter);
      if (value instanceof Error) {
        setText(problem, value.message);
        return;
      }
      setText(problem, "");
      card.dataset.done = `Answered: ${event.submitter?.getAttribute("value") ? event.submitter.textContent : new FormData(form).get("value")}`;
      await attempt(event.submitter, () => command("answer", { prompt_id: prompt.id, value }));
    },
  }, ...fields(prompt, mine));
  if (!mine) form.append(el("p", { class: "quiet" }, "Only the person who has control can answer."));
  const card = el("section", { class: "card prompt", data: { mood: "ask" }, "aria-label": "A question", tabIndex: -1 },
    icon("question"),
    el("div", { class: "card-text" }, el("h2", {}, prompt.text), problem, form));
  // The prompt gets the focus, not its answers, and only if no other field has it.
  if (mine) requestAnimationFrame(() => document.activeElement === document.body && card.focus({ preventScroll: true }));
  return card;
}

/**
 * @param {Api.PagePrompt} prompt
 * @param {boolean} mine
 */
function fields(prompt, mine) {
  /** @param {string} text */
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
          ...prompt.choices.map((item) =>
            el("label", {}, el("input", { type: "radio", name: "value", value: item, required: true }), item))),
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

/**
 * The bounds as a text for people; they arrive in SI.
 * @param {Api.PagePrompt} prompt
 */
function bounds({ low, high, unit: symbol, factor, offset, answer }) {
  /** @param {number} value */
  const shown = (value) => quantity(inUnit(value, { factor, offset }), symbol);
  let text = "";
  if (low !== null && high !== null) text = `${shown(low)} to ${shown(high)}`;
  else if (low !== null) text = `at least ${shown(low)}`;
  else if (high !== null) text = `at most ${shown(high)}`;
  if (typeof answer === "number") text += `${text && "; "}planned: ${shown(answer)}`;
  return text;
}

/**
 * The answer as it is sent, or an Error with the problem.
 * @param {Api.PagePrompt} prompt
 * @param {HTMLFormElement} form
 * @param {HTMLElement | null} submitter
 */
function read(prompt, form, submitter) {
  if (prompt.kind === "confirm") return submitter?.getAttribute("value") !== "no";
  const text = String(new FormData(form).get("value") ?? "");
  if (prompt.kind !== "number") return text;
  const given = Number(decimalPoint(text));
  if (text.trim() === "" || !Number.isFinite(given)) return new Error(`${text} is not a number.`);
  const value = given * prompt.factor + prompt.offset;
  const tooLow = prompt.low !== null && value < prompt.low;
  const tooHigh = prompt.high !== null && value > prompt.high;
  if (tooLow || tooHigh) return new Error(`${quantity(given, prompt.unit)} is outside ${bounds({ ...prompt, answer: null })}.`);
  return value;
}
