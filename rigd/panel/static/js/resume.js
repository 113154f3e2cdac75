// Going on with a run that was interrupted: asked as a start is, since the rig moves as at a start.

import { ask, command } from "./api.js";
import { confirmRun } from "./confirm.js";
import { el, file, icon } from "./dom.js";
import { ago, day, parameters, quantities, words } from "./format.js";
import { known, rigNow } from "./store.js";
import { show } from "./tabs.js";
import { attempt } from "./toasts.js";

/** Asks whether to go on with the run recorded in the file `run`. */
export function resumeButton(run, mine) {
  const made = el("button", {
    type: "button", class: "primary", disabled: !mine,
    onclick: async () => {
      const found = await attempt(made, () => ask("run", { run }));
      if (found !== null) confirm(run, found);
    },
  }, icon("play"), "Go on with it…");
  return made;
}

function confirm(run, { line, details }) {
  const interrupted = known.status.interrupted.find((one) => one.run === run);
  const { trials_done: done, trials_total: total } = interrupted ?? line;
  confirmRun({
    title: `Go on with ${words(line.procedure)}?`,
    action: "Go on now",
    usual: "",
    facts: [
      ["Procedure", words(line.procedure)],
      ["Began", `${day(line.started_ns / 1e6)}, ${ago((rigNow() - line.started_ns / 1e6) / 1e3)}`],
      ["Ended", interrupted?.reason ?? words(line.state)],
      ["Trials left", `${total - done} of ${total}`],
      ...settings(details),
      ["Recording", file(run)],
    ],
    go: async (loss) => {
      await command("resume_run", loss ? { run, on_client_loss: loss } : { run });
      show("live");
    },
  });
}

/** What was set for the whole run, and what the last trial that was played had. */
function settings({ parameters: set = {}, trials = [] }) {
  const given = Object.entries(set).map(([name, value]) => [words(name), quantities(String(value))]);
  const last = trials.at(-1);
  const varied = last === undefined ? [] : parameters(last).filter(([name]) => !(name in set));
  return [...given, ...varied.map(([name, value]) => [words(name), `${value} (in trial ${last.number})`])];
}
