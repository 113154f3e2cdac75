// The recordings, and the report of each.

import { ask, asRefused, command, compare } from "./api.js";
import { el, file, fill, icon, reveal, setText } from "./dom.js";
import { bytes, day, duration, words, withHint } from "./format.js";
import { calibrateButton } from "./calibrate.js";
import { resumeButton } from "./resume.js";
import { hasControl, isOperator, read, watch } from "./store.js";
import { onShow } from "./tabs.js";
import { attempt, complain } from "./toasts.js";

const PAGE = 50;
const MOST_COMPARED = 20;

/** @param {HTMLElement} root */
export function mountRuns(root) {
  const body = el("tbody");
  /** @type {HTMLButtonElement} */
  const more = el("button", { type: "button", hidden: true, onclick: () => attempt(more, () => load(false)) }, "Older ones");
  const wanted = el("input", { type: "search", id: "run-where", placeholder: "such as specimen == W7", autocomplete: "off", autocapitalize: "none", spellcheck: false, maxLength: 2000 });
  const wrong = el("p", { class: "problem", role: "alert", hidden: true });
  const search = el("form", { class: "run-search", role: "search", onsubmit: (/** @type {Event} */ event) => {
    event.preventDefault();
    refresh(wanted.value.trim());
  } }, el("label", { for: "run-where" }, "Find"), wanted, el("button", { type: "submit" }, "Search"));
  // The cross of the field empties it: all runs again.
  wanted.addEventListener("search", () => wanted.value === "" && refresh(""));
  /** @type {Map<string, Api.RunLine>} */
  const marked = new Map();
  /** @type {HTMLButtonElement} */
  const comparing = el("button", {
    type: "button", disabled: true, onclick: () => attempt(comparing, () => drawComparison(sheet, [...marked.values()])),
  });
  const sheet = el("div", { class: "sheet" }, el("p", { class: "empty" }, "Choose a run."));
  root.append(
    el("section", { class: "panel run-list", "aria-label": "Recordings" },
      el("div", { class: "panel-head" }, el("h2", {}, "Runs"), comparing),
      search, wrong,
      el("div", { class: "scroll" },
        el("table", {},
          el("thead", {}, el("tr", {}, el("th", { scope: "col" }, el("span", { class: "unseen" }, "Compare")), ...["Started", "Procedure", "State", "Trials", "Took"].map((text) => el("th", { scope: "col" }, text)))),
          body)),
      more),
    el("section", { class: "panel wide", "aria-label": "The run" }, sheet));
  let where = ""; // the condition of the list
  let wants = ""; // that of the last question, which may be on its way
  let oldest = /** @type {string | null} */ (null);
  let open = /** @type {string | null} */ (null);
  let asking = 0;
  let lastRun = /** @type {string | null | undefined} */ (undefined);

  /**
   * @param {boolean} fresh
   */
  async function load(fresh, asked = where) {
    const own = ++asking;
    const { runs, more: isMore } = await ask("runs", { limit: PAGE, where: asked, before: fresh ? null : oldest });
    if (own !== asking) return; // a later question has been asked since
    where = asked;
    wrong.hidden = true;
    if (fresh) fill(body);
    body.append(...runs.map(line));
    oldest = runs.at(-1)?.run ?? oldest;
    more.hidden = !isMore;
    if (fresh && runs.length === 0) fill(body, el("tr", {}, el("td", { colSpan: 6, class: "empty" }, where ? "No recordings match." : "No recordings yet.")));
  }

  function count() {
    comparing.disabled = marked.size < 2 || marked.size > MOST_COMPARED;
    setText(comparing, marked.size < 2 ? "Mark runs to compare" : marked.size > MOST_COMPARED
      ? `At most ${MOST_COMPARED} are compared` : `Compare ${marked.size} runs`);
  }

  count();

  /** Without a condition, that of the last question counts: a new run must not ask for one that is half typed. */
  async function refresh(asked = wants) {
    wants = asked;
    try {
      await load(true, asked);
    } catch (error) {
      const refused = asRefused(error);
      if (refused.code !== "bad_request") complain(refused);
      else {
        if (wants === asked) wants = where;
        setText(wrong, withHint(refused));
        wrong.hidden = false;
      }
    }
  }

  onShow("runs", () => refresh());
  // A run that has ended adds a recording.
  watch("status", () => {
    const { run } = read("status");
    if (run === lastRun) return;
    lastRun = run;
    if (root.offsetParent) refresh();
  });

  /** @param {Api.RunLine} item */
  function line(item) {
    const choose = el("button", { type: "button", class: "row-button", onclick: () => pick(item, row) },
      began(item));
    const given = [item.specimen, item.set].filter(Boolean).join(", ");
    /** @type {HTMLInputElement} */
    const mark = el("input", {
      type: "checkbox", checked: marked.has(item.run), disabled: item.problem !== null || item.state === "running",
      "aria-label": `Compare ${title(item)}`,
      onclick: (event) => event.stopPropagation(),
      onchange: () => {
        if (mark.checked) marked.set(item.run, item);
        else marked.delete(item.run);
        count();
      },
    });
    /** @type {HTMLTableRowElement} */
    const row = el("tr", { data: { chosen: String(open === item.run) }, onclick: (event) => event.target !== choose && pick(item, row) },
      el("td", {}, mark),
      el("th", { scope: "row" }, choose),
      el("td", {}, words(item.procedure) || file(item.run), el("span", { class: "quiet", title: given }, given)),
      el("td", {}, el("span", { class: "ending", data: { ending: item.state } }, words(item.state)),
        item.condition ? el("small", { title: fileWords(item) }, `, file ${item.condition}`) : null),
      el("td", { class: "value" }, item.procedure ? `${item.trials_done}/${item.trials_total}` : ""),
      el("td", { class: "value" }, item.procedure ? duration(item.duration_s) : ""));
    return row;
  }

  /**
   * @param {Api.RunLine} item
   * @param {HTMLTableRowElement} row
   */
  function pick(item, row) {
    open = item.run;
    for (const other of body.rows) other.dataset.chosen = String(other === row);
    drawRun(sheet, item, refresh);
    reveal(sheet);
  }
}

