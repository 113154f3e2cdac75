// The state of the rig in one word, and what it is doing; and how far it has come.

import { setTitle } from "./call.js";
import { el, icon, mark, say } from "./dom.js";
import { duration, STATES, words } from "./format.js";
import { known, watch } from "./store.js";

export function mountState(root) {
  const word = el("strong", { class: "state-word" });
  const doing = el("span", { class: "state-doing" });
  const rig = el("span", { class: "state-rig" });
  const left = el("span", { class: "state-left" });
  root.append(
    el("div", { class: "state-lamp" }, icon("play")),
    el("div", { class: "state-text" }, el("div", { class: "state-line" }, word, left), doing, rig),
  );
  const bar = el("div", { class: "progress", "aria-hidden": "true" }, el("div"));
  root.after(bar);

  watch(["status", "link"], () => {
    const { status, link } = known;
    if (link !== "ok" || status === null) {
      mark(root, "mood", "lost");
      say(word, link === "connecting" ? "Connecting" : "Not connected");
      say(doing, link === "connecting" ? "" : "What is shown here is old");
      say(left, "");
      bar.hidden = true;
      setTitle("✕ not connected");
      return;
    }
    const [name, meaning, mood] = STATES[status.state];
    const [title, note, look] = pressing(status) ?? [name, activity(status) || meaning, mood];
    mark(root, "mood", look);
    say(word, title);
    say(doing, note);
    say(rig, status.title || status.rig);
    const done = status.trials_total ? status.trials_done / status.trials_total : 0;
    bar.hidden = status.run === null;
    bar.firstChild.style.setProperty("--done", share(status, done));
    say(left, status.left_s === null ? "" : `${duration(status.left_s)} left`);
    setTitle(`${title} – ${status.rig}`);
  });
}

/** What is more urgent than the state itself: a question, or a trip that nobody has looked at. */
function pressing(status) {
  if (status.prompt !== null) return ["Waiting for you", `${words(status.procedure ?? "")} asks a question`, "ask"];
  const tripped = status.trips.some((one) => one.action !== "warn" && !one.acknowledged);
  if (tripped && status.run === null) return ["Tripped", "An interlock waits to be acknowledged", "bad"];
  return null;
}

/** How much is done: by time where an estimate exists, else by trials. */
export function share(status, byTrials) {
  const whole = status.run_s + (status.left_s ?? 0);
  return status.left_s === null || whole <= 0 ? byTrials : status.run_s / whole;
}

function activity(status) {
  const parts = [];
  if (status.procedure) parts.push(words(status.procedure));
  if (status.trial) parts.push(`trial ${status.trial.number} of ${status.trials_total}`);
  if (status.trial?.label) parts.push(status.trial.label);
  if (status.step) parts.push(status.step);
  return parts.join(" · ");
}
