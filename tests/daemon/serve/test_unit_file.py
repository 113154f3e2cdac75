"""The systemd unit that is shipped fits the daemon."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import pytest

from rigd.cli.main import build_parser
from rigd.daemon.serve.upkeep.descriptors import WANTED
from rigd.daemon.serve.upkeep.notify import SIGN_S
from rigd.sdk.shipped_files import shipped_folder


def settings() -> Iterator[tuple[str, str]]:
    for line in (shipped_folder("configs") / "rigd@.service").read_text().splitlines():
        if "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            yield name, value


@pytest.fixture(scope="module")
def unit() -> dict[str, str]:
    return dict(settings())


def test_command_of_the_unit_file_is_accepted(unit: dict[str, str]) -> None:
    program, *arguments = shlex.split(unit["ExecStart"])
    assert program.endswith("/rigd")
    args = build_parser().parse_args([argument.replace("%i", "lugre-1") for argument in arguments])
    assert args.rig == "/etc/rigd/lugre-1.yaml"
    assert args.panel is None  # a panel if its extra is installed; without it the daemon serves on
    assert str(args.runs).removeprefix("/var/lib/") == unit["StateDirectory"].replace(
        "%i", "lugre-1"
    )


def test_systemd_waits_for_daemon_and_leaves_its_processes(unit: dict[str, str]) -> None:
    assert unit["Type"] == "notify"
    assert unit["KillMode"] == "process"
    assert float(unit["WatchdogSec"]) >= 10 * SIGN_S
    assert unit["Restart"] == "on-failure"
    assert unit["LimitMEMLOCK"] == "infinity"
    assert int(unit["LimitNOFILE"]) >= WANTED
