"""A ring and a table for one device, and its helper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.recordings.blocks import TESTS

from rigd.config.rig import DeviceConfig
from rigd.engine.shared.rowring import RowRing
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.table import LatestTable, Slot

START_NS, ORIGIN_NS = 1_700_000_000_000_000_000, 5_000_000_000


@dataclass
class Place:
    """Destination of one device's rows."""

    ring: RowRing
    slot: Slot
    helper: BlockHelper
    log: Path


@pytest.fixture
def placed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Place]]:
    """Make what a device needs; its helper is stopped in the end."""
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    helpers: list[BlockHelper] = []

    def make(device: DeviceConfig, **options: object) -> Place:
        ring = RowRing.create(tmp_path / "rows.ring", device.stream, 100_000)
        table = LatestTable.create(tmp_path / "latest", [device.stream])
        log = tmp_path / "helper.log"
        helper = BlockHelper(
            device,
            ring=tmp_path / "rows.ring",
            table=tmp_path / "latest",
            table_streams=[device.stream],
            start_ns=START_NS,
            origin_ns=ORIGIN_NS,
            log=log,
            **options,  # type: ignore[arg-type]  # tests name real options
        )
        helpers.append(helper)
        return Place(ring, table.slot(device.name), helper, log)

    yield make
    for helper in helpers:
        helper.stop()