/**
 * Compare runs, from the oldest on: differences are from the first.
 * @param {HTMLElement} root
 * @param {Api.RunLine[]} items
 */
async function drawComparison(root, items) {
  const runs = items.sort((a, b) => a.started_ns - b.started_ns || (a.run < b.run ? -1 : 1)).map((item) => item.run);
  const source = `/api/comparison?${new URLSearchParams(runs.map((run) => ["run", run]))}`;
  const report = el("div", { class: "report" });
  const note = el("span", { class: "quiet", role: "status" }, "Comparing …");
  const own = el("a", { class: "button", target: "_blank", rel: "noopener", href: source, hidden: true }, "In a new page");
  fill(root,
    el("div", { class: "panel-head" }, el("h2", {}, `${runs.length} runs compared`), own, note),
    el("p", { class: "quiet" }, ...runs.flatMap((run, index) => [index ? ", " : "", file(run)])),
    report);
  reveal(root);
  try {
    await compare(runs);
    fill(report, el("iframe", { src: source, title: "Comparison of runs", sandbox: "" }));
    own.hidden = false;
  } catch (error) {
    fill(report, el("p", { class: "problem empty" }, withHint(asRefused(error))));
  } finally {
    setText(note, "");
  }
}

/**
 * @param {HTMLElement} root
 * @param {Api.RunLine} item
 * @param {() => void} refresh
 */
function drawRun(root, item, refresh) {
  const path = `/api/run/${encodeURIComponent(item.run)}`;
  const report = el("div", { class: "report" });
  const note = el("span", { class: "quiet", role: "status" });
  const own = el("a", { class: "button", target: "_blank", rel: "noopener", hidden: true }, "In a new page");
  /** @param {"run" | "identification"} page */
  const show = (page) => {
    const source = `${path}/report?page=${page}`;
    fill(report, el("iframe", {
      // A new address each time, so that a new report replaces the old report.
      src: `${source}&at=${Date.now()}`, title: `Report of ${item.run}`, sandbox: "", loading: "lazy",
    }));
    own.href = source;
    own.hidden = false;
  };
  /**
   * @param {string} text
   * @param {"draw" | "identify"} verb
   * @param {"run" | "identification"} page
   * @param {string} doing
   */
  const maker = (text, verb, page, doing) => {
    /** @type {HTMLButtonElement} */
    const button = el("button", {
      type: "button", onclick: () => attempt(button, async () => {
        setText(note, doing);
        try {
          await command(verb, { run: item.run });
          show(page);
          refresh();
        } catch (error) {
          const reason = withHint(asRefused(error));
          own.hidden = true;
          fill(report, el("p", { class: "problem empty" }, reason));
        } finally {
          setText(note, "");
        }
      }),
    }, text);
    return button;
  };
  // Drawing a recording commands nothing: no control is needed.
  const draw = isOperator() && item.problem === null ? maker("Show the recording", "draw", "run", "Drawing …") : null;
  const canMake = hasControl() && item.identifies && item.problem === null;
  const make = canMake
    ? maker(item.has_report ? "Make the report again" : "Make the report", "identify", "identification", "Identifying …")
    : null;
  const status = read("status");
  const canResume = status.run === null && status.interrupted.some((other) => other.run === item.run);
  fill(root,
    el("div", { class: "panel-head" },
      el("h2", {}, item.procedure ? title(item) : file(item.run)),
      el("a", { class: "button", href: `${path}/recording`, download: item.run }, icon("down"), `Recording (${bytes(item.size)})`),
      draw, item.has_report && !make ? el("button", { type: "button", onclick: () => show("identification") }, "Show the report") : null,
      make, canMake && item.calibrates && item.state === "complete" ? calibrateButton(item.run) : null,
      own, canResume ? resumeButton(item.run, hasControl()) : null, note),
    el("p", { class: "quiet" }, file(item.run), `: ${fileWords(item)}`),
    item.problem === null ? null : el("p", { class: "problem" }, item.problem),
    report);
  if (item.has_report) show("identification");
  else if (item.has_page) show("run");
  else fill(report, el("p", { class: "empty" }, empty(item)));
}

/**
 * When a run began; of a file that tells nothing about its run, that.
 * @param {Api.RunLine} item
 */
const began = (item) => (item.started_ns ? day(item.started_ns / 1e6) : "no date");

/**
 * The procedure of a run and its beginning, or the name of a file that tells neither.
 * @param {Api.RunLine} item
 */
const title = (item) => (item.procedure ? `${words(item.procedure)}, ${began(item)}` : item.run);

/**
 * What the file of a recording is: whole, valid or damaged.
 * @param {Api.RunLine} item
 */
function fileWords(item) {
  if (item.state === "running") return "being written";
  if (item.condition === "valid") return "valid, written by another program";
  if (item.condition) return item.condition;
  return item.problem === null ? "written by rigd, not checked since" : "cannot be read";
}

/** @param {Api.RunLine} item */
function empty(item) {
  if (item.problem !== null) return "";
  if (!isOperator()) return "No report yet. An operator can make it.";
  if (item.identifies && !hasControl()) return "No report yet. The person who has control can make it.";
  return item.identifies ? "No report yet." : "The procedure of this run has no analysis.";
}
