// Choosing a procedure, giving its parameters, trying it dry, starting it.

import { ask, command } from "./api.js";
import { confirmRun } from "./confirm.js";
import { el, fill, icon, say } from "./dom.js";
import { duration, words } from "./format.js";
import { Form } from "./form.js";
import { drawPreview } from "./preview.js";
import { hasControl, isOperator, known, watch } from "./store.js";
import { onShow, show } from "./tabs.js";
import { attempt, complain } from "./toasts.js";

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
  let open = null;
  let shown = null; // the sheet of the procedure that is open
  let chosen = 0; // how often one was chosen: an answer that comes late opens nothing

  watch(["status", "link"], () => shown?.permit());
  onShow("procedures", async () => {
    try {
      const { procedures } = await ask("procedures");
      fill(list, procedures.filter((one) => one.problem === null).map(line));
      const others = procedures.filter((one) => one.problem !== null);
      rest.hidden = others.length === 0;
      say(count, `${others.length} not for this rig`);
      fill(unfit, others.map(line));
    } catch (refused) {
      complain(refused);
    }
  });

  /** Open a procedure. The one that is open keeps what was typed, unless its file has changed. */
  async function choose(name, button) {
    const before = open === name ? shown : null;
    const number = ++chosen;
    if (before === null) fill(sheet, el("p", { class: "empty" }, "Opening …")); // nothing is typed into what goes
    try {
      const view = await ask("procedure", { name });
      if (number !== chosen || (before !== null && JSON.stringify(view) === JSON.stringify(before.view))) return;
      open = name;
      for (const other of list.querySelectorAll("button")) other.setAttribute("aria-pressed", String(other === button));
      shown = new Sheet(view);
    } finally {
      if (number === chosen && (before === null || shown !== before)) fill(sheet, shown?.element ?? empty());
    }
  }

  function line(one) {
    const button = el("button", {
      type: "button", disabled: one.problem !== null, "aria-pressed": String(open === one.name),
      onclick: () => attempt(button, () => choose(one.name, button)),
    }, el("strong", {}, one.title || words(one.name)), el("span", { class: "quiet" }, one.problem ?? one.name));
    return el("li", {}, button);
  }
}

class Sheet {
  constructor(view) {
    this.view = view;
    this.form = new Form(view.parameters, () => this.preview.classList.add("old"), () => this.#look());
    this.preview = el("div", { class: "preview", "aria-live": "polite" });
    this.try = el("button", { type: "button", onclick: () => this.#dryRun() }, "Dry run");
    this.start = el("button", { type: "button", class: "primary big", onclick: () => this.#confirm() }, icon("play"), "Start…");
    this.why = el("p", { class: "quiet", role: "status" });
    this.element = el("article", {},
      el("h2", {}, view.title || words(view.procedure.name)),
      prose(view.doc),
      this.form.element,
      this.#options(),
      isOperator() ? el("div", { class: "row" }, this.try, this.start) : null,
      this.why, this.preview);
    this.permit();
  }

  #options() {
    this.seed = el("input", {
      id: "seed", inputMode: "numeric", pattern: "\\d*", title: "a whole number", placeholder: "chosen by rigd", autocomplete: "off",
    });
    this.own = el("input", { id: "own", type: "checkbox" });
    return el("details", { class: "more" }, el("summary", {}, "More choices"),
      el("div", { class: "fields" },
        el("label", { for: "seed" }, "Seed"), this.seed,
        known.describe.simulated ? [el("label", { for: "own" }, "The procedure answers its own questions"), this.own] : null));
  }

  /** What cannot be started says why. */
  permit() {
    let why = "";
    if (!isOperator()) why = "This page watches; it cannot start a run.";
    else if (known.link !== "ok") why = "Not connected.";
    else if (known.status.run !== null) why = "A run is under way.";
    else if (known.status.trips.some((one) => !one.acknowledged)) why = "An interlock waits to be acknowledged.";
    else if (!hasControl()) why = "Take control to start.";
    this.start.disabled = why !== "";
    say(this.why, why);
  }

  #given() {
    return { procedure: this.view.procedure, set: this.form.values() };
  }

  /** Say what is wrong with what was given so far. */
  async #look() {
    const given = this.#given();
    try {
      const { problems } = await ask("check", given);
      if (JSON.stringify(given) === JSON.stringify(this.#given())) this.form.blame(problems, true);
    } catch (refused) {
      complain(refused);
    }
  }

  async #dryRun() {
    this.form.blame([]);
    fill(this.preview, el("p", { class: "quiet busy" }, "Playing it on the simulated rig …"));
    const found = await attempt(this.try, async () => {
      const given = this.#given();
      const check = await ask("check", given);
      if (!check.ok) {
        this.form.blame(check.problems);
        return null;
      }
      return this.#dryRunOf(given);
    });
    this.preview.classList.remove("old");
    if (found === null) fill(this.preview);
    else drawPreview(this.preview, found);
  }

  async #confirm() {
    if (!this.seed.reportValidity()) return;
    this.form.blame([]);
    const check = await attempt(this.start, () => ask("check", this.#given()));
    this.permit();
    if (check === null) return;
    if (!check.ok) {
      this.form.blame(check.problems);
      return;
    }
    const seed = this.seed.value.trim();
    const args = { ...this.#given(), answers: this.own.checked ? "procedure" : "ask" };
    if (seed) args.seed = Number(seed);
    confirmRun({
      title: `Start ${words(this.view.procedure.name)}?`,
      action: "Start now",
      usual: this.view.on_client_loss,
      facts: [
        ["Procedure", this.view.title || words(this.view.procedure.name)],
        ["Trials", String(check.trials)],
        ["Takes", this.#duration(args)],
        ...this.form.facts(),
        ...(seed ? [["Seed", seed]] : []),
        ...(check.prompts ? [["Questions", this.own.checked ? "answered by the procedure itself" : `${check.prompts}, for you to answer`]] : []),
      ],
      go: async (loss) => {
        await command("start", loss ? { ...args, on_client_loss: loss } : args);
        show("live");
      },
    });
  }

  /** The dry run with these values: what was found before is not worked out again. */
  #dryRunOf(given) {
    const key = JSON.stringify(given);
    if (this.found?.key !== key) {
      const result = command("dry_run", given);
      this.found = { key, result };
      result.catch(() => { this.found = null; });
    }
    return this.found.result;
  }

  /** How long the rig is busy: worked out by a dry run while the person reads the rest. */
  #duration({ procedure, set }) {
    const said = el("span", { class: "busy" }, "being worked out …");
    const tell = (text, isGood = true) => {
      said.className = isGood ? "" : "problem";
      say(said, text);
    };
    this.#dryRunOf({ procedure, set }).then(
      (found) => tell(`about ${duration(found.duration_s)}${found.ok ? "" : `; the dry run says: ${found.refusals.join("; ") || "it would not run clean"}`}`, found.ok),
      (refused) => tell(`not known: ${refused.message}`, false));
    return said;
  }
}

/** What a procedure says of itself: its first paragraph, the others on demand. */
function prose(text) {
  const [first, ...others] = text.trim().split(/\n\s*\n/).map(paragraph);
  return el("div", { class: "doc" }, first,
    others.length ? el("details", { class: "more" }, el("summary", {}, "More about it"), others) : null);
}

/** Lines of prose are joined; commands keep theirs. */
const paragraph = (text) => /^( {2}|rigd |\$ )/m.test(text)
  ? el("pre", {}, text)
  : el("p", {}, text.replace(/\s*\n\s*/g, " "));
