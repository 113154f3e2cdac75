// Requests to the panel.

export class Refused extends Error {
  constructor({ code, message, hint }) {
    super(message);
    this.code = code;
    this.hint = hint ?? "";
  }
}

export const UNREACHABLE = {
  code: "unreachable",
  message: "The panel does not answer.",
  hint: "Is its process running, and is this computer on the network?",
};

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
  let told;
  try {
    told = await answer.json();
  } catch {
    throw new Refused({ ...UNREACHABLE, message: `The panel answered with status ${answer.status}.` });
  }
  if (answer.ok) return told;
  if (answer.status === 401) window.dispatchEvent(new Event("sessionlost"));
  throw new Refused(told.error);
}

export const session = () => request("GET", "/api/session", null, 8000);
/** Whether the panel answers at all. */
export const reach = () => request("GET", "/api/session", null, 2000).then(() => true, () => false);
export const login = (code, name) => request("POST", "/api/login", { code, name }, 8000);
export const logout = () => request("POST", "/api/logout", {}, 8000);
export const invite = (role) => request("POST", "/api/invite", { role }, 8000);
export const ask = (what, args = {}) => request("POST", `/api/ask/${what}`, { args }, 40_000);
/** A dry run and a report take as long as they take. */
export const command = (verb, args = {}) => request("POST", `/api/command/${verb}`, { args }, 920_000);
export const control = (verb, args = {}) => request("POST", `/api/control/${verb}`, { args }, 8000);
export const postStop = (verb) => request("POST", `/api/stop/${verb}`, {}, 6000);
