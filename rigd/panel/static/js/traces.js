// The plane with its bodies, and the traces: one plot for each unit; all over the same stretch of time.

import { channelInfo } from "./infos.js";
import { chosen, watchChosen } from "./choice.js";
import { el, fill, flag, icon, setText } from "./dom.js";
import { clock, duration } from "./format.js";
import { dropDetail, fetchDetail, hasDetail, newestTime } from "./histories.js";
import { showAtMost, watchFrames } from "./link.js";
import { Plane } from "./plane.js";
import { Plot } from "./plot.js";
import { known, read, rigNow, watch } from "./store.js";

const SPANS = [5, 20, 60, 300, 1800];
const LEAST_S = 0.02;
const MOST_S = 5 * 3600;
const LATE_S = 1; // live data that are older than this are not of now
const SLOWEST_S = 0.2; // least time between drawings while frames arrive
const PER_COLUMN = 1.5; // points that a column of pixels is drawn from
const LEAST_PER_S = 20; // points in each second, for the values beside the traces
const MOST_PER_S = 5000;
const MOST_POINTS = 4096; // of a stream in one answer
const FINE_S = 30; // the panel has the newest half minute in full
const ASK_MS = 300; // the panel is asked when the view has stood still for so long

/** @param {HTMLElement} root */
export function mountTraces(root) {
  /**
   * `end` null: live, the newest at the right edge.
   * @type {{ span: number, end: number | null }}
   */
  const view = { span: 20, end: null };
  const hold = el("button", { type: "button", class: "hold" });
  const behind = el("span", { class: "quiet behind", role: "status" });
  const spans = SPANS.map((seconds) =>
    el("button", { type: "button", onclick: () => zoomTo(seconds) }, seconds < 60 ? `${seconds} s` : `${seconds / 60} min`));
  const area = el("div", {
    class: "plots", tabIndex: 0, role: "group",
    "aria-label": "Traces. Arrow keys move and zoom, space holds, Home returns to live.", onkeydown: key,
  });
  root.append(
    el("div", { class: "panel-head" }, el("h2", {}, "Traces"),
      el("div", { class: "spans", role: "group", "aria-label": "Time shown" }, ...spans), hold, behind),
    area);
  const empty = el("p", { class: "empty" });
  const noData = el("p", { class: "no-data" });
  root.append(noData);
  /** @type {Plot[]} */
  let plots = [];
  /** @type {Plane | null} */
  let plane = null;
  let isDue = false; // a drawing is due: without one the browser has nothing to do
  let hasMore = false; // than was drawn
  let drawnTo = -Infinity; // live data are drawn again when they have moved by half a pixel

  const now = () => view.end ?? newestTime();
  /** @type {import("./gestures.js").Actions} */
  const actions = {
    now,
    pan(seconds) {
      look(now() + seconds, view.span);
    },
    zoom(factor, anchor) {
      const span = Math.max(LEAST_S, Math.min(MOST_S, view.span * factor));
      const kept = anchor === null || view.end === null ? now() : anchor + ((now() - anchor) * span) / view.span;
      look(kept, span);
    },
    live: () => look(Infinity, view.span),
  };

  /**
   * @param {number} end
   * @param {number} span
   */
  function look(end, span) {
    view.span = span;
    view.end = end >= newestTime() ? null : end;
    redraw();
    toolbar();
    refine();
  }

  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let asking;
  /** Ask the panel for as many points as the plots can show: live, and once of a short time that is held. */
  function refine() {
    const columns = Math.max(...plots.map((plot) => plot.columns), 0);
    if (columns === 0) return;
    const most = (PER_COLUMN * columns) / view.span;
    clearTimeout(asking);
    if (view.end === null) {
      showAtMost(Math.round(Math.min(MOST_PER_S, Math.max(LEAST_PER_S, most))));
      dropDetail();
      return;
    }
    const { span, end } = view;
    if (span >= FINE_S || end < newestTime() - FINE_S || hasDetail(end - span, end)) return;
    asking = setTimeout(async () => {
      await fetchDetail(end - 2 * span, Math.min(end + span, newestTime()), Math.min(MOST_POINTS, 6 * columns));
      redraw();
    }, ASK_MS);
  }

  /** @param {number} seconds */
  function zoomTo(seconds) {
    look(view.end ?? Infinity, seconds);
  }

  function toggleHold() {
    if (view.end === null) {
      look(newestTime() - 1e-6, view.span);
    } else actions.live();
  }

  /** @param {KeyboardEvent} event */
  function key(event) {
    /** @type {Record<string, number>} */
    const steps = { ArrowLeft: -0.25, ArrowRight: 0.25 };
    /** @type {Record<string, number>} */
    const factors = { ArrowUp: 0.5, ArrowDown: 2, "+": 0.5, "-": 2 };
    if (event.target !== area || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key in steps) actions.pan(steps[event.key] * view.span);
    else if (event.key in factors) actions.zoom(factors[event.key], null);
    else if (event.key === " ") toggleHold();
    else if (event.key === "Home") actions.live();
    else return;
    event.preventDefault();
  }

  function toolbar() {
    const isLive = view.end === null;
    if (hold.dataset.live !== String(isLive)) {
      hold.dataset.live = String(isLive);
      fill(hold, icon(isLive ? "pause" : "play"), isLive ? "Hold" : "Live");
    }
    spans.forEach((button, index) => button.setAttribute("aria-pressed", String(SPANS[index] === view.span)));
    setText(behind, view.end === null || !Number.isFinite(view.end)
      ? ""
      : `held at ${clock(view.end * 1000)}, ${duration(newestTime() - view.end)} behind`);
  }

  const parts = () => [...(plane === null ? [] : [plane]), ...plots];

  function rebuild() {
    for (const part of parts()) part.destroy();
    /** @type {Map<string, import("./infos.js").Info[]>} */
    const byUnit = new Map();
    for (const name of chosen()) {
      const info = channelInfo(name);
      if (info !== undefined) byUnit.set(info.unit, [...(byUnit.get(info.unit) ?? []), info]);
    }
    plots = [...byUnit].map(([symbol, infos], place) =>
      new Plot(area, symbol, infos, actions, place === byUnit.size - 1));
    const { poses = [] } = read("describe");
    plane = poses.length ? new Plane(poses) : null;
    setText(empty, plots.length ? "" : "Choose channels to draw: press the dots in the list of channels.");
    fill(area, ...parts().map((part) => part.element), plots.length ? null : empty);
    root.style.setProperty("--plots", String(plots.length + (plane === null ? 0 : 3)));
    for (const part of parts()) part.resize();
    redraw();
    refine();
  }

  function redraw() {
    if (isDue) return;
    isDue = true;
    requestAnimationFrame(draw);
  }

  function draw() {
    isDue = false;
    if (root.closest("[hidden]")) return; // another page is open; this one is measured again when it returns
    hasMore = false;
    const end = actions.now();
    const isWaiting = !Number.isFinite(end) && parts().length > 0;
    noData.hidden = !isWaiting;
    flag(area, "data-waiting", isWaiting);
    if (!Number.isFinite(end)) return;
    drawnTo = end;
    for (const plot of plots) plot.draw(end - view.span, end);
    plane?.draw(end - view.span, end, view.end ?? Math.max(end, rigNow() / 1e3 - LATE_S));
    root.dataset.drawn = String(Number(root.dataset.drawn ?? 0) + 1);
  }

  hold.addEventListener("click", toggleHold);
  watchFrames(() => {
    hasMore = true;
    const least = Math.min(view.span / (2 * Math.max(1, ...plots.map((plot) => plot.columns))), SLOWEST_S);
    if (view.end === null && Math.abs(newestTime() - drawnTo) >= least) redraw();
  });
  watchChosen(rebuild);
  watch("describe", rebuild);
  watch("status", () => {
    const { run } = read("status");
    setText(noData, `Nothing has been measured yet. Traces begin with ${run === null ? "the next" : "this"} run.`);
  });
  watch("link", () => root.classList.toggle("stale", known.link !== "ok"));
  new ResizeObserver(() => {
    for (const part of parts()) part.resize();
    redraw();
    refine();
  }).observe(area);
  setInterval(() => {
    toolbar();
    for (const plot of plots) plot.age(view.end !== null);
    // The past of a stream ends with that of another stream; bodies become lost without more data.
    if (view.end === null && (hasMore || plane !== null)) redraw();
  }, 1000);
  toolbar();
}
