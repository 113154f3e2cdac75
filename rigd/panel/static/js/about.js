// What a person states on a run: its specimen, a note, and what the lab demands.

import { el } from "./dom.js";
import { words } from "./format.js";
import { read } from "./store.js";

/** @typedef {Pick<Api.StartArguments, "specimen" | "note" | "meta">} Stated */

/** The fields of one run; the daemon checks them again. */
export class About {
  /** @type {Map<string, HTMLInputElement | HTMLSelectElement>} */
  #inputs = new Map();

  constructor() {
    const demanded = new Map((read("describe").stated ?? []).map((item) => [item.name, item]));
    const none = { doc: "", required: false, unit: "", choices: /** @type {string[]} */ ([]) };
    const names = new Set(["specimen", ...[...demanded.keys()].filter((name) => name.startsWith("meta.")), "note"]);
    const rows = [...names].map((name) => this.#row({ ...none, ...demanded.get(name), name }));
    this.element = el("form", { class: "fields", onsubmit: (event) => event.preventDefault() }, ...rows);
  }

  /** @param {Api.StatedView} item */
  #row({ name, doc, required, unit, choices }) {
    const id = `stated-${name.replace(".", "-")}`;
    const common = { id, required, "aria-describedby": `${id}-note` };
    const input = choices.length
      ? el("select", common, el("option", { value: "" }, "choose …"), ...choices.map((text) => el("option", { value: text }, text)))
      : el("input", { ...common, autocomplete: "off", spellcheck: name === "note", placeholder: unit ? `a number in ${unit}, with its unit` : "" });
    this.#inputs.set(name, input);
    const label = words(name.replace("meta.", ""));
    return [
      el("label", { for: id }, required ? `${label} (required)` : label),
      el("div", {}, input, el("p", { class: "quiet", id: `${id}-note` }, doc)),
    ];
  }

  /** Whether all that is required is stated; the page points to the first field that is not. */
  isComplete() {
    return this.element.reportValidity();
  }

  /**
   * What is stated; fields that are empty are left out.
   * @returns {Stated}
   */
  values() {
    /** @type {Stated} */
    const stated = {};
    /** @type {Record<string, string>} */
    const meta = {};
    for (const [name, { value }] of this.#inputs) {
      const text = value.trim();
      if (!text) continue;
      if (name === "specimen") stated.specimen = text;
      else if (name === "note") stated.note = text;
      else meta[name.replace("meta.", "")] = text;
    }
    if (Object.keys(meta).length) stated.meta = meta;
    return stated;
  }
}
