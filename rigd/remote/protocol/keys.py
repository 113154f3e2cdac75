"""Builds and parses the zenoh keys (addresses of messages) of a rig.

Every key begins with ``rigd/<rig>/``. The rest is:

- liveliness: ``alive``;
- publications: ``status``, ``event`` and ``live/<stream>``;
- queryables: ``ask/<identity>/<what>``, ``cmd/<identity>/<verb>`` and ``stop/<identity>/<verb>``.

The identity of the client is part of the key because the access-control rules of zenoh check keys,
not payloads.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from typing import Final

from rigd.remote.protocol.limits import MAX_NAME
from rigd.remote.protocol.refusal import Code, Refusal

#: The first part of every key.
ROOT: Final = "rigd"
#: The keys of the liveliness tokens of all rigs.
EVERY_ALIVE: Final = f"{ROOT}/*/alive"

_NAME: Final = re.compile(rf"[A-Za-z0-9._-]{{1,{MAX_NAME}}}")
#: The length of a key with the longest names; far below zenoh's limit of 64 KiB, beyond which the
#: sender's session ends (eclipse-zenoh 1.10.2).
MAX_KEY: Final = len(f"{ROOT}///stop/") + 3 * MAX_NAME


class Kind(Enum):
    """The kind of a request; a part of its key."""

    ASK = "ask"  #: to read: changes nothing, open to every role
    COMMAND = "cmd"  #: to change something: needs a role, and mostly the lease
    STOP = "stop"  #: to end what the rig does: open to every client


def check_name(name: str, what: str = "name") -> str:
    """Return ``name`` if it is allowed in a key.

    Raises:
        Refusal: it is not allowed.
    """
    if _NAME.fullmatch(name) is None:
        raise Refusal(
            Code.BAD_REQUEST,
            f"the {what} {name[:MAX_NAME]!r} is not allowed in a key",
            hint=f"use 1 to {MAX_NAME} of A-Z a-z 0-9 . _ -",
        )
    return name


@dataclass(frozen=True)
class Address:
    """The rig, client and verb of a request, from its key."""

    kind: Kind
    identity: str
    verb: str


@dataclass(frozen=True)
class Keys:
    """The keys of one rig.

    Raises:
        Refusal: its name is not allowed in a key.
    """

    rig: str

    def __post_init__(self) -> None:
        check_name(self.rig, "rig name")

    @property
    def prefix(self) -> str:
        """The beginning of every key of the rig, without a slash at its end."""
        return f"{ROOT}/{self.rig}"

    @property
    def alive(self) -> str:
        """The liveliness token: there while the daemon's session lives."""
        return f"{self.prefix}/alive"

    @property
    def status(self) -> str:
        """Status messages; also a queryable that gives the newest."""
        return f"{self.prefix}/status"

    @property
    def event(self) -> str:
        """Event messages."""
        return f"{self.prefix}/event"

    def live(self, stream: str) -> str:
        """Frames of one stream."""
        return f"{self.prefix}/live/{check_name(stream, 'stream')}"

    @property
    def every_live(self) -> str:
        """Frames of all streams."""
        return f"{self.prefix}/live/*"

    def request(self, kind: Kind, identity: str, verb: str) -> str:
        """The key with which ``identity`` requests ``verb``."""
        return (
            f"{self.prefix}/{kind.value}/{check_name(identity, 'identity')}/"
            f"{check_name(verb, 'verb')}"
        )

    def every_request(self, kind: Kind, identity: str = "*") -> str:
        """All requests of one kind, of every identity or of one."""
        if identity != "*":
            check_name(identity, "identity")
        return f"{self.prefix}/{kind.value}/{identity}/*"

    def address(self, key: str) -> Address:
        """Parse the key of a request.

        Raises:
            Refusal: it is not the key of a request to this rig.
        """
        parts = key.split("/") if len(key) <= MAX_KEY else []
        kinds = {kind.value: kind for kind in Kind}
        if len(parts) != 5 or parts[:2] != [ROOT, self.rig] or parts[2] not in kinds:
            raise Refusal(
                Code.BAD_REQUEST, f"{key[:MAX_KEY]!r} is not the key of a request to {self.rig}"
            )
        return Address(
            kinds[parts[2]], check_name(parts[3], "identity"), check_name(parts[4], "verb")
        )
