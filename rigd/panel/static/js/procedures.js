// The page of procedures: choose a procedure, set its parameters, play a dry run, start it.

import { About } from "./about.js";
import { ask, asRefused, command } from "./api.js";
import { confirmRun } from "./confirm.js";
import { el, fill, flag, icon, reveal, setText } from "./dom.js";
import { words } from "./format.js";
import { Form } from "./form.js";
import { drawPreview, expected } from "./preview.js";
import { hasControl, isOperator, known, read, watch } from "./store.js";
import { onShow, show } from "./tabs.js";
import { attempt, complain } from "./toasts.js";

/** @param {HTMLElement} root */
export function mountProcedures(root) {
  const list = el("ul", { class: "picker" });
  const unfit = el("ul", { class: "picker" });
  const count = el("summary", {}, "Not for this rig");
  const rest = el("details", { class: "more", hidden: true }, count, unfit);
  const empty = () => el("p", { class: "empty" }, "Choose a procedure.");
  const sheet = el("div", { class: "sheet" }, empty());
  root.append(
    el("section", { class: "panel side-list", "aria-label": "All procedures" },
      el("div", { class: "panel-head" }, el("h2", {}, "Procedures")), list, rest),
    el("section", { class: "panel wide", "aria-label": "The procedure" }, sheet));
  let open = /** @type {string | null} */ (null);
  let shown = /** @type {Sheet | null} */ (null); // of the procedure that is open
  let chosen = 0; // number of choices: an answer to an earlier choice opens nothing

  watch(["status", "link"], () => shown?.permit());
  onShow("procedures", async () => {
    try {
      const { procedures } = await ask("procedures", {});
      fill(list, procedures.filter((item) => item.problem === null).map(line));
      const others = procedures.filter((item) => item.problem !== null);
      rest.hidden = others.length === 0;
      setText(count, `${others.length} not for this rig`);
      fill(unfit, others.map(line));
    } catch (error) {
      complain(asRefused(error));
    }
  });

  /**
   * Open a procedure. The open procedure keeps typed values, unless its file has changed.
   * @param {string} name
   * @param {HTMLButtonElement} button
   */
  async function choose(name, button) {
    const before = open === name ? shown : null;
    const number = ++chosen;
    if (before === null) fill(sheet, el("p", { class: "empty" }, "Opening …")); // no typing into a sheet that is replaced
    try {
      const view = await ask("procedure", { name });
      if (number !== chosen || (before !== null && JSON.stringify(view) === JSON.stringify(before.view))) return;
      open = name;
      for (const other of list.querySelectorAll("button")) other.setAttribute("aria-pressed", String(other === button));
      shown = new Sheet(view);
    } finally {
      if (number === chosen && (before === null || shown !== before)) fill(sheet, shown?.element ?? empty());
      reveal(sheet);
    }
  }

  /** @param {Api.ProcedureLine} item */
  function line(item) {
    /** @type {HTMLButtonElement} */
    const button = el("button", {
      type: "button", disabled: item.problem !== null, "aria-pressed": String(open === item.name),
      onclick: () => attempt(button, () => choose(item.name, button)),
    }, el("strong", {}, item.title || words(item.name)), el("span", { class: "quiet" }, item.problem ?? item.name));
    return el("li", {}, button);
  }
}

/** @typedef {Pick<Api.StartArguments, "procedure" | "set">} Given */

