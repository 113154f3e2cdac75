"""Arbitrates the panel's control lease among its users.

To the daemon the panel is one client, so its lease is the panel's. Which of the panel's users may
use it is settled here: the one who took it, until it is released, handed over, or lost because no
page of theirs is open any more. In that last case the lease is not renewed and runs out, so that
the daemon does what the procedure says for a client that vanishes.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any, Final

from rigd.model.errors import RigdError
from rigd.panel.rig import Object, Rig
from rigd.panel.sessions import Session, Sessions
from rigd.remote.protocol.limits import RENEW_S
from rigd.remote.protocol.refusal import Code, Refusal

log = logging.getLogger(__name__)

#: How long a page may be away, while it is loaded anew, until its user counts as gone. Shorter than
#: the lease, which is not renewed meanwhile.
GRACE_S: Final = 4.0


class Seat:
    """The one place from which the rig is commanded through this panel.

    ``changed`` is called whenever who sits here, or who asks for it, has changed.
    """

    def __init__(self, rig: Rig, sessions: Sessions, changed: Callable[[], None]) -> None:
        self._rig = rig
        self._sessions = sessions
        self._changed = changed
        # A panel that takes over from one that died goes on with its user, if their page comes back
        # in time, and if the first status says that the lease is still the panel's.
        self._holder = sessions.in_control
        self._is_recalled = self._holder is not None
        self._asked_by: list[Session] = []
        self._has_failed = False  # to renew the lease, the last time
        self._changing = asyncio.Lock()  # held from looking who sits here until that has changed

    def describe(self, lease: Mapping[str, Any]) -> Object:
        """Return what the page shows of the daemon's ``lease``, with the panel's own users."""
        ours = lease["holder"] == self._rig.identity
        sitting = self._holder if ours else None
        return {
            "holder": lease["holder"],
            "ours": ours,
            "user": None if sitting is None else sitting.name,
            "session": None if sitting is None else sitting.number,
            "asked_by": list(lease["asked_by"]),
            "users_asking": [
                {"name": item.name, "session": item.number} for item in self._asking()
            ],
        }

    def heed(self, lease: Mapping[str, Any]) -> None:
        """Forget the user of the panel before this one if its lease has ended since."""
        was_recalled, self._is_recalled = self._is_recalled, False
        if was_recalled and lease["holder"] != self._rig.identity:
            self._sit(None)

    def require(self, session: Session) -> None:
        """Return if ``session`` has control.

        Raises:
            Refusal: it has not; says who has.
        """
        if self._holder is session:
            return
        if self._holder is not None:
            raise Refusal(
                Code.LEASE_HELD,
                f"{self._holder.name} has control at this panel",
                hint="ask for control, and wait until it is handed over",
            )
        raise Refusal(Code.NO_LEASE, "you do not have control", hint="take control first")

    async def take(self, session: Session) -> Object:
        """Take control for ``session``.

        Raises:
            Refusal: somebody has it.
        """
        async with self._changing:
            if self._holder is not None and not self._sessions.is_gone(self._holder, GRACE_S):
                self.require(session)
            answer = await self._rig.command("lease_take", {}, session.name)
            self._sit(session)
            return answer

    async def seize(self, session: Session) -> Object:
        """Take control from whoever has it, here or elsewhere.

        Raises:
            Refusal: the rig file does not make the panel a maintainer.
        """
        async with self._changing:
            answer = await self._rig.command("lease_seize", {}, session.name)
            self._sit(session)
            return answer

    async def release(self, session: Session) -> Object:
        """Give control back.

        Raises:
            Refusal: ``session`` does not have it.
        """
        async with self._changing:
            self.require(session)
            answer = await self._rig.command("lease_release", {}, session.name)
            self._sit(None)
            return answer

    async def ask(self, session: Session) -> Object:
        """Ask whoever has control to hand it over."""
        if self._holder is None:
            return await self._rig.command("lease_request", {}, session.name)
        if session is not self._holder and session not in self._asked_by:
            self._asked_by.append(session)
            self._changed()
        return {}

    async def give(self, session: Session, to: Mapping[str, Any]) -> Object:
        """Hand control over: to a ``session`` of this panel by its number, or to a ``client``.

        Raises:
            Refusal: ``session`` does not have it, or nobody like this has asked.
        """
        async with self._changing:
            self.require(session)
            match to:
                case {"session": int(number)}:
                    for item in self._asking():
                        if item.number == number:
                            self._sit(item)
                            return {}
                    raise Refusal(Code.NOT_FOUND, "that user is no longer at this panel")
                case {"client": str(client)}:
                    answer = await self._rig.command("lease_give", {"to": client}, session.name)
                    self._sit(None)
                    return answer
            raise Refusal(Code.BAD_REQUEST, "says neither `session` nor `client`")

    async def keep(self) -> None:
        """Renew the lease while its user is there, until cancelled."""
        while True:
            await asyncio.sleep(RENEW_S)
            async with self._changing:
                await self._renew()

    async def _renew(self) -> None:
        holder = self._holder
        if holder is None:
            return
        if self._sessions.is_gone(holder, GRACE_S):
            log.warning("%s has left without releasing control", holder.name)
            self._sit(None)
            return
        if holder.pages == 0:
            return  # being loaded anew, or gone: the lease lasts long enough to find out
        try:
            await self._rig.command("lease_renew", {}, holder.name)
        except Refusal as refusal:
            log.warning("control is lost: %s", refusal)
            self._sit(None)
        except RigdError as error:
            if not self._has_failed:
                log.warning("control could not be renewed: %s", error)
            self._has_failed = True
        else:
            self._has_failed = False

    def _asking(self) -> list[Session]:
        self._asked_by = [
            item for item in self._asked_by if not self._sessions.is_gone(item, GRACE_S)
        ]
        return self._asked_by

    def _sit(self, session: Session | None) -> None:
        self._holder, self._is_recalled = session, False
        self._sessions.give_control(session)
        self._asked_by = (
            [] if session is None else [item for item in self._asked_by if item is not session]
        )
        self._changed()
