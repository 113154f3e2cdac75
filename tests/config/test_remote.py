"""The `remote:` section: what opens a rig to others, and what it refuses to open."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import parse_rig
from rigd.config.remote import RemoteSetup, TlsFiles
from rigd.model import ConfigError

FILE = Path("/labs/bench/rig.yaml")
TLS = "tls: {ca: certs/ca.crt, certificate: certs/rigd.crt, key: certs/rigd.key}"


def setup(rig_text: str, section: str) -> RemoteSetup:
    return parse_rig(f"{rig_text}\nremote: {{{section}}}\n", FILE).remote


def test_rig_is_open_to_its_own_machine_only(rig_text: str) -> None:
    default = parse_rig(rig_text, FILE).remote
    assert default == RemoteSetup(("tcp/127.0.0.1:7447",), None, {})
    assert setup(rig_text, "") == default


def test_certificates_open_it_to_others(rig_text: str) -> None:
    opened = setup(
        rig_text, f"listen: [tls/0.0.0.0:7447], {TLS}, roles: {{alice: operator, bob: observer}}"
    )
    assert opened.listen == ("tls/0.0.0.0:7447",)
    assert opened.roles == {"alice": "operator", "bob": "observer"}
    certs = FILE.parent / "certs"
    assert opened.tls == TlsFiles(certs / "ca.crt", certs / "rigd.crt", certs / "rigd.key")


def test_roles_can_be_given_without_certificates(rig_text: str) -> None:
    assert setup(rig_text, "roles: {guest: observer}").roles == {"guest": "observer"}


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:1", "tcp/127.8.9.1:65535", "tcp/[::1]:7447"])
def test_loopback_needs_no_certificates(rig_text: str, endpoint: str) -> None:
    assert setup(rig_text, f"listen: ['{endpoint}']").listen == (endpoint,)


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("listen: ['tcp/0.0.0.0:7447']", "every client on the network can reach"),
        ("listen: ['tcp/192.168.1.5:7447']", "every client on the network"),
        ("listen: ['tcp/[::]:7447']", "every client on the network"),
        ("listen: ['tcp/localhost:7447']", "every client on the network"),
        ("listen: ['tls/127.0.0.1:7447']", "needs certificates"),
        (f"listen: ['tcp/127.0.0.1:7447'], {TLS}, roles: {{a: operator}}",
         "without a certificate"),
        (f"{TLS}, roles: {{a: operator}}, listen: ['tls/1.2.3.4:7', 'tcp/1.2.3.4:7']",
         "without a certificate"),
        (f"listen: ['tls/0.0.0.0:7447'], {TLS}", "no client could connect"),
        ("listen: ['127.0.0.1:7447']", "is not an address to listen on"),
        ("listen: ['tcp/127.0.0.1:0']", "is not an address to listen on"),
        ("listen: ['tcp/127.0.0.1:70000']", "is not an address to listen on"),
        ("listen: ['udp/127.0.0.1:7447']", "is not an address to listen on"),
        ("listen: ['tcp/127.0.0.1:7447#iface=eth0']", "is not an address to listen on"),
        ("listen: []", "at least 1 needed"),
        ("roles: {'a/b': operator}", ":18: 'a/b' is not a valid name"),
        ("roles: {'*': operator}", ":18: '*' is not a valid name"),
        ("roles: {alice: root}", "'root' is not one of observer, operator, maintainer"),
        ("tls: {ca: a, certificate: b}, roles: {a: operator}", "key 'key' is missing"),
        ("lisen: []", "did you mean 'listen'"),
    ],
)  # fmt: skip
def test_unprotected_remote_address_is_refused(rig_text: str, section: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        setup(rig_text, section)
    assert said in str(caught.value)
    assert "/labs/bench/rig.yaml:" in str(caught.value)
