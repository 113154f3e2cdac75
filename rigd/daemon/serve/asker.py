"""Who asks for something: the client that is known, and whom it speaks for."""

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
