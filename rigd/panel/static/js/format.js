// Numbers, times and states as people read them.

const NO_VALUE = "–";

/** @type {Record<string, string>} */
const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
/** @param {number} exponent */
const power = (exponent) => `10${[...String(exponent)].map((item) => RAISED[item]).join("")}`;

/**
 * A constant number, such as a limit: only the digits that it has, `digits` at most.
 * @param {number | null | undefined} value
 */
export function short(value, digits = 5) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NO_VALUE;
  const rounded = Number(value.toPrecision(digits));
  const size = Math.abs(rounded);
  if (size === 0 || (size >= 1e-3 && size < 1e6)) return String(rounded).replace("-", "−");
  const exponent = Math.floor(Math.log10(size));
  return `${Number((rounded / 10 ** exponent).toPrecision(digits))}·${power(exponent)}`.replace("-", "−");
}

/** @type {Record<number, string>} */
const PREFIXES = { "-3": "m", "-6": "µ", "-9": "n" };

/**
 * How to show a channel that stays below `limit`: the factor from SI to the shown value, and its unit.
 * @param {number} limit
 * @param {string} symbol
 */
export function scaled(limit, symbol) {
  const exponent = limit > 0 && limit < 1e-2 ? Math.max(-9, 3 * Math.floor(Math.log10(limit) / 3)) : 0;
  if (exponent === 0) return { factor: 1, unit: unit(symbol) };
  const takesPrefix = /^(m|s|A|V|N|rad|Pa|W)(?![A-Za-z^])/.test(symbol);
  return {
    factor: 10 ** exponent,
    unit: takesPrefix ? PREFIXES[exponent] + unit(symbol) : `${power(exponent)} ${unit(symbol)}`.trim(),
  };
}

/**
 * A value for a column that is read while it changes: always as many decimals as the range needs. If that
 * is more than the column can show, a value of the range is still not shown as 0.
 * @param {number | null | undefined} value
 * @param {number} scale
 */
export function steady(value, scale) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NO_VALUE;
  if (Math.abs(value) >= 1e6) return short(value, 3);
  const most = scale < 5e-3 ? 6 : 4; // so that it fits into its column
  const decimals = Math.max(0, Math.min(most, 3 - Math.floor(Math.log10(scale || 1))));
  const text = value.toFixed(decimals);
  if (Number(text) !== 0) return text.replace("-", "−");
  return Math.abs(value) > scale / 1000 ? short(value, 3) : text.replace("-", "");
}

/** @param {string} symbol */
export function unit(symbol) {
  return symbol === "1" ? "" : symbol.replaceAll("^2", "²").replaceAll("^3", "³").replaceAll(" ", "·");
}

/**
 * A constant value with its unit, without a line break between them.
 * @param {number} value
 * @param {string} symbol
 */
export function quantity(value, symbol) {
  return `${short(value)}\u202f${unit(symbol)}`.trim();
}

/**
 * An SI value as a number in a unit.
 * @param {number} value
 * @param {Api.UnitScale} scale
 */
export const inUnit = (value, { factor, offset } = { factor: 1, offset: 0 }) =>
  offset === 0 ? value / factor : Number(((value - offset) / factor).toFixed(9));

/**
 * Parameters of a trial, which arrive in SI, each as a name and a text for people.
 * @param {{ parameters: Record<string, number | string | boolean>, units?: Record<string, string>, scales?: Record<string, Api.UnitScale> }} trial
 */
export function parameters({ parameters: values, units = {}, scales = {} }) {
  return Object.entries(values).map(([name, value]) => [
    name,
    typeof value === "number" ? quantity(inUnit(value, scales[name]), units[name] ?? "1") : String(value),
  ]);
}

/**
 * The text, with its quantities written as by `quantity`.
 * @param {string} text
 */
export function quantities(text) {
  return text.replace(/(^|[\s(=])-(?=[\d.])/g, "$1−")
    .replace(/(\d) ([A-Za-z%°µΩ][\w/^·*]*)(?=$|[\s,;)])/g, (_, digit, symbol) => `${digit}\u202f${unit(symbol)}`);
}

/**
 * An age in one unit, as narrow as its column: `3 min`.
 * @param {number | null} seconds
 */
