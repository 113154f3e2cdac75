// The data of the page, and the listeners to their changes.

/**
 * @typedef {"connecting" | "ok" | "no_panel" | "no_rig"} Link
 * @typedef {object} Known
 * @property {Api.SessionView | null} me this session
 * @property {Api.PageDescription | null} describe
 * @property {Api.PageStatus | null} status
 * @property {Api.LatestValues | null} latest
 * @property {Api.RigLink | null} panel
 * @property {Link} link
 */

/** @type {Map<keyof Known, Set<() => void>>} */
const listeners = new Map();

/**
 * The newest data; read them anywhere, change them by `put` only.
 * @type {Known}
 */
export const known = {
  me: null,
  describe: null,
  status: null,
  latest: null,
  panel: null,
  link: "connecting",
};

/**
 * @template {keyof Known} K
 * @param {K} key
 * @param {Known[K]} value
 */
export function put(key, value) {
  known[key] = value;
  for (const listener of listeners.get(key) ?? []) listener();
}

/**
 * The newest value of `key`, for code that runs only after the first value.
 * @template {keyof Known} K
 * @param {K} key
 * @returns {NonNullable<Known[K]>}
 */
export function read(key) {
  const value = known[key];
  if (value === null) throw new Error(`${key} has no value yet`);
  return /** @type {NonNullable<Known[K]>} */ (value);
}

/**
 * Call `listener` now if there are data, and whenever a value of `keys` changes.
 * @param {keyof Known | (keyof Known)[]} keys
 * @param {() => void} listener
 */
export function watch(keys, listener) {
  for (const key of [keys].flat()) {
    const others = listeners.get(key) ?? new Set();
    listeners.set(key, others.add(listener));
  }
  if ([keys].flat().every((key) => known[key] !== null)) listener();
}

/** Whether this page may command now. */
export function hasControl() {
  const holder = known.status?.lease.holder ?? null;
  return known.link === "ok" && holder !== null && holder?.identity === known.me?.identity && holder?.user === known.me?.name;
}

/**
 * The name of a client or user; for users of this panel without the client.
 * @param {Api.ClientUser} requester
 */
export const nameOf = ({ identity, user }) => {
  if (user === "") return identity;
  return identity === known.me?.identity ? user : `${user} (${identity})`;
};

/** Whether this page's user may command at all: the rig file may allow the panel only to watch. */
export const isOperator = () => known.me?.role === "operator" && known.describe?.role !== "observer";

/** Whether the rig file lets this panel act on devices and take control from others. */
export const isMaintainer = () => isOperator() && known.describe?.role === "maintainer";

/** The clock of the rig's live data minus this computer's, in ms. */
let offset = 0;
/** @param {number} rigNanoseconds */
export function setClock(rigNanoseconds) {
  const seen = rigNanoseconds / 1e6 - Date.now();
  // Every message is delayed by the network: the offset follows the fastest message, and returns slowly.
  offset = Math.abs(seen - offset) > 2000 ? seen : Math.max(seen, offset - 1);
}
/** The clock of the rig's live data in ms since the epoch. */
export const rigNow = () => Date.now() + offset;
