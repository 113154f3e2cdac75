"""A simulated device on a pseudo-terminal as the peer of the conformance suite."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from rigd.sdk.check import Observed, Peer, SentReading, background_loop
from rigd_sim.wire.serial_part import SerialPart


def serial_peer(
    path: Path,
    make: Callable[[], SerialPart],
    readings: Sequence[SentReading] | None = None,
    **late: Any,
) -> Callable[[], AbstractContextManager[Peer]]:
    """Return what starts the device of ``make``, which serves ``path``, with its faults.

    ``readings`` are those that it notes; ``late`` are options of the fault of that name.
    """

    @contextmanager
    def peer() -> Iterator[Peer]:
        device = make()

        async def inject(fault: str, **options: Any) -> None:
            device.inject(fault, **options)

        with background_loop() as run:
            run(device.start())
            try:
                yield Peer(
                    # A pseudo-terminal has no other data bits and parity.
                    options={"port": str(path), "data_bits": 8, "parity": "none"},
                    faults={
                        "dead": lambda: run(inject("unplug")),
                        "silent": lambda: run(inject("silent")),
                        "late": lambda: run(inject("late", **late)),
                        "garbled": lambda: run(inject("garbage")),
                    },
                    observed=Observed,
                    readings=readings,
                )
            finally:
                run(device.stop())

    return peer
