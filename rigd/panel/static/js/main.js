// The panel's page: logs the user in, then builds every part and connects.

import { session } from "./api.js";
import { mountAttention } from "./attention.js";
import { mountCall } from "./call.js";
import { mountControl } from "./control.js";
import { guardPresses } from "./deliberate.js";
import { byId } from "./dom.js";
import { mountEvents } from "./events.js";
import { measureHead } from "./head.js";
import { connect } from "./link.js";
import { mountLive } from "./live.js";
import { mountLogin } from "./login.js";
import { mountLost } from "./lost.js";
import { mountProcedures } from "./procedures.js";
import { mountRuns } from "./runs.js";
import { mountState } from "./state.js";
import { mountStops } from "./stops.js";
import { put } from "./store.js";
import { mountTabs } from "./tabs.js";
import { mountUser } from "./user.js";

const login = byId("login");
const app = byId("app");

/** @param {Api.SessionView} me */
function enter(me) {
  put("me", me);
  guardPresses();
  login.hidden = true;
  app.hidden = false;
  document.body.dataset.role = me.role;
  mountState(byId("state"));
  mountStops(byId("stops"));
  mountLost(byId("lost"));
  measureHead(/** @type {HTMLElement} */ (app.querySelector(".head")));
  mountTabs(byId("tabs"));
  mountControl(byId("control"));
  mountCall(byId("user"));
  mountUser(byId("user"));
  mountAttention(byId("attention"));
  mountLive(byId("page-live"));
  mountProcedures(byId("page-procedures"));
  mountRuns(byId("page-runs"));
  mountEvents(byId("page-events"));
  connect();
}

// A page whose session has ended starts again from the login; it must not look live any longer.
window.addEventListener("sessionlost", () => !app.hidden && location.reload());

const code = location.hash.startsWith("#/") ? "" : location.hash.slice(1);
if (code) history.replaceState(null, "", location.pathname); // not in the history, not in a bookmark

const { session: me, rig } = await session();
if (me !== null) {
  enter(me);
} else {
  login.hidden = false;
  document.title = `${rig} – log in`;
  mountLogin(login, rig, code, enter);
}
