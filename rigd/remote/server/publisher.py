"""Publishes status, events and live data; a slow or frozen client never delays the publication."""

from __future__ import annotations

import threading

import zenoh

from rigd.remote.protocol import Keys, RigEvent, Status, encode


class RigPublisher:
    """Publishes on the keys of one rig; any thread may publish.

    Messages are dropped rather than delayed. The next status follows within half a second. A gap in
    the numbers of events or frames shows a loss; a client can request lost events.
    """

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self._session = session
        self._keys = keys
        self._lock = threading.Lock()
        self._status = _declare(session, keys.status, zenoh.Priority.INTERACTIVE_HIGH)
        self._event = _declare(session, keys.event, zenoh.Priority.DATA_HIGH)
        self._live: dict[str, zenoh.Publisher] = {}
        self._newest_status = b""

    @property
    def newest_status(self) -> bytes:
        """The status published last, as bytes; empty before the first."""
        return self._newest_status

    def status(self, status: Status) -> None:
        """Publish the state of everything; :meth:`Server.publish_status` keeps the newest last."""
        self._newest_status = encode(status)
        self._status.put(self._newest_status)

    def event(self, event: RigEvent) -> None:
        """Publish an event."""
        self._event.put(encode(event))

    def frame(self, stream: str, frame: bytes) -> None:
        """Publish live data of a stream (:func:`rigd.remote.protocol.encode_frame`)."""
        with self._lock:
            live = self._live.get(stream)
            if live is None:
                key = self._keys.live(stream)
                live = self._live[stream] = _declare(self._session, key, zenoh.Priority.DATA_LOW)
        live.put(frame)


def _declare(session: zenoh.Session, key: str, priority: zenoh.Priority) -> zenoh.Publisher:
    return session.declare_publisher(
        key, congestion_control=zenoh.CongestionControl.DROP, priority=priority
    )
