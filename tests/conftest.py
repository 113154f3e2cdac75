"""What holds for every test: one thread of linear algebra, signals that act, what runs beside what.

The systems to solve are small. Threads that wait for one another cost many times what one alone
does, and the cores that other tests need. Commands that tests start inherit it.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy is imported
    os.environ.setdefault(name, "1")

# A suite started with nohup, or in the background of a script, is told to ignore these. What it
# starts would inherit that, and rigd heeds it: no test of a Ctrl-C or a lost terminal could pass.
for number, action in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, action)

pytest_plugins = ["support.cpu"]

HERE = Path(__file__).parent
#: Folders and files whose tests compute, or wait for answers and not by the clock. All others run
#: rigs or watchdogs in real time, and want the machine for themselves.
SIDE_BY_SIDE = tuple(
    HERE / name
    for name in (
        "cli", "config", "daemon/live", "daemon/serve", "daemon/test_forms.py",
        "daemon/test_virtual_time.py", "docs", "drivers", "evaluate", "identify", "model",
        "packaging", "panel", "procedure", "record", "remote", "sdk", "sim",
        "system/test_approach_angle.py", "system/test_bad_input.py", "system/test_calibrate.py",
        "system/test_identify_campaign.py", "system/test_identify_command.py",
        "system/test_seeds.py",
    )
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that `make test` runs side by side."""
    for item in items:
        if any(item.path.is_relative_to(place) for place in SIDE_BY_SIDE):
            item.add_marker("side_by_side")
