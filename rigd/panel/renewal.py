"""Renews the control lease (the right to command a rig) of a user who has a page open.

If a user has no page open, the lease is not renewed and expires. The daemon then does what the
procedure defines for the loss of a client. The user can load the page again before the lease
expires.
"""

from __future__ import annotations

import logging

from rigd.model.errors import RigdError
from rigd.panel.hub import Hub
from rigd.panel.login.sessions import Sessions
from rigd.panel.rig import Rig
from rigd.remote.client.lease.renewing import renew_until_lost
from rigd.remote.protocol import Kind, LeaseView

log = logging.getLogger(__name__)


async def renew_lease(rig: Rig, hub: Hub, sessions: Sessions) -> None:
    """Renew the lease of each user of this panel that holds it, until cancelled."""

    async def renew() -> None:
        holder = hub.lease_holder
        if (
            holder is not None
            and holder.identity == rig.identity
            and sessions.may_hold_lease(holder.user)
        ):
            await rig.request(Kind.COMMAND, "lease_renew", {}, LeaseView, holder.user)

    def failed(error: RigdError) -> None:
        log.warning("the lease is not renewed: %s", error)

    while True:  # another user may take it
        failed(await renew_until_lost(renew, failed))
