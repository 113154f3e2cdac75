// The panel's page: lets a person in, then builds every part and connects.

import { session } from "./api.js";
import { mountAttention } from "./attention.js";
import { mountCall } from "./call.js";
import { mountControl } from "./control.js";
import { guardPresses } from "./deliberate.js";
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

const login = document.getElementById("login");
const app = document.getElementById("app");

function enter(me) {
  put("me", me);
  guardPresses();
  login.hidden = true;
  app.hidden = false;
  document.body.dataset.role = me.role;
  mountState(document.getElementById("state"));
  mountStops(document.getElementById("stops"));
  mountLost(document.getElementById("lost"));
  measureHead(app.querySelector(".head"));
  mountTabs(document.getElementById("tabs"));
  mountControl(document.getElementById("control"));
  mountCall(document.getElementById("user"));
  mountUser(document.getElementById("user"));
  mountAttention(document.getElementById("attention"));
  mountLive(document.getElementById("page-live"));
  mountProcedures(document.getElementById("page-procedures"));
  mountRuns(document.getElementById("page-runs"));
  mountEvents(document.getElementById("page-events"));
  connect();
}

// A page whose session has ended starts again from the login; it must not go on looking alive.
window.addEventListener("sessionlost", () => !app.hidden && location.reload());

const code = location.hash.startsWith("#/") ? "" : location.hash.slice(1);
if (code) history.replaceState(null, "", location.pathname); // not in the history, not in a bookmark

const { session: me } = await session();
if (me !== null) {
  enter(me);
} else {
  login.hidden = false;
  mountLogin(login, code, enter);
}