class Sheet {
  /** @type {{ key: string, result: Promise<Api.PageDryRun> } | null} */
  #found = null;
  #seed = el("input", {
    id: "seed", inputMode: "numeric", pattern: "\\d*", title: "a whole number", placeholder: "chosen by rigd", autocomplete: "off",
  });
  #own = el("input", { id: "own", type: "checkbox" });

  /** @param {Api.PageProcedure} view */
  constructor(view) {
    this.view = view;
    this.form = new Form(view.parameters, () => {
      this.preview.classList.add("old");
      setText(this.problem, "");
    }, () => this.#look());
    this.preview = el("div", { class: "preview", "aria-live": "polite" });
    this.try = el("button", { type: "button", onclick: () => this.#dryRun() }, "Dry run");
    this.start = el("button", { type: "button", class: "primary big", onclick: () => this.#confirm() }, icon("play"), "Start…");
    this.why = el("p", { class: "quiet", role: "status" });
    this.problem = el("p", { class: "problem", role: "alert" });
    this.element = el("article", {},
      el("h2", {}, view.title || words(view.procedure.name)),
      prose(view.doc),
      this.form.element,
      this.#options(),
      isOperator() ? el("div", { class: "row" }, this.try, this.start) : null,
      this.problem, this.why, this.preview);
    this.permit();
  }

  #options() {
    return el("details", { class: "more" }, el("summary", {}, "More choices"),
      el("div", { class: "fields" },
        el("label", { for: "seed" }, "Seed"), this.#seed,
        read("describe").simulated ? [el("label", { for: "own" }, "The procedure answers its own prompts"), this.#own] : null));
  }

  /** A procedure that cannot be started shows the reason. */
  permit() {
    let why = "";
    if (!isOperator()) why = "This page watches; it cannot start a run.";
    else if (known.link !== "ok") why = "Not connected.";
    else if (read("status").run !== null) why = "A run is in progress.";
    else if (read("status").trips.some((item) => !item.acknowledged)) why = "An interlock waits to be acknowledged.";
    else if (!hasControl()) why = "Take control to start.";
    flag(this.start, "disabled", why !== "");
    setText(this.why, why);
  }

  /** @returns {Given} */
  #given() {
    return { procedure: this.view.procedure, set: this.form.values() };
  }

  /** Show the problems in the values given so far. */
  async #look() {
    const given = this.#given();
    try {
      const { problems } = await ask("check", given);
      if (JSON.stringify(given) === JSON.stringify(this.#given())) this.form.blame(problems, true);
    } catch (error) {
      complain(asRefused(error));
    }
  }

  /**
   * Check the values; if one is wrong, name it at the button that was pressed, and go to its field.
   * @param {Given} given
   */
  async #checked(given) {
    this.#blame([]);
    const check = await ask("check", given);
    if (check.ok) return check;
    this.#blame(check.problems);
    return null;
  }

  /** @param {Api.ProblemView[]} problems */
  #blame(problems) {
    setText(this.problem, this.form.blame(problems).join(" "));
    this.form.goToProblem();
  }

  async #dryRun() {
    fill(this.preview, el("p", { class: "quiet busy" }, "Playing it dry …"));
    const found = await attempt(this.try, async () => {
      const given = this.#given();
      return await this.#checked(given) && this.#dryRunOf(given);
    });
    this.preview.classList.remove("old");
    if (found === null) fill(this.preview);
    else drawPreview(this.preview, found);
  }

  async #confirm() {
    const closed = this.#seed.closest("details");
    if (!this.#seed.checkValidity() && closed) closed.open = true; // what is not seen cannot be pointed to
    if (!this.#seed.reportValidity()) return;
    const check = await attempt(this.start, () => this.#checked(this.#given()));
    this.permit();
    if (check === null) return;
    const seed = this.#seed.value.trim();
    const answered = this.#own.checked ? "answered by the procedure itself" : `${check.prompts}, for you to answer`;
    /** @type {Api.StartArguments} */
    const args = { ...this.#given(), answers: this.#own.checked ? "procedure" : "ask" };
    if (seed) args.seed = Number(seed);
    const about = new About();
    confirmRun({
      note: about.element,
      ready: () => about.isComplete(),
      title: `Start ${words(this.view.procedure.name)}?`,
      action: "Start now",
      usual: this.view.on_client_loss,
      facts: [
        ["Procedure", this.view.title || words(this.view.procedure.name)],
        ["Trials", String(check.trials)],
        ["Takes", this.#duration(args)],
        ...this.form.facts(),
        ["Seed", seed || null],
        ["Questions", check.prompts ? answered : null],
      ],
      go: async (loss) => {
        const said = { ...args, ...about.values() };
        await command("start", loss ? { ...said, on_client_loss: loss } : said);
        show("live");
      },
    });
  }

  /**
   * The dry run with these values; an earlier result is used again.
   * @param {Given} given
   */
  #dryRunOf(given) {
    const key = JSON.stringify(given);
    if (this.#found?.key !== key) {
      const result = command("dry_run", given);
      this.#found = { key, result };
      result.catch(() => { this.#found = null; });
    }
    return this.#found.result;
  }

  /**
   * The duration of the run: computed by a dry run while the user reads the rest.
   * @param {Given} given
   */
  #duration({ procedure, set }) {
    const label = el("span", { class: "busy" }, "being computed …");
    /** @param {string} text */
    const display = (text, isGood = true) => {
      label.className = isGood ? "" : "problem";
      setText(label, text);
    };
    this.#dryRunOf({ procedure, set }).then(
      (found) => display(`${expected(found)}${found.ok ? "" : `; the dry run says: ${found.refusals.join("; ") || "the run would fail"}`}`, found.ok),
      (refused) => display(`not known: ${refused.message}`, false));
    return label;
  }
}

/**
 * The description of a procedure: its first paragraph, the others on demand.
 * @param {string} text
 */
function prose(text) {
  const [first, ...others] = text.trim().split(/\n\s*\n/).map(paragraph);
  return el("div", { class: "doc" }, first,
    others.length ? el("details", { class: "more" }, el("summary", {}, "More about it"), others) : null);
}

/**
 * Lines of prose are joined; commands keep their lines.
 * @param {string} text
 */
const paragraph = (text) => /^( {2}|rigd |\$ )/m.test(text)
  ? el("pre", {}, text)
  : el("p", {}, text.replace(/\s*\n\s*/g, " "));
