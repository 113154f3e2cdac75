// Requests to the panel.

/** A request that was not carried out. */
export class Refused extends Error {
  /** @param {Pick<Api.RequestError, "code" | "message"> & { hint?: string | null }} error */
  constructor({ code, message, hint }) {
    super(message);
    this.code = code;
    this.hint = hint ?? "";
  }
}

export const UNREACHABLE = {
  code: "unreachable",
  message: "The panel does not answer.",
  hint: "Check that its process runs, and that this computer is on the network.",
};

/**
 * The error of a request; any other error is thrown again.
 * @param {unknown} error
 */
export function asRefused(error) {
  if (error instanceof Refused) return error;
  throw error;
}

/**
 * @param {"GET" | "POST"} method
 * @param {string} path
 * @param {unknown} body
 * @param {number} timeoutMs
 */
async function request(method, path, body, timeoutMs) {
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: method === "GET" ? {} : { "content-type": "application/json", "x-rigd": "1" },
      body: method === "GET" ? undefined : JSON.stringify(body),
      signal: AbortSignal.timeout(timeoutMs),
      cache: "no-store",
      credentials: "same-origin",
    });
  } catch {
    throw new Refused(UNREACHABLE);
  }
  let reply;
  try {
    reply = await answer.json();
  } catch {
    throw new Refused({ ...UNREACHABLE, message: `The panel answered with status ${answer.status}.` });
  }
  if (answer.ok) return reply;
  if (answer.status === 401) window.dispatchEvent(new Event("sessionlost"));
  throw new Refused(reply.error);
}

/** @returns {Promise<Api.SessionReply>} */
export const session = () => request("GET", "/api/session", null, 8000);
/** Whether the panel answers at all. */
export const reach = () => request("GET", "/api/session", null, 2000).then(() => true, () => false);
/**
 * @param {string} code
 * @param {string} name
 * @returns {Promise<Api.SessionReply>}
 */
export const login = (code, name) => request("POST", "/api/login", { code, name }, 8000);
export const logout = () => request("POST", "/api/logout", {}, 8000);
/**
 * @param {Api.SessionView["role"]} role
 * @returns {Promise<Api.Invitation>}
 */
export const invite = (role) => request("POST", "/api/invite", { role }, 8000);
/**
 * @template {keyof Api.Asks} W
 * @param {W} question
 * @param {Api.Asks[W]["args"]} args
 * @returns {Promise<Api.Asks[W]["result"]>}
 */
export const ask = (question, args) => request("POST", `/api/ask/${question}`, { args }, 40_000);
/**
 * The frames of a time, in s since the epoch: at most `points` of each stream. Empty if there are none.
 * @param {number} start
 * @param {number} end
 * @param {number} points
 */
export async function past(start, end, points) {
  const wanted = new URLSearchParams({ from_s: String(start), to_s: String(end), points: String(points) });
  try {
    const answer = await fetch(`/api/past?${wanted}`, { signal: AbortSignal.timeout(8000), cache: "no-store", credentials: "same-origin" });
    if (answer.ok) return await answer.arrayBuffer();
  } catch { /* the traces stay as they are */ }
  return new ArrayBuffer(0);
}
/**
 * Let the daemon compare runs, which may take minutes; the page is then at `/api/comparison`.
 * @param {string[]} runs
 * @returns {Promise<Api.PieceView>}
 */
export const compare = (runs) => request("POST", "/api/ask/compare", { args: { runs, offset: 0, length: 1 } }, 920_000);
/**
 * Without a time limit: a dry run or a report may take long.
 * @template {keyof Api.Commands} V
 * @param {V} verb
 * @param {Api.Commands[V]["args"]} args
 * @returns {Promise<Api.Commands[V]["result"]>}
 */
export const command = (verb, args) => request("POST", `/api/command/${verb}`, { args }, 920_000);
/**
 * @param {import("./stops.js").Stop} verb
 * @returns {Promise<Api.Stopped>}
 */
export const postStop = (verb) => request("POST", `/api/stop/${verb}`, {}, 6000);
