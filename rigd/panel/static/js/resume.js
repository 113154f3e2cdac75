// Continues an interrupted run: asks for confirmation like a start, because the rig moves.

import { ask, command } from "./api.js";
import { confirmRun } from "./confirm.js";
import { el, file, icon } from "./dom.js";
import { ago, day, parameters, quantities, words } from "./format.js";
import { read, rigNow } from "./store.js";
import { show } from "./tabs.js";
import { attempt } from "./toasts.js";

/**
 * Asks whether to continue the run recorded in the file `run`.
 * @param {string} run
 * @param {boolean} mine
 */
export function resumeButton(run, mine) {
  /** @type {HTMLButtonElement} */
  const made = el("button", {
    type: "button", class: "primary", disabled: !mine,
    onclick: async () => {
      const found = await attempt(made, () => ask("run", { run }));
      if (found !== null) confirm(run, found);
    },
  }, icon("play"), "Continue it…");
  return made;
}

/**
 * @param {string} run
 * @param {Api.PageRun} found
 */
function confirm(run, found) {
  const { line } = found;
  const interrupted = read("status").interrupted.find((item) => item.run === run);
  const { trials_done: done, trials_total: total } = interrupted ?? line;
  confirmRun({
    title: `Continue ${words(line.procedure)}?`,
    action: "Continue now",
    usual: "",
    facts: [
      ["Procedure", words(line.procedure)],
      ["Began", `${day(line.started_ns / 1e6)}, ${ago((rigNow() - line.started_ns / 1e6) / 1e3)}`],
      ["Ended", interrupted?.reason ?? words(line.state)],
      ["Trials left", `${total - done} of ${total}`],
      ...settings(found),
      ["Recording", file(run)],
    ],
    go: async (loss) => {
      await command("resume_run", loss ? { run, on_client_loss: loss } : { run });
      show("live");
    },
  });
}

/**
 * The values of the whole run, and those of the last trial.
 * @param {Api.PageRun} found
 * @returns {[string, Child][]}
 */
function settings({ parameters: set, last_trial: last }) {
  /** @type {[string, Child][]} */
  const given = Object.entries(set).map(([name, value]) => [words(name), quantities(String(value))]);
  if (last === null) return given;
  for (const [name, value] of parameters(last)) {
    if (!(name in set)) given.push([words(name), `${value} (in trial ${last.number})`]);
  }
  return given;
}
