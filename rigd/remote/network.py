"""Builds the zenoh configuration of server and client: endpoints, TLS, access control.

Experiments with eclipse-zenoh 1.10.2 show that zenoh does the following by default:

- listens on every interface and joins a multicast group;
- lets every peer publish on any key and answer any query;
- shares memory for payloads above 3 KiB.

This module turns all of that off.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from typing import Any, Final

import zenoh

from rigd.config.remote import RemoteSetup, TlsFiles
from rigd.remote.protocol.keys import EVERY_ALIVE, Keys, Kind
from rigd.remote.protocol.limits import MAX_MESSAGE_BYTES, MAX_REQUEST_BYTES

#: Silence after which a connection counts as broken: a client that hangs is seen within it.
_LINK_LEASE_MS: Final = 2000
#: How long a connection may take to show a certificate, and then to open a session, in ms.
_ACCEPT_MS: Final = 3000
#: Connections at once: ten clients that watch, a panel, and a reserve.
_MAX_SESSIONS: Final = 32
#: zenoh reads connections in so many threads, by default 2. A thread waits while the queryable of a
#: request has 256 waiting: with a thread for each connection, a flood delays no stop of others.
_RECEIVERS: Final = f"(rx: (worker_threads: {_MAX_SESSIONS + 2}))"
_RUNTIME: Final = "ZENOH_RUNTIME"
#: How long a client tries to connect; the reason of a failure is not known to it.
CONNECT_TIMEOUT_S: Final = 3.0
#: zenoh drops larger messages. It is above the limit of the protocol: the reply to a request that
#: is a little too large states the reason.
_DROPPED_BYTES: Final = 4 * MAX_REQUEST_BYTES


def server_config(keys: Keys, setup: RemoteSetup) -> zenoh.Config:
    """Return the configuration of a daemon's session."""
    link: dict[str, Any] = {
        "protocols": ["tcp" if setup.tls is None else "tls"],
        "tx": {"lease": _LINK_LEASE_MS, "keep_alive": 4},
        "rx": {"max_message_size": MAX_MESSAGE_BYTES},
    }
    listened = list(setup.listen)
    if setup.tls is not None:
        listened = [f"{item}#tls_handshake_timeout_ms={_ACCEPT_MS}" for item in listened]
        link["tls"] = {
            "root_ca_certificate": str(setup.tls.ca),
            "listen_certificate": str(setup.tls.certificate),
            "listen_private_key": str(setup.tls.key),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }
    return _config(
        {
            **_quiet("peer"),
            "listen": {"endpoints": listened, "exit_on_failure": True},
            "connect": {"endpoints": []},
            "transport": {
                "unicast": {
                    "max_sessions": _MAX_SESSIONS,
                    "accept_timeout": _ACCEPT_MS,
                    "accept_pending": 32,
                },
                "link": link,
                "shared_memory": {"enabled": False},
            },
            "low_pass_filter": [
                {
                    "id": "size",
                    "flows": ["ingress"],
                    "messages": ["put", "query"],
                    "key_exprs": ["**"],
                    "size_limit": _DROPPED_BYTES,
                }
            ],
            "access_control": _access_control(keys, setup),
        }
    )


def open_server(config: zenoh.Config) -> zenoh.Session:
    """Return the session of a daemon, with a thread for each connection.

    This works only in a process that has not used zenoh before: zenoh reads its settings once.

    Raises:
        zenoh.ZError: it cannot listen as configured.
    """
    given = os.environ.get(_RUNTIME)
    os.environ[_RUNTIME] = given or _RECEIVERS
    try:
        return zenoh.open(config)
    finally:
        if given is None:  # processes that this one starts need no such threads
            del os.environ[_RUNTIME]


def client_config(endpoints: Sequence[str], tls: TlsFiles | None = None) -> zenoh.Config:
    """Return the configuration of a client's session, such as to ``tls/rig.lab:7447``."""
    link: dict[str, Any] = {"tx": {"lease": _LINK_LEASE_MS, "keep_alive": 4}}
    if tls is not None:
        link["tls"] = {
            "root_ca_certificate": str(tls.ca),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    return _config(
        {
            **_quiet("client"),
            "listen": {"endpoints": []},
            "connect": {
                "endpoints": list(endpoints),
                "timeout_ms": round(1000 * CONNECT_TIMEOUT_S),
                "exit_on_failure": True,
            },
            "transport": {"link": link, "shared_memory": {"enabled": False}},
        }
    )


def _quiet(mode: str) -> dict[str, Any]:
    """Return the configuration of a session that finds no peer, and that no peer finds."""
    return {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "timestamping": {"enabled": False},
    }


def _config(content: dict[str, Any]) -> zenoh.Config:
    return zenoh.Config.from_json5(json.dumps(content))


def _access_control(keys: Keys, setup: RemoteSetup) -> dict[str, Any]:
    """Return rules that give each client access only to its own keys.

    With TLS there is one subject for each name in the roles; without, one for all clients, which
    may then use any name. In both cases no client can publish, answer queries or listen beyond the
    common keys.
    """
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []

    def allow(rule: str, flow: str, messages: Sequence[str], key_exprs: Iterable[str]) -> str:
        rules.append(
            {
                "id": rule,
                "permission": "allow",
                "flows": [flow],
                "messages": list(messages),
                "key_exprs": list(key_exprs),
            }
        )
        return rule

    shown = [keys.status, keys.event, keys.every_live, keys.alive, EVERY_ALIVE]
    answered = [keys.status, *(keys.every_request(kind) for kind in Kind)]
    watching = [
        allow("watch", "ingress", ["declare_subscriber", "declare_liveliness_subscriber",
                                   "liveliness_query"], shown),
        allow("shown", "egress", ["put", "delete", "liveliness_token"], shown),
        allow("state", "ingress", ["query"], [keys.status]),
        allow("answered", "egress", ["reply", "declare_queryable"], answered),
    ]  # fmt: skip
    if setup.tls is None:
        anybody = [keys.every_request(kind) for kind in Kind]
        subjects.append({"id": "anybody"})
        policies.append(
            {
                "subjects": ["anybody"],
                "rules": [*watching, allow("ask", "ingress", ["query"], anybody)],
            }
        )
    else:
        for name, role in setup.roles.items():
            kinds = [kind for kind in Kind if kind is not Kind.COMMAND or role != "observer"]
            own = allow(
                f"ask-{name}", "ingress", ["query"],
                (keys.every_request(kind, name) for kind in kinds),
            )  # fmt: skip
            subjects.append({"id": name, "cert_common_names": [name]})
            policies.append({"subjects": [name], "rules": [*watching, own]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
