"""Serves the live streams in the protocol of the Foxglove app; clients can only read.

The server is that of the Foxglove SDK 0.30.3, protocol ``foxglove.sdk.v1``. This server does not
authenticate clients and accepts any ``Origin``. Every program that reaches the port can read the
streams, also a page in a browser of this machine. The server therefore listens on loopback only and
advertises no capability, so that clients can do nothing except read.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from rigd.config.rig import RigConfig
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.row_rates import most_rows_hz
from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.model.errors import ConfigError, LinkError
from rigd.model.machine.extras import require
from rigd.model.rows import TIME_FIELD
from rigd.record.events.event import CDR_HEADER, Event
from rigd.record.events.trial_series import TrialSeries
from rigd.record.mcap.schema import (
    TRIAL_SCHEMA,
    TRIAL_TOPIC,
    TRIAL_TYPE,
    channel_metadata,
    schema_text,
    type_names,
)

if TYPE_CHECKING:  # the extra rigd[foxglove]
    from foxglove import Channel

#: The default port of the Foxglove app.
DEFAULT_PORT: Final = 8765
#: Rows of one stream per second, at most; of a faster one, some are left out.
MOST_HZ: Final = 1000.0
#: So many messages wait for a slow client, about a second of eight streams; of more, the oldest
#: are dropped.
BACKLOG: Final = 8192
#: How long clients may take to disconnect at the end, in s.
STOP_S: Final = 1.0
_HOST: Final = "127.0.0.1"
_LAST_PORT: Final = 65535
#: The time at the beginning of a row (:func:`rigd.model.rows.row_dtype`).
_TIME_BYTES: Final = 8


class FoxgloveServer:
    """Serves the streams of a rig as topics named and laid out like those of a recording."""

    def __init__(self, rig: RigConfig, port: int = DEFAULT_PORT) -> None:
        """Listen on ``port`` of this machine, 0 for any that is free.

        Raises:
            MissingExtra: the Foxglove SDK is not installed.
            ConfigError: there is no such port.
            LinkError: the port is taken.
        """
        if not 0 <= port <= _LAST_PORT:
            raise ConfigError(f"--foxglove {port}: a port is a number from 0 to {_LAST_PORT}")
        require("foxglove", "rigd serve --foxglove")
        import foxglove

        self._context = context = foxglove.Context()  # a channel does not keep it alive
        try:
            self._server = foxglove.start_server(
                name=f"rigd {rig.name}",
                host=_HOST,
                port=port,
                capabilities=[],
                context=context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise LinkError(
                f"cannot serve Foxglove on {_HOST}:{port}: {error}",
                hint="--foxglove PORT takes another port",
            ) from error
        self.address = f"ws://{_HOST}:{self._server.port}"
        self._rig = rig
        streams = streams_of(rig)
        self._topics = {
            stream.name: self._topic(stream, name)
            for stream, name in zip(streams, type_names(streams), strict=True)
        }
        self._series = TrialSeries()
        self._trial: Channel | None = None
        if TRIAL_TOPIC not in (f"/{name}" for name in self._topics):  # as in a recording
            self._trial = self._channel(TRIAL_TOPIC, TRIAL_TYPE, TRIAL_SCHEMA, {})

    def show(self, stream: Stream, rows: Rows) -> None:
        """Send rows to the viewers of their stream; a slow viewer misses some.

        A stream that only this run has becomes a topic with its first rows, in place of that of
        another run with this name.
        """
        topic = self._topics.get(stream.name)
        if topic is None or topic.stream != stream:
            if topic is not None:
                topic.channel.close()
            (name,) = type_names([stream])
            topic = self._topics[stream.name] = self._topic(stream, name)
        topic.send(rows)

    def happened(self, event: Event) -> None:
        """Send which trial and step it is, if an event of a run changes it."""
        mark = self._series.follow(event)
        if mark is not None and self._trial is not None:
            self._trial.log(mark.payload(), log_time=event.t_ns)

    def _channel(self, topic: str, name: str, text: str, metadata: Mapping[str, str]) -> Channel:
        import foxglove

        return foxglove.Channel(
            topic,
            schema=foxglove.Schema(name=name, encoding="ros2msg", data=text.encode()),
            message_encoding="cdr",
            metadata=dict(metadata),
            context=self._context,
        )

    def _topic(self, stream: Stream, type_name: str) -> _Topic:
        channel = self._channel(
            f"/{stream.name}", type_name, schema_text(stream), channel_metadata(stream)
        )
        return _Topic(stream, channel, math.ceil(most_rows_hz(self._rig, stream) / MOST_HZ))

    def stop(self) -> None:
        """Disconnect all clients and free the port."""
        # In a thread: the server waits without limit for a client that reads nothing.
        ending = threading.Thread(target=self._server.stop, name="foxglove end", daemon=True)
        ending.start()
        ending.join(STOP_S)


class _Topic:
    """Sends every ``every``-th row of a stream."""

    def __init__(self, stream: Stream, channel: Channel, every: int) -> None:
        self.stream = stream
        self.channel = channel
        self._every = every
        self._left_out = 0  #: rows to leave out before the next

    def send(self, rows: Rows) -> None:
        if not self.channel.has_sinks():
            return
        chosen = rows[self._left_out :: self._every]
        self._left_out = (self._left_out - len(rows)) % self._every
        # After its time, a row already has the form of CDR: float64s in order, then the uint32.
        size, payload = chosen.itemsize, chosen.tobytes()
        for number, t_ns in enumerate(chosen[TIME_FIELD].tolist()):
            body = payload[number * size + _TIME_BYTES : (number + 1) * size]
            self.channel.log(CDR_HEADER + body, log_time=t_ns)
