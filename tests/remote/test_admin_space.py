"""The administration of zenoh shows nothing of a rig, to any client."""

from __future__ import annotations

import pytest
from support.daemon.served_rig import Served
from support.daemon.zenoh_client import ZenohClient

#: Where zenoh shows sessions, links, keys and its configuration: of all, or of the one named.
KEYS = ("@/**", "@/*/peer/**", "@/*/session/**", "@/{zid}/**", "@/{zid}/session/**",
        "@/{zid}/peer", "@/{zid}/peer/config/**", "**")  # fmt: skip


def answers(client: ZenohClient, zid: str) -> list[str]:
    """What the daemon's session answers; that of a client itself shows it its own links."""
    asked = [key.replace("{zid}", zid) for key in KEYS]
    found = [item["key"] for key in asked for item in client.get(key)]
    return [key for key in found if key is None or key.startswith(f"@/{zid}/")]


@pytest.mark.parametrize("name", ["alice", "bob", "carol", "mallory"])
def test_no_certificate_reaches_the_admin_space(over_tls: Served, name: str) -> None:
    with over_tls.client(name) as client:
        assert answers(client, over_tls.server.zid) == []


def test_loopback_client_cannot_reach_the_admin_space(on_loopback: Served) -> None:
    with on_loopback.client() as client:
        assert answers(client, on_loopback.server.zid) == []
