"""A name server that no longer answers."""

from __future__ import annotations

import socket
from typing import Any

import pytest


def lose_name_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every lookup of `localhost` fail from now on."""
    find = socket.getaddrinfo

    def away(host: str, *arguments: Any, **options: Any) -> Any:
        if host == "localhost":
            raise socket.gaierror("no name server answers")
        return find(host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", away)
