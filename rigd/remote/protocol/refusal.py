"""Defines the error that a daemon returns if it does not carry out a request."""

from __future__ import annotations

from enum import Enum
from typing import Final

from rigd.model.errors import Exit, RigdError


class Code(Enum):
    """Why a request was not carried out."""

    BAD_REQUEST = "bad_request"  #: malformed, or an argument that cannot be
    UNKNOWN_VERB = "unknown_verb"
    VERSION = "version"  #: another version of the protocol
    TOO_LARGE = "too_large"
    REPLAYED = "replayed"  #: too old, or its id was used for another request
    FORBIDDEN = "forbidden"  #: the role does not allow it
    NO_LEASE = "no_lease"  #: it needs the control lease, which no client or another one has
    LEASE_HELD = "lease_held"  #: the control lease is another's
    BUSY = "busy"  #: too many requests at once; ask again
    CONFLICT = "conflict"  #: not in this state, such as `resume` while idle
    REFUSED = "refused"  #: the rig or the procedure speaks against it
    WRONG = "wrong"  #: the procedure is wrong, or does not fit the rig; names every problem
    NOT_FOUND = "not_found"
    INTERNAL = "internal"  #: a bug in the daemon


#: The codes of an error in the request itself.
_BAD_INPUT: Final = frozenset(
    {
        Code.BAD_REQUEST,
        Code.UNKNOWN_VERB,
        Code.VERSION,
        Code.TOO_LARGE,
        Code.WRONG,
        Code.NOT_FOUND,
    }
)


class Refusal(RigdError):
    """A request that is not carried out; nothing has changed. It travels as an error reply."""

    def __init__(self, code: Code, message: str, *, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.code = code
        if code is Code.INTERNAL:
            self.exit_code = Exit.INTERNAL
        else:
            self.exit_code = Exit.BAD_INPUT if code in _BAD_INPUT else Exit.BLOCKED
