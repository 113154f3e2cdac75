// A form from the parameters of a procedure: quantities with their unit and range, words by choice.

import { el, fill, say } from "./dom.js";
import { decimalPoint, quantities, unit, withHint, words } from "./format.js";

export class Form {
  /** `typed` is called at every letter, `changed` whenever a field is done with. */
  constructor(parameters, typed, changed) {
    this.fields = parameters.map((one) => new Field(one));
    this.problems = el("ul", { class: "problems", role: "alert" });
    this.element = el("form", { class: "fields", onsubmit: (event) => event.preventDefault(), oninput: typed, onchange: changed },
      this.fields.length ? this.fields.map((one) => one.elements) : el("p", { class: "quiet" }, "This procedure has no parameters."),
      this.problems);
  }

  /** What was given by hand: what was left as it is stays out. */
  values() {
    return Object.fromEntries(this.fields.filter((one) => one.isGiven).map((one) => [one.name, one.text]));
  }

  /** Every parameter as it will be, for people; what was given by hand is set off. */
  facts() {
    return this.fields.map((one) => [words(one.name), one.isGiven ? el("strong", {}, quantities(one.text)) : one.usual]);
  }

  /** Show what is wrong, beside the field it names where it names one; `early`: only in what was given. */
  blame(problems, early = false) {
    for (const field of this.fields) field.blame("");
    const rest = [];
    for (const problem of problems) {
      const text = withHint(problem);
      const field = this.fields.find((one) => new RegExp(`\\b${one.name}\\b`).test(problem.message));
      if (early && !field?.isGiven) continue;
      if (field === undefined) rest.push(el("li", {}, text));
      else field.blame(text.replace(`--set ${field.name}=${field.text}: `, ""));
    }
    fill(this.problems, rest);
  }
}

class Field {
  constructor(parameter) {
    Object.assign(this, { parameter, name: parameter.name });
    const id = `parameter-${parameter.name}`;
    this.note = el("p", { class: "quiet", id: `${id}-note` }, note(parameter));
    this.problem = el("p", { class: "problem", id: `${id}-problem`, role: "alert" });
    const common = { id, "aria-describedby": `${id}-note ${id}-problem` };
    let input;
    if (parameter.choices.length) {
      this.input = el("select", common,
        parameter.default === null || parameter.swept ? el("option", { value: "" }, parameter.swept ? "all of the sweep" : "choose …") : null,
        ...parameter.choices.map((one) => el("option", { value: one }, one)));
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

  /** As `--set` takes it: a bare number gets the unit that stands beside the field. */
  get text() {
    if (this.parameter.choices.length) return this.input.value;
    const text = decimalPoint(this.input.value);
    const isBare = /^[-+]?[\d.]+(e[-+]?\d+)?$/i.test(text);
    return isBare && this.parameter.unit !== "1" ? `${text} ${this.parameter.unit}` : text;
  }

  /** What it is where nothing was given. */
  get usual() {
    if (this.parameter.swept) return "all of the sweep";
    return this.parameter.default === null ? "–" : quantities(this.parameter.default);
  }

  blame(text) {
    say(this.problem, text);
    this.input.setAttribute("aria-invalid", String(text !== ""));
  }
}

/** `1.15 m` as `1.15` where the unit is m; anything else as it is. */
function bare(text, symbol) {
  return text.endsWith(` ${symbol}`) ? text.slice(0, -symbol.length - 1) : text;
}

function range({ min, max, unit: symbol }) {
  if (min !== null && max !== null) return `${bare(min, symbol)} … ${quantities(max)}`;
  return min !== null ? `≥ ${quantities(min)}` : max !== null ? `≤ ${quantities(max)}` : "";
}

function note({ doc, swept }) {
  return [doc.replace(/([^.])$/, "$1."), swept ? "Swept: left empty, all are run." : ""].filter(Boolean).join(" ");
}
