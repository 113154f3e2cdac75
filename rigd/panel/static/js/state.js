// Shows the state of the rig in one word, its activity, and its progress.

import { setTitle } from "./call.js";
import { el, fill, icon, mark, setText } from "./dom.js";
import { duration, STATES, words } from "./format.js";
import { known, watch } from "./store.js";

/** @param {HTMLElement} root */
export function mountState(root) {
  const word = el("strong", { class: "state-word" });
  const doing = el("span", { class: "state-doing" });
  const rig = el("h1", { class: "state-rig" });
  const left = el("span", { class: "state-left" });
  root.append(
    el("div", { class: "state-lamp" }, icon("play")),
    el("div", { class: "state-text" }, el("div", { class: "state-line" }, word, left), doing, rig),
  );
  const done = el("div");
  const bar = el("div", { class: "progress", "aria-hidden": "true" }, done);
  root.after(bar);

  watch(["status", "link"], () => {
    const { status, link } = known;
    if (link !== "ok" || status === null) {
      mark(root, "mood", "lost");
      setText(word, link === "connecting" ? "Connecting" : "Not connected");
      setText(doing, link === "connecting" ? "" : "The values shown here are old");
      setText(left, "");
      bar.hidden = true;
      setTitle("✕ not connected");
      return;
    }
    const [name, meaning, mood] = STATES[status.state];
    const [title, note, look] = pressing(status) ?? [name, activity(status) || meaning, mood];
    mark(root, "mood", look);
    setText(word, title);
    setText(doing, note);
    fill(rig, el("strong", {}, status.rig), status.title ? ` – ${status.title}` : null);
    const trials = status.trials_total ? status.trials_done / status.trials_total : 0;
    bar.hidden = status.run === null;
    done.style.setProperty("--done", String(share(status, trials)));
    setText(left, until(status));
    setTitle(`${title} – ${status.rig}`);
  });
}

/**
 * A message more urgent than the state: a prompt, or a trip that is not acknowledged.
 * @param {Api.PageStatus} status
 * @returns {[string, string, string] | null}
 */
function pressing(status) {
  if (status.prompt !== null) return ["Waiting for you", `${words(status.procedure ?? "")} asks a question`, "ask"];
  const tripped = status.trips.some((item) => item.action !== "warn" && !item.acknowledged);
  const isOver = status.run === null || status.ending !== "";
  const rests = "The rig comes to rest; rows are recorded until then";
  if (tripped && isOver) return ["Tripped", status.coming_to_rest ? rests : "An interlock waits to be acknowledged", "bad"];
  if (status.coming_to_rest) return ["Coming to rest", `${words(status.ending)}. ${rests}`, "warn"];
  return null;
}

/**
 * The time that is left, until the pause or until the end; "" if it is not known, or the run has ended.
 * @param {Api.PageStatus} status
 */
function until({ state, pause_in_s: pause, left_s: left, ending }) {
  if (state === "pausing") return pause === null ? "" : `pauses within ${duration(pause)}`;
  return left === null || ending !== "" ? "" : `${duration(left)} left`;
}

/**
 * The progress: by time if there is an estimate, else by trials.
 * @param {Api.PageStatus} status
 * @param {number} byTrials
 */
export function share(status, byTrials) {
  const whole = status.run_s + (status.left_s ?? 0);
  return status.left_s === null || whole <= 0 ? byTrials : status.run_s / whole;
}

/** @param {Api.PageStatus} status */
function activity(status) {
  const parts = [];
  if (status.procedure) parts.push(words(status.procedure));
  if (status.trial) parts.push(`trial ${status.trial.number} of ${status.trials_total}`);
  if (status.trial?.label) parts.push(status.trial.label);
  if (status.step) parts.push(status.step);
  return parts.join(" · ");
}
