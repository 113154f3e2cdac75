// What the page knows, and who wants to hear when it changes.

const listeners = new Map();

/** The newest of everything; read it anywhere, change it by `put` only. */
export const known = {
  me: null, // this session: name, role, session number, identity of the panel
  describe: null,
  status: null,
  latest: null,
  panel: null,
  link: "connecting", // connecting, ok, no_panel or no_rig
};

export function put(key, value) {
  known[key] = value;
  for (const listener of listeners.get(key) ?? []) listener(value);
}

/** Call `listener` now, if there is something, and whenever one of `keys` changes. */
export function watch(keys, listener) {
  for (const key of [keys].flat()) {
    if (!listeners.has(key)) listeners.set(key, new Set());
    listeners.get(key).add(listener);
  }
  if ([keys].flat().every((key) => known[key] !== null)) listener();
}

/** Whether this page may command now. */
export function hasControl() {
  const control = known.status?.control;
  return known.link === "ok" && control?.ours === true && control.session === known.me.session;
}

/** Whether this page's user may ever command: the rig file may let the panel itself only watch. */
export const isOperator = () => known.me?.role === "operator" && known.describe?.role !== "observer";

/** Whether the rig file lets this panel act on devices and take control from others. */
export const isMaintainer = () => isOperator() && known.describe?.role === "maintainer";

/** The rig's clock in ms since the epoch, which need not be this computer's. */
let offset = 0;
export function setClock(rigNanoseconds) {
  const seen = rigNanoseconds / 1e6 - Date.now();
  // A message is late by its way here: the offset follows the quickest, and drifts back slowly.
  offset = Math.abs(seen - offset) > 2000 ? seen : Math.max(seen, offset - 1);
}
export const rigNow = () => Date.now() + offset;
