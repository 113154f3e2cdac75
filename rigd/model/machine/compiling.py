"""Announces that numerical functions are compiled, as the first start after an installation does.

It takes up to half a minute, in which a command shows nothing else. This module imports nothing, so
that a command can say what is to be shown before it is known whether anything is compiled.
"""

from __future__ import annotations

from collections.abc import Callable

_waiting: list[Callable[[], object]] = []


def announce_once(show: Callable[[], object]) -> None:
    """Call ``show`` when a kernel of this process is compiled, and not when more are."""
    _waiting[:] = [show]


def begins() -> None:
    """Announce that a kernel is now compiled."""
    while _waiting:
        _waiting.pop()()
