"""Where a client finds a rig, and under which identity."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from rigd.config.remote import TlsFiles
from rigd.model.errors import ConfigError
from rigd.remote.client.rigs.address import list_path
from rigd.remote.client.rigs.target import find_target, make_target
from rigd.remote.protocol import Refusal
from rigd.remote.tls import files_of, setup_tls

LIST = """\
remotes:
  lugre-1: {endpoint: tcp/127.0.0.1:7001, identity: ann}
  wire-1:
    endpoint: tls/rig.lab:7447
    tls: {ca: certs/ca.crt, certificate: certs/alice.crt, key: certs/alice.key}
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the client's list."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (tmp_path / "rigd").mkdir()
    return tmp_path / "rigd"


def test_without_list_rig_is_on_this_machine(home: Path) -> None:
    target = find_target("lugre-1")
    assert (target.rig, target.endpoint, target.tls) == ("lugre-1", "tcp/127.0.0.1:7447", None)


def test_list_gives_address_and_identity(home: Path) -> None:
    (home / "remotes.yaml").write_text(LIST)
    target = find_target("lugre-1")
    assert (target.endpoint, target.identity) == ("tcp/127.0.0.1:7001", "ann")
    assert find_target("lugre-1", identity="bob").identity == "bob"
    assert find_target("lugre-1", "tcp/127.0.0.1:9").endpoint == "tcp/127.0.0.1:9"


def test_certificates_beside_list_are_found_and_name_client(home: Path) -> None:
    setup_tls(home / "certs", ["rig.lab"], ["alice"])
    (home / "remotes.yaml").write_text(LIST)
    target = find_target("wire-1")
    assert target.identity == "alice"
    assert target.tls == files_of(home / "certs", "alice")


def test_only_rig_of_list_needs_no_name(home: Path) -> None:
    (home / "remotes.yaml").write_text("remotes: {far-1: {endpoint: tcp/127.0.0.1:7002}}\n")
    assert find_target().rig == "far-1"


def test_choice_among_several_rigs_needs_a_name(home: Path) -> None:
    (home / "remotes.yaml").write_text(LIST)
    with pytest.raises(ConfigError, match=r"which rig\? .* has lugre-1, wire-1"):
        find_target()
    assert "did you mean 'lugre-1'" in find_target("lugre1").note


def test_changed_list_is_read_again(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
    now = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: now() + 10**10)  # long after the list was made
    (home / "remotes.yaml").write_text(LIST)
    for _ in range(2):
        assert find_target("lugre-1").endpoint == "tcp/127.0.0.1:7001"
    assert (home / "cache" / "rigd" / "remotes.json").exists()
    (home / "remotes.yaml").write_text(LIST.replace("7001", "7002"))
    assert find_target("lugre-1").endpoint == "tcp/127.0.0.1:7002"
    (home / "remotes.yaml").unlink()
    assert find_target("lugre-1").endpoint == "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"made": 1}', "\0"])
def test_damaged_copy_of_list_is_ignored(
    home: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
    (home / "cache" / "rigd").mkdir(parents=True)
    (home / "cache" / "rigd" / "remotes.json").write_text(text)
    (home / "remotes.yaml").write_text(LIST)
    assert find_target("lugre-1").endpoint == "tcp/127.0.0.1:7001"


def test_mistake_in_list_is_named_with_its_place(home: Path) -> None:
    (home / "remotes.yaml").write_text("remotes:\n  lugre-1: {endpont: tcp/127.0.0.1:7001}\n")
    with pytest.raises(ConfigError, match=r"remotes\.yaml:2:13: .*'endpont'"):
        find_target("lugre-1")
    assert list_path() == home / "remotes.yaml"


@pytest.mark.parametrize(
    "endpoint", ["127.0.0.1:7447", "tcp/a", "udp/a:1", "tcp/a:1#iface=lo", "tcp/a:70000", ""]
)
def test_invalid_address_is_refused(endpoint: str) -> None:
    with pytest.raises(ConfigError, match="is not the address of a daemon"):
        make_target("lugre-1", endpoint)


def test_certificates_and_tls_come_together(tmp_path: Path) -> None:
    files = TlsFiles(tmp_path / "ca.crt", tmp_path / "a.crt", tmp_path / "a.key")
    with pytest.raises(ConfigError, match="needs certificates"):
        make_target("lugre-1", "tls/rig.lab:7447")
    with pytest.raises(ConfigError, match="unencrypted"):
        make_target("lugre-1", "tcp/127.0.0.1:7447", files)
    with pytest.raises(ConfigError, match=r"there is no file .*ca\.crt"):
        make_target("lugre-1", "tls/rig.lab:7447", files)


def test_certificate_of_another_name_is_refused(tmp_path: Path) -> None:
    setup_tls(tmp_path, ["rig.lab"], ["alice"])
    files = files_of(tmp_path, "alice")
    with pytest.raises(ConfigError, match="is the certificate of alice, not of bob"):
        make_target("lugre-1", "tls/rig.lab:7447", files, "bob")
    junk = tmp_path / "junk.crt"
    junk.write_text("no certificate")
    with pytest.raises(ConfigError, match="is no certificate in PEM"):
        make_target("lugre-1", "tls/rig.lab:7447", TlsFiles(files.ca, junk, files.key))


def test_names_are_made_to_fit_key_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOGNAME", "Zoë /*lab")
    assert make_target().identity == "Zo-lab"
    with pytest.raises(Refusal, match="is not allowed in a key"):
        make_target(identity="a/b")
    with pytest.raises(Refusal, match="is not allowed in a key"):
        make_target("configs/sim_lugre.yaml*")
