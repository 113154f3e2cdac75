// Renews the calibration file of the rig from a run: shows new values beside old, and asks before it writes.

import { command } from "./api.js";
import { openDialog } from "./dialog.js";
import { el, file } from "./dom.js";
import { attempt, toast } from "./toasts.js";

/** @param {string} run */
export function calibrateButton(run) {
  /** @type {HTMLButtonElement} */
  const made = el("button", {
    type: "button",
    onclick: async () => {
      const found = await attempt(made, () => command("calibrate", { run, days: 365, write: false }));
      if (found !== null) confirm(run, found);
    },
  }, "Calibrate…");
  return made;
}

/**
 * @param {string} run
 * @param {Api.RenewedCalibration} found
 */
function confirm(run, found) {
  openDialog("Renew the calibration?", (close) => {
    const days = el("input", { id: "calibration-days", type: "number", min: "1", max: "36500", step: "1", value: "365", required: true });
    /** @type {HTMLButtonElement} */
    const write = el("button", {
      type: "button", class: "primary big",
      onclick: async () => {
        if (!days.reportValidity()) return;
        const renewed = await attempt(write, () => command("calibrate", { run, days: days.valueAsNumber, write: true }));
        if (renewed === null) return;
        close();
        toast(`${renewed.file} is renewed; its new values may be used until ${renewed.valid_until}.`);
      },
    }, "Write it");
    return [
      el("h2", {}, "Renew the calibration?"),
      el("p", {}, "The file ", file(found.file), " gets the new values (± u, the standard uncertainty); the old ones move to its history. Runs that start from now on use it."),
      found.remarks.map((remark) => el("p", { class: "problem" }, remark)),
      el("dl", { class: "facts" }, found.values.map(line), el("dt", {}, "Responsible"), el("dd", {}, found.operator), el("dt", {}, "Recording"), el("dd", {}, file(run))),
      el("div", { class: "fields" }, el("label", { for: days.id }, "Valid for, in days"), days),
      el("div", { class: "row end" }, el("button", { type: "button", onclick: close }, "Cancel"), write),
    ];
  });
}

/** @param {Api.RenewedValue} value */
function line({ name, unit, new: now, old, deviation }) {
  const was = old ? `before: ${old}${deviation === null ? "" : `, ${deviation.toFixed(1).replace("-", "−")} u away`}` : "new";
  return [el("dt", {}, el("code", {}, name)), el("dd", {}, el("strong", {}, now), unit === "1" ? "" : ` ${unit}`, el("br"), el("span", { class: "quiet" }, was))];
}
