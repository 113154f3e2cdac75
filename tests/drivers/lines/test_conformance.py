"""The driver keeps the promises of the SDK, asked and unasked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from rigd.sdk.check import Peer, background_loop, check_driver
from rigd_drivers.lines.driver import Lines
from rigd_sim.wire.lines import SimLines


def simulated(folder: Path, *, asked: bool) -> Callable[[], AbstractContextManager[Peer]]:
    @contextmanager
    def peer() -> Iterator[Peer]:
        path = folder / "gauge"
        device = SimLines(
            "gauge", path, lambda: {"force": 1.5}, "{force:.3f} N",
            ask="?" if asked else None, interval_s=0.05,
        )  # fmt: skip

        async def inject(fault: str, **options: Any) -> None:
            device.inject(fault, **options)

        with background_loop() as run:
            run(device.start())
            try:
                yield Peer(
                    options={"port": str(path)},
                    faults={
                        "dead": lambda: run(inject("unplug")),
                        "silent": lambda: run(inject("silent")),
                        "late": lambda: run(inject("late", delay_s=1.0)),
                        "garbled": lambda: run(inject("garbage")),
                    },
                )
            finally:
                run(device.stop())

    return peer


@pytest.mark.parametrize("asked", [True, False])
def test_it_keeps_what_a_slow_driver_promises(asked: bool, tmp_path: Path) -> None:
    options = {
        "pattern": r"(?P<force>-?\d+\.\d{3}) N",
        "channels": {"force": "N"},
        "silence": "1 s",
        **({"ask": r"?\r\n"} if asked else {}),
    }
    report = check_driver(Lines, options, peer=simulated(tmp_path, asked=asked))
    assert report.skipped == {}
