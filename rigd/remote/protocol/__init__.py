"""Defines the remote protocol, without any I/O: zenoh keys, requests (verbs), messages, limits.

The names that other packages use are those of :mod:`rigd.remote.protocol.names`. They are imported
when one is used first: the models of all messages take half a second, and a stop needs none.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigd.remote.protocol.names import *  # noqa: F403
else:

    def __getattr__(name: str) -> Any:
        """Import the names at the first use of one."""
        if name.startswith("__") or name == "names":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from rigd.remote.protocol import names

        return getattr(names, name)