export function age(seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return NO_VALUE;
  if (seconds < 9.95) return `${Math.max(0, seconds).toFixed(1)} s`;
  if (seconds < 60) return `${Math.round(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min`;
  return seconds < 48 * 3600 ? `${Math.floor(seconds / 3600)} h` : `${Math.floor(seconds / 86_400)} d`;
}

/** @param {number | null | undefined} seconds */
export function duration(seconds) {
  if (seconds === null || seconds === undefined) return NO_VALUE;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  const minutes = Math.floor(whole / 60);
  if (minutes < 60) return `${minutes} min ${String(whole % 60).padStart(2, "0")} s`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

/**
 * An age, for people.
 * @param {number} seconds
 */
export const ago = (seconds) => `${seconds < 48 * 3600 ? duration(seconds) : `${Math.round(seconds / 86_400)} days`} ago`;

const TIME = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", second: "2-digit" });
const DAY = new Intl.DateTimeFormat("en-GB", {
  day: "2-digit", month: "short", hour: "2-digit", minute: "2-digit",
});

const DATE = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "long", year: "numeric", hour: "2-digit", minute: "2-digit" });

/** @param {number} milliseconds */
export const date = (milliseconds) => DATE.format(milliseconds);
/** @param {number} milliseconds */
export const clock = (milliseconds) => TIME.format(milliseconds);
/** @param {number} milliseconds */
export const day = (milliseconds) => DAY.format(milliseconds);

/** @param {number} size */
export function bytes(size) {
  if (size < 1e3) return `${size} B`;
  if (size < 1e6) return `${(size / 1e3).toFixed(0)} kB`;
  return size < 1e9 ? `${(size / 1e6).toFixed(1)} MB` : `${(size / 1e9).toFixed(2)} GB`;
}

/**
 * The name of a state, its meaning, and its mood: calm, busy, ask, warn or bad.
 * @type {Record<Api.PageStatus["state"], [string, string, string]>}
 */
export const STATES = {
  idle: ["Idle", "Nothing is running", "calm"],
  preflight: ["Preflight", "Devices are being checked, nothing moves", "busy"],
  blocked: ["Blocked", "Preflight refused, nothing moved", "warn"],
  armed: ["Armed", "Actuators are enabled", "busy"],
  running: ["Running", "", "busy"],
  pausing: ["Pausing", "At the next step that can be held, or after this trial", "warn"],
  held: ["Held", "The step waits, its time stands still", "ask"],
  paused: ["Paused", "Setpoints are at rest", "ask"],
  stopping: ["Stopping", "The rig comes to rest", "warn"],
  finishing: ["Finishing", "The procedure's finish plays", "busy"],
  aborting: ["Aborting", "Setpoints go to rest now", "bad"],
  faulted: ["Faulted", "A device or an interlock ended the run", "bad"],
  estopped: ["E-stopped", "Devices were requested to drop power", "bad"],
  done: ["Done", "The rig is safe, the recording is finished", "calm"],
};

export const ACTIONS = {
  warn: "warned",
  end_trial: "ended the trial",
  stop: "stopped the run",
  abort: "aborted the run",
  estop: "requested the drop of power",
};

/** Names an option or a command of the terminal, or what only the file of a procedure has. */
const TERMINAL = /(^|[\s(`])--[a-z]|\brigd [a-z]|\$\{|'parameters'/;

/**
 * The text without what this page has no place for: commands of the terminal and their options.
 * @param {string} text
 */
export const withoutCommands = (text) => text
  .replace(/\s*\([^()]*\)/g, (part) => (TERMINAL.test(part) ? "" : part))
  .split(/(?<=[;.,])\s+(?!e\.g\.)/)
  .filter((part) => !TERMINAL.test(part))
  .join(" ")
  .replace(/[;,]$/, "");

/**
 * The refusal, and its remedy, if it is one for this page.
 * @param {{ message: string, hint?: string | null }} refused
 */
export const withHint = ({ message, hint }) => [message, withoutCommands(hint ?? "")].filter(Boolean).join(" – ");

/**
 * A typed number with a decimal point: a single comma is a decimal comma; several are ambiguous.
 * @param {string} text
 */
export const decimalPoint = (text) => text.trim().replace("−", "-").replace(/^([-+]?\d*),(\d[^.,]*)$/, "$1.$2");

/**
 * `constant_current` as words.
 * @param {string} name
 */
export const words = (name) => name.replaceAll("_", " ");
