"""The origin of a request: the client's identity and the user that it names."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Asker:
    """A client by its ``identity``, and the ``user`` that it names where it speaks for several.

    The lease is the client's; what is written down names both.
    """

    identity: str
    user: str = ""

    def __str__(self) -> str:
        return f"{self.user} ({self.identity})" if self.user else self.identity

    @property
    def lost(self) -> str:
        """What has happened where it shows life no more; a user's sign of life is their page."""
        if self.user:
            return f"{self.user}'s page ({self.identity}) was closed or cut off"
        return f"{self.identity} has vanished"
