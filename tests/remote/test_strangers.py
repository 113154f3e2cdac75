"""A client without a certificate of the lab gets nothing, and a client trusts no false rig."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from support.daemon.served_rig import Served, free_port, key, request, serve
from support.daemon.zenoh_client import Refused, ZenohClient, config

from rigd.config.remote import RemoteSetup
from rigd.remote.tls import SERVER, files_of, setup_tls

#: Connections, and how long a client may try beside them, in s: less than zenoh needs for them.
GONE, PATIENCE_S = 900, 45.0
Configure = Callable[[Served, Path], dict[str, Any]]


def of_another_lab(served: Served, folder: Path) -> dict[str, Any]:
    """A certificate with the name alice, signed by another authority."""
    setup_tls(folder, ["localhost"], ["alice"])
    made = config(served.endpoint, folder, "alice")
    assert served.certificates is not None
    trusted = str(served.certificates / "ca.crt")
    made["transport"]["link"]["tls"]["root_ca_certificate"] = trusted
    return made


def expired(served: Served, folder: Path) -> dict[str, Any]:
    """A certificate of the lab that was valid until yesterday."""
    assert served.certificates is not None
    for name in ("ca.crt", "ca.key"):
        (folder / name).write_bytes((served.certificates / name).read_bytes())
    now = datetime.now(UTC) - timedelta(days=2)
    setup_tls(folder, ["localhost"], ["alice"], valid=timedelta(days=1), now=now)
    return config(served.endpoint, folder, "alice")


def not_yet_valid(served: Served, folder: Path) -> dict[str, Any]:
    """A certificate of the lab that is valid from tomorrow on."""
    assert served.certificates is not None
    for name in ("ca.crt", "ca.key"):
        (folder / name).write_bytes((served.certificates / name).read_bytes())
    setup_tls(folder, ["localhost"], ["alice"], now=datetime.now(UTC) + timedelta(days=1))
    return config(served.endpoint, folder, "alice")


def of_a_server(served: Served, folder: Path) -> dict[str, Any]:
    """The rig's own certificate, stolen: it is not for clients."""
    return config(served.endpoint, served.certificates, "rigd")


def without(served: Served, folder: Path) -> dict[str, Any]:
    """No certificate."""
    return config(served.endpoint, served.certificates)


def in_clear(served: Served, folder: Path) -> dict[str, Any]:
    """No TLS at all."""
    return config(served.endpoint.replace("tls/", "tcp/"))


@pytest.mark.parametrize(
    "configure", [without, in_clear, of_another_lab, expired, not_yet_valid, of_a_server]
)
def test_client_without_certificate_is_refused(
    over_tls: Served, tmp_path: Path, configure: Configure
) -> None:
    settings = configure(over_tls, tmp_path)
    with pytest.raises(Refused, match="Unable to connect"):
        ZenohClient(settings)
    with over_tls.client("alice") as friend:
        assert "result" in friend.ask(key("ask", "alice", "latest"), request("latest"))


def test_certificate_is_accepted_while_it_is_valid(over_tls: Served) -> None:
    with over_tls.client("alice") as client:
        assert client.alive("rigd/*/alive") == ["rigd/lugre-1/alive"]


def test_client_does_not_trust_rig_of_another_lab(
    over_tls: Served, certificates: Path, tmp_path: Path
) -> None:
    setup_tls(tmp_path, ["127.0.0.1"], ["alice"])
    made = config(over_tls.endpoint, certificates, "alice")
    made["transport"]["link"]["tls"]["root_ca_certificate"] = str(tmp_path / "ca.crt")
    with pytest.raises(Refused, match="Unable to connect"):
        ZenohClient(made)


def test_client_does_not_trust_rig_under_another_name(tmp_path: Path) -> None:
    setup_tls(tmp_path, ["rig.lab"], ["alice"])
    setup = RemoteSetup(
        (f"tls/127.0.0.1:{free_port()}",), files_of(tmp_path, SERVER), {"alice": "operator"}
    )
    with serve(setup, tmp_path) as served, pytest.raises(Refused, match="Unable to connect"):
        served.client("alice")


def test_a_client_cannot_pose_as_the_rig(certificates: Path) -> None:
    """The certificate of a client is refused by other clients, were it to listen."""
    setup = RemoteSetup(
        (f"tls/127.0.0.1:{free_port()}",), files_of(certificates, "carol"), {"alice": "operator"}
    )
    with serve(setup, certificates) as served, pytest.raises(Refused, match="Unable to connect"):
        served.client("alice")


def test_connections_that_have_gone_delay_no_client(over_tls: Served) -> None:
    """zenoh pauses for 0.1 s after each; they would keep a client out for longer than it tries."""
    host, _, port = over_tls.endpoint.partition("/")[2].rpartition(":")
    with ExitStack() as opened:
        for _ in range(GONE):
            found = opened.enter_context(socket.socket())
            found.setblocking(False)
            found.connect_ex((host, int(port)))
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            with over_tls.client("alice") as client:
                assert client.alive("rigd/*/alive") == ["rigd/lugre-1/alive"]
                return
        except Refused:
            assert time.monotonic() < deadline
