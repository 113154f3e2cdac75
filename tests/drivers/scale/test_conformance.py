"""The driver keeps the promises of the SDK; KERN KCP is MT-SICS with a pause."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from rigd.sdk.check import Peer, background_loop, check_driver
from rigd_drivers.scale.driver import SerialScale
from rigd_sim.wire.scale import SimScale


def simulated(folder: Path, dialect: Any) -> Callable[[], AbstractContextManager[Peer]]:
    @contextmanager
    def peer() -> Iterator[Peer]:
        path = folder / "scale"
        scale = SimScale("scale", path, lambda: 0.0, dialect=dialect, settling_s=0.02)

        async def inject(fault: str) -> None:
            scale.inject(fault)

        with background_loop() as run:
            run(scale.start())
            try:
                yield Peer(
                    options={"port": str(path)},
                    faults={
                        "dead": lambda: run(inject("unplug")),
                        "silent": lambda: run(inject("silent")),
                        "late": lambda: run(inject("late")),
                        "garbled": lambda: run(inject("garbage")),
                    },
                )
            finally:
                run(scale.stop())

    return peer


@pytest.mark.parametrize("dialect", ["mt-sics", "and-d"])
def test_it_keeps_what_a_slow_driver_promises(dialect: str, tmp_path: Path) -> None:
    report = check_driver(SerialScale, {"dialect": dialect}, peer=simulated(tmp_path, dialect))
    assert report.skipped == {}
