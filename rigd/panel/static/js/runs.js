// The recordings, and the report of each.

import { ask, command } from "./api.js";
import { el, file, fill, icon, say } from "./dom.js";
import { bytes, day, duration, words, withHint } from "./format.js";
import { resumeButton } from "./resume.js";
import { hasControl, isOperator, known, watch } from "./store.js";
import { onShow } from "./tabs.js";
import { attempt, complain } from "./toasts.js";

const PAGE = 50;

export function mountRuns(root) {
  const body = el("tbody");
  const more = el("button", { type: "button", hidden: true, onclick: () => attempt(more, () => load(false)) }, "Older ones");
  const sheet = el("div", { class: "sheet" }, el("p", { class: "empty" }, "Choose a run."));
  root.append(
    el("section", { class: "panel run-list", "aria-label": "Recordings" },
      el("div", { class: "panel-head" }, el("h2", {}, "Runs")),
      el("div", { class: "scroll" },
        el("table", {},
          el("thead", {}, el("tr", {}, ...["Started", "Procedure", "State", "Trials", "Took"].map((text) => el("th", { scope: "col" }, text)))),
          body)),
      more),
    el("section", { class: "panel wide", "aria-label": "The run" }, sheet));
  let oldest = null;
  let open = null;
  let lastRun;

  async function load(fresh) {
    const { runs, more: isMore } = await ask("runs", fresh || oldest === null ? { limit: PAGE } : { limit: PAGE, before: oldest });
    if (fresh) fill(body);
    body.append(...runs.map(line));
    oldest = runs.at(-1)?.run ?? oldest;
    more.hidden = !isMore;
    if (fresh && runs.length === 0) fill(body, el("tr", {}, el("td", { colSpan: 5, class: "empty" }, "No recordings yet.")));
  }

  async function refresh() {
    try {
      await load(true);
    } catch (refused) {
      complain(refused);
    }
  }

  onShow("runs", refresh);
  // A run that has ended is a recording more.
  watch("status", () => {
    if (known.status.run === lastRun) return;
    lastRun = known.status.run;
    if (root.offsetParent) refresh();
  });

  function line(one) {
    const choose = el("button", { type: "button", class: "row-button", onclick: () => pick(one, row) },
      day(one.started_ns / 1e6));
    const row = el("tr", { data: { chosen: String(open === one.run) }, onclick: (event) => event.target !== choose && pick(one, row) },
      el("th", { scope: "row" }, choose),
      el("td", {}, words(one.procedure)),
      el("td", {}, el("span", { class: "ending", data: { ending: one.state } }, words(one.state))),
      el("td", { class: "value" }, `${one.trials_done}/${one.trials_total}`),
      el("td", { class: "value" }, duration(one.duration_s)));
    return row;
  }

  function pick(one, row) {
    open = one.run;
    for (const other of body.rows) other.dataset.chosen = String(other === row);
    drawRun(sheet, one, refresh);
    // Where the page is narrow, the run stands below the list.
    if (sheet.getBoundingClientRect().top > innerHeight / 2) sheet.scrollIntoView({ behavior: "smooth" });
  }
}

function drawRun(root, one, refresh) {
  const path = `/api/run/${encodeURIComponent(one.run)}`;
  const report = el("div", { class: "report" });
  const note = el("span", { class: "quiet", role: "status" });
  const own = el("a", { class: "button", target: "_blank", rel: "noopener", hidden: true }, "In a page of its own");
  const show = (page) => {
    const source = `${path}/report?page=${page}`;
    fill(report, el("iframe", {
      // An address of its own each time, so that a new report replaces the old one.
      src: `${source}&at=${Date.now()}`, title: `Report of ${one.run}`, sandbox: "", loading: "lazy",
    }));
    own.href = source;
    own.hidden = false;
  };
  const maker = (text, verb, page, doing) => {
    const button = el("button", {
      type: "button", onclick: () => attempt(button, async () => {
        say(note, doing);
        try {
          await command(verb, { run: one.run });
          show(page);
          refresh();
        } catch (refused) {
          if (refused.code === undefined) throw refused;
          own.hidden = true;
          fill(report, el("p", { class: "problem empty" }, withHint(refused)));
        } finally {
          say(note, "");
        }
      }),
    }, text);
    return button;
  };
  // Looking at what was recorded commands nothing: no control is needed for it.
  const draw = isOperator() ? maker("Show what was recorded", "draw", "run", "Drawing …") : null;
  const canMake = hasControl() && one.identifies && one.problem === null;
  const make = canMake
    ? maker(one.has_report ? "Make the report anew" : "Make the report", "identify", "identification", "Identifying …")
    : null;
  const canResume = known.status.run === null && known.status.interrupted.some((other) => other.run === one.run);
  fill(root,
    el("div", { class: "panel-head" },
      el("h2", {}, `${words(one.procedure)}, ${day(one.started_ns / 1e6)}`),
      el("a", { class: "button", href: `${path}/recording`, download: one.run }, icon("down"), `Recording (${bytes(one.size)})`),
      draw, one.has_report && !make ? el("button", { type: "button", onclick: () => show("identification") }, "Show the report") : null,
      make, own, canResume ? resumeButton(one.run, hasControl()) : null, note),
    el("p", { class: "quiet" }, file(one.run)),
    one.problem === null ? null : el("p", { class: "problem" }, one.problem),
    report);
  if (one.has_report) show("identification");
  else if (one.has_page) show("run");
  else fill(report, el("p", { class: "empty" }, empty(one)));
}

function empty(one) {
  if (!isOperator()) return "No report yet. Whoever may command can make it.";
  if (one.identifies && !hasControl()) return "No report yet. Whoever has control can make it.";
  return one.identifies ? "No report yet." : "Nothing is identified from this run.";
}
