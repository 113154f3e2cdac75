// The run in progress: its varying parameters, its progress, pause and resume.

import { command } from "./api.js";
import { el, file, fill, flag, icon, setText } from "./dom.js";
import { duration, parameters, quantities, words } from "./format.js";
import { share } from "./state.js";
import { hasControl, isOperator, known, watch } from "./store.js";
import { show } from "./tabs.js";
import { attempt } from "./toasts.js";

/** @param {HTMLElement} root */
export function mountRun(root) {
  const title = el("h2", {}, "No run");
  const pause = steer("pause", "Pause", "");
  const resume = steer("play", "Resume", "");
  pause.addEventListener("click", () => attempt(pause, () => command("pause", {})));
  resume.addEventListener("click", () => attempt(resume, () => command("resume", {})));
  const dots = el("div", { class: "trials", "aria-hidden": "true" });
  const facts = el("dl", { class: "facts" });
  const body = el("div");
  root.append(el("div", { class: "panel-head" }, title, pause, resume), body);
  let shape = "";
  watch(["status", "link"], () => {
    if (known.status === null) return;
    const { status } = known;
    const mine = hasControl();
    pause.hidden = status.state !== "running";
    pause.title = pauseOf(status);
    resume.classList.toggle("primary", status.state !== "pausing");
    resume.hidden = !["paused", "held", "pausing"].includes(status.state);
    for (const button of [pause, resume]) flag(button, "disabled", !mine);
    if (status.run === null) {
      const key = JSON.stringify([status.last, status.interrupted[0], isOperator()]);
      if (shape !== key) rest(title, body, status);
      shape = key;
      return;
    }
    if (shape !== status.run) {
      fill(body, dots, facts, el("p", { class: "quiet recording" }, file(status.run)));
      shape = status.run;
    }
    setText(title, words(status.procedure ?? ""));
    draw(dots, status);
    describe(facts, status);
  });
}

/**
 * @param {"pause" | "play"} drawing
 * @param {string} text
 * @param {string} title
 */
function steer(drawing, text, title) {
  return el("button", { type: "button", title, hidden: true }, icon(drawing), text);
}

/** @param {Api.PageStatus} status */
const pauseOf = ({ can_hold }) => (can_hold ? "holds this step" : "at the next step that can be held, or after this trial");

/**
 * A dot for each trial, or a bar if there are too many trials.
 * @param {HTMLElement} dots
 * @param {Api.PageStatus} status
 */
function draw(dots, status) {
  const count = status.trials_total <= 60 ? status.trials_total : 0;
  if (dots.childElementCount !== count) fill(dots, Array.from({ length: count }, () => el("i")));
  for (let index = 0; index < count; index++) {
    const is = index < status.trials_done ? "done" : index === status.trials_done ? "now" : "next";
    if (dots.children[index].className !== is) dots.children[index].className = is;
  }
}

/**
 * @param {HTMLElement} facts
 * @param {Api.PageStatus} status
 */
function describe(facts, status) {
  const lines = [
    ["Trials", `${status.trials_done} of ${status.trials_total} done`],
    ["Time", status.state === "preflight"
      ? "counts once the rig is armed"
      : status.left_s === null
      ? `${duration(status.run_s)} so far`
      : `${duration(status.run_s)} of about ${duration(status.run_s + status.left_s)}, ${Math.round(100 * share(status, 0))}\u202f%`],
    ...(status.state === "pausing" ? [["Pause", `${status.pause_in_s === null ? "" : `within ${duration(status.pause_in_s)}: `}${pauseOf(status)}`]] : []),
    ...(status.waits === "" ? [] : [["Paused", quantities(status.waits)]]),
    ["Step", status.step ?? "–"],
    ...(status.trial === null ? [] : parameters(status.trial))
      .map(([name, value]) => [words(name), value]),
  ];
  if (facts.childElementCount !== 2 * lines.length) {
    fill(facts, lines.flatMap(() => [el("dt"), el("dd")]));
  }
  lines.forEach(([name, value], index) => {
    setText(facts.children[2 * index], name);
    setText(facts.children[2 * index + 1], value);
  });
}

/**
 * @param {HTMLElement} title
 * @param {HTMLElement} body
 * @param {Api.PageStatus} status
 */
function rest(title, body, status) {
  const { last } = status;
  // Before the daemon started: that one has played none yet.
  const broken = last === null ? status.interrupted[0] : undefined;
  setText(title, last !== null ? "Last run" : broken ? "Interrupted run" : "No run yet");
  fill(
    body,
    broken === undefined ? null : el("dl", { class: "facts" },
      el("dt", {}, "Trials"), el("dd", {}, `${broken.trials_done} of ${broken.trials_total} done`),
      el("dt", {}, "Why"), el("dd", {}, broken.reason),
      el("dt", {}, "Recording"), el("dd", {}, file(broken.run))),
    last === null ? null : el("dl", { class: "facts" },
      el("dt", {}, "Ended"), el("dd", {}, el("span", { class: "ending", data: { ending: last.ending } }, words(last.ending))),
      last.reason ? [el("dt", {}, "Why"), el("dd", {}, last.reason)] : null,
      last.recorded ? [el("dt", {}, "Recording"), el("dd", {}, file(last.run))] : null),
    el("div", { class: "row" },
      isOperator() ? el("button", { type: "button", class: "primary", onclick: () => show("procedures") }, "Choose a procedure") : null,
      el("button", { type: "button", onclick: () => show("runs") }, "Recordings")),
  );
}
