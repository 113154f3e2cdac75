"""``pytest --cpu-report=FILE``: CPU seconds of every test and of what it started and waited for.

They do not depend on what else the machine does, as wall time would. Every process of pytest adds
lines to FILE, so that one file takes a whole ``make test``. ``scripts/cpu_report.py FILE`` sums it
up.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from time import monotonic

import pytest
from support import warm

#: Under this name stands what no test can answer for: imports and collection.
STARTING = "(imports and collection)"


def cpu_s() -> float:
    """Return the CPU seconds of this process and of all the children it has waited for."""
    spent = os.times()
    own = spent.user + spent.system
    return own + spent.children_user + spent.children_system + warm.spent_s


class Report:
    """Adds a line to a file for each test: CPU seconds, wall seconds, name."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def add(self, cpu: float, wall: float, name: str) -> None:
        """Add a line, whole, beside other processes."""
        with self.file.open("a", encoding="utf-8") as file:
            file.write(f"{cpu:.3f}\t{wall:.3f}\t{name}\n")

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Add what it took to come here."""
        del session
        self.add(cpu_s(), 0.0, STARTING)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Add what a test takes, its fixtures included."""
        cpu, wall = cpu_s(), monotonic()
        result = yield
        self.add(cpu_s() - cpu, monotonic() - wall, item.nodeid)
        return result


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the option."""
    parser.addoption(
        "--cpu-report", metavar="FILE", help="add the CPU seconds of each test to FILE"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Report if it is asked for; a worker knows the option from the process that started it."""
    file = config.getoption("--cpu-report")
    if file:
        config.pluginmanager.register(Report(Path(str(file)).absolute()))
