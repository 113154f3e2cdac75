"""Defines the limits of the protocol for both ends: sizes, depths, rates and ages."""

from __future__ import annotations

from typing import Final

#: Version of the protocol, in every message as ``v``. Any change of a message raises it.
VERSION: Final = 1

#: Bytes of a request: ten times the longest shipped procedure, which `start` contains.
MAX_REQUEST_BYTES: Final = 64 * 1024
#: Bytes of a reply, a publication or a frame; a piece of a file in base64 takes a third of it.
MAX_MESSAGE_BYTES: Final = 1024 * 1024
#: Bytes of a file that one piece of a transfer may hold.
MAX_PIECE_BYTES: Final = 256 * 1024
#: Recordings that one request may compare.
MAX_COMPARED: Final = 20
#: How deep objects and lists may nest; the deepest message needs 6.
MAX_DEPTH: Final = 16
#: Characters of a name in a key: of a rig, a stream, an identity or a verb.
MAX_NAME: Final = 64
#: Characters of the name of a client's user.
MAX_USER: Final = 64
#: Characters of a text for a person, of one or several lines.
MAX_TEXT: Final = 4000
#: Characters of the reason of a stop.
MAX_REASON: Final = 300
#: Points and channels of a frame.
MAX_FRAME_POINTS: Final = 4096
MAX_FRAME_CHANNELS: Final = 256

#: Status is published at every change, and at least this often: the heartbeat of the application.
HEARTBEAT_S: Final = 0.5
#: Frames of one stream per second, at most.
LIVE_HZ: Final = 30.0

#: Questions of one client that are answered: so many at once, and per second in the long run. A
#: page asks 25 when it opens, and one per second then; a question costs a daemon 0.5 ms.
ASK_BURST: Final = 400.0
ASK_PER_S: Final = 100.0

#: How long the control lease holds without being renewed, and how often its holder renews it: four
#: requests in a row may be lost, or wait on a busy computer.
LEASE_S: Final = 6.0
RENEW_S: Final = 1.0

#: A command sent longer ago than this, or as much in the future, is refused as replayed.
FRESH_S: Final = 30.0
