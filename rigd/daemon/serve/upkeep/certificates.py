"""Says days ahead which certificates expire: the daemon's own, its authority's, those of clients.

A certificate that expires keeps new clients out; connected ones go on, but for a client whose own
has expired: its connection is cut.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, date, datetime, timedelta
from typing import Final, Literal

from rigd.config.remote import RemoteSetup
from rigd.daemon.serve.upkeep.notices import Level
from rigd.model.errors import ConfigError
from rigd.remote.certificates import RENEW, SOON, end_of
from rigd.remote.protocol.status import CertificateView

#: How often files are looked at, besides the moment at which a certificate expires.
_LOOK: Final = timedelta(hours=1)
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_ALWAYS: Final = datetime.min.replace(tzinfo=UTC)


def _now() -> datetime:
    return datetime.now(UTC)


class CertificateWatch:
    """Looks at certificates each hour, and tells ``note`` once a day of those that expire soon.

    Of clients it knows what their requests say. :meth:`tend` is called by one thread.
    """

    def __init__(
        self,
        setup: RemoteSetup,
        note: Callable[[str, Level], None],
        clock: Callable[[], datetime] = _now,
    ) -> None:
        self._files, self._roles = setup.tls, setup.roles
        self._note, self._clock = note, clock
        self._clients: dict[str, datetime] = {}
        self._next = _ALWAYS
        self._noted: dict[tuple[str, datetime], tuple[date, bool]] = {}
        self._soon: tuple[CertificateView, ...] = ()

    def seen(self, client: str, until_ns: int) -> None:
        """Note what a client says of its own certificate; 0: nothing. Any thread may call it."""
        if self._files is None or not until_ns or client not in self._roles:
            return
        until = _EPOCH + timedelta(seconds=until_ns // 10**9)
        if self._clients.get(client) != until:
            self._clients[client] = until
            self._next = _ALWAYS

    def expired(self, client: str) -> str:
        """Return that the certificate of a client has expired, in words; "" if not."""
        until = self._clients.get(client)
        if until is None or until > self._clock():
            return ""
        return f"its certificate expired on {until:%Y-%m-%d}"

    def views(self) -> tuple[CertificateView, ...]:
        """Return those that expire soon, or have expired, the first to expire first."""
        return self._soon

    def tend(self) -> None:
        """Look, if it is time to."""
        now = self._clock()
        if self._files is None or now < self._next:
            return
        self._next = now + _LOOK
        soon = []
        for whose, name, until in sorted(self._all(), key=lambda item: item[2]):
            if until > now:
                self._next = min(self._next, until)
            if until - now > SOON:
                continue
            end_ns = round((until - _EPOCH).total_seconds()) * 10**9
            soon.append(CertificateView(whose=whose, name=name, until_ns=end_ns))
            told = now.date(), until <= now
            if self._noted.get((name, until)) != told:
                self._noted[name, until] = told
                self._tell(whose, name, until, now)
        self._soon = tuple(soon)

    def _all(self) -> Iterator[tuple[Literal["daemon", "authority", "client"], str, datetime]]:
        if self._files is None:
            return
        try:
            yield "daemon", self._files.certificate.name, end_of(self._files.certificate)
            yield "authority", self._files.ca.name, end_of(self._files.ca)
        except ConfigError as error:
            self._note(error.message, "error")
        clients: Mapping[str, datetime] = dict(self._clients)
        for client, until in clients.items():
            yield "client", client, until

    def _tell(self, whose: str, name: str, until: datetime, now: datetime) -> None:
        what = f"the certificate of {name}" if whose == "client" else f"the {whose}'s {name}"
        effect = f"{name} cannot" if whose == "client" else "no client can"
        if until <= now:
            text = f"{what} expired on {until:%Y-%m-%d}: {effect} connect any more"
            self._note(f"{text}; {RENEW}", "error")
            return
        days = (until - now).days
        text = f"{what} expires on {until:%Y-%m-%d}, in {days} days: {effect} connect from then on"
        self._note(f"{text}; {RENEW}", "warning")
