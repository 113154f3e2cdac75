"""Renews the control lease (the right to command a rig) of a user who has a page open.

If a user has no page open, the lease is not renewed and expires. The daemon then does what the
procedure defines for the loss of a client. The user can load the page again before the lease
expires.
"""

from __future__ import annotations

import asyncio
import logging

from rigd.model.errors import RigdError
from rigd.panel.hub import Hub
from rigd.panel.rig import Rig
from rigd.panel.sessions import Sessions
from rigd.remote.protocol import Kind, LeaseView
from rigd.remote.protocol.limits import RENEW_S

log = logging.getLogger(__name__)


async def renew_lease(rig: Rig, hub: Hub, sessions: Sessions) -> None:
    """Renew the lease of each user of this panel that holds it, until cancelled."""
    has_failed = False
    while True:
        await asyncio.sleep(RENEW_S)
        holder = hub.lease_holder
        if (
            holder is None
            or holder.identity != rig.identity
            or not sessions.may_hold_lease(holder.user)
        ):
            continue
        try:
            await rig.request(Kind.COMMAND, "lease_renew", {}, LeaseView, holder.user)
        except RigdError as error:
            if not has_failed:
                log.warning("the lease of %s is not renewed: %s", holder.user, error)
            has_failed = True
        else:
            has_failed = False
