// A form from the parameters of a procedure: quantities with their unit and range, words by choice.

import { el, fill, setText } from "./dom.js";
import { decimalPoint, quantities, unit, withHint, words } from "./format.js";

export class Form {
  /**
   * The form calls `typed` at every letter, `changed` after each field.
   * @param {Api.PageParameter[]} parameters
   * @param {() => void} typed
   * @param {() => void} changed
   */
  constructor(parameters, typed, changed) {
    this.fields = parameters.map((item) => new Field(item));
    this.problems = el("ul", { class: "problems", role: "alert" });
    this.element = el("form", { class: "fields", onsubmit: (event) => event.preventDefault(), oninput: typed, onchange: changed },
      this.fields.length ? this.fields.map((item) => item.elements) : el("p", { class: "quiet" }, "This procedure has no parameters."),
      this.problems);
  }

  /** The values that the user has changed. */
  values() {
    return Object.fromEntries(this.fields.filter((item) => item.isGiven).map((item) => [item.name, item.text]));
  }

  /**
   * Every parameter with its value, for people; changed values are marked.
   * @returns {[string, Child][]}
   */
  facts() {
    return this.fields.map((item) => [words(item.name), item.isGiven ? el("strong", {}, quantities(item.text)) : item.usual]);
  }

  /**
   * Show each problem at the field that it names, if any; `early`: only in changed fields. Returns all
   * that are shown, each with the name of its field.
   * @param {Api.ProblemView[]} problems
   * @returns {string[]}
   */
  blame(problems, early = false) {
    for (const field of this.fields) field.blame("");
    const rest = [];
    const shown = [];
    for (const problem of problems) {
      const field = this.fields.find((item) => new RegExp(`\\b${item.name}\\b`).test(problem.message));
      if (early && !field?.isGiven) continue;
      const text = withHint(problem).replace(/^--set [^:]*: /, "");
      if (field === undefined) rest.push(el("li", {}, text));
      else field.blame(text);
      shown.push(field === undefined ? text : `${words(field.name)}: ${text}`);
    }
    fill(this.problems, rest);
    return shown;
  }

  /** Give the keyboard to the first field with a problem, and show it. */
  goToProblem() {
    this.fields.find((item) => item.isBlamed)?.input.focus();
  }
}

class Field {
  /** @type {HTMLSelectElement | HTMLInputElement} */
  input;

  /** @param {Api.PageParameter} parameter */
  constructor(parameter) {
    this.parameter = parameter;
    this.name = parameter.name;
    const id = `parameter-${parameter.name}`;
    this.note = el("p", { class: "quiet", id: `${id}-note` }, note(parameter));
    this.problem = el("p", { class: "problem", id: `${id}-problem`, role: "alert" });
    const common = { id, "aria-describedby": `${id}-note ${id}-problem` };
    /** @type {HTMLElement} */
    let input;
    if (parameter.choices.length) {
      this.input = el("select", common,
        parameter.default === null || parameter.swept ? el("option", { value: "" }, parameter.swept ? "all of the sweep" : "choose …") : null,
        ...parameter.choices.map((item) => el("option", { value: item }, item)));
      if (parameter.default !== null && !parameter.swept) this.input.value = parameter.default;
      input = this.input;
    } else {
      this.input = el("input", {
        ...common, autocomplete: "off", spellcheck: false,
        value: parameter.swept ? "" : parameter.default ?? "",
        placeholder: parameter.swept ? "swept" : `a number in ${unit(parameter.unit) || "1"}`,
      });
      const isExpression = parameter.default !== null && !/^[-+.\d]/.test(parameter.default);
      input = el("span", { class: "with-unit" }, this.input,
        el("span", { class: "unit" }, isExpression ? "" : unit(parameter.unit)), el("span", { class: "range" }, range(parameter)));
      if (!parameter.swept && parameter.default !== null) this.input.value = bare(parameter.default, parameter.unit);
    }
    this.initial = this.input.value;
    this.elements = [
      el("label", { for: id }, words(parameter.name)),
      el("div", {}, input, parameter.doc || this.note.textContent ? this.note : null, this.problem),
    ];
  }

  get isGiven() {
    return this.input.value.trim() !== this.initial;
  }

  /** As `--set` accepts it: a bare number gets the unit beside the field. */
  get text() {
    if (this.parameter.choices.length) return this.input.value;
    const text = decimalPoint(this.input.value);
    const isBare = /^[-+]?[\d.]+(e[-+]?\d+)?$/i.test(text);
    return isBare && this.parameter.unit !== "1" ? `${text} ${this.parameter.unit}` : text;
  }

  /** Its value if the user has not changed it. */
  get usual() {
    if (this.parameter.swept) return "all of the sweep";
    return this.parameter.default === null ? "–" : quantities(this.parameter.default);
  }

  get isBlamed() {
    return this.input.getAttribute("aria-invalid") === "true";
  }

  /** @param {string} text */
  blame(text) {
    setText(this.problem, text);
    this.input.setAttribute("aria-invalid", String(text !== ""));
  }
}

/**
 * `1.15 m` as `1.15` if the unit is m; other text unchanged.
 * @param {string} text
 * @param {string} symbol
 */
function bare(text, symbol) {
  return text.endsWith(` ${symbol}`) ? text.slice(0, -symbol.length - 1) : text;
}

/** @param {Api.PageParameter} parameter */
function range({ min, max, unit: symbol }) {
  if (min !== null && max !== null) return `${bare(min, symbol)} … ${quantities(max)}`;
  return min !== null ? `≥ ${quantities(min)}` : max !== null ? `≤ ${quantities(max)}` : "";
}

/** @param {Api.PageParameter} parameter */
function note({ doc, swept }) {
  return [doc.replace(/([^.])$/, "$1."), swept ? "Swept: left empty, all are run." : ""].filter(Boolean).join(" ");
}
