"""What the cycle sees of the devices beside it; imports nothing that brings them up."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.slow.latest import Latest
from rigd.engine.slow.table import LatestTable
from rigd.engine.windows import Windows
from rigd.engine.wiring import in_cycle
from rigd.model.channels import Stream
from rigd.sdk import Driver

#: The table of latest values in the folder of a run.
TABLE: Final = "latest"


def beside(rig: RigConfig) -> list[Stream]:
    """Return the streams of the devices of ``rig`` that run beside the cycle."""
    return [device.stream for device in rig.devices.values() if not in_cycle(device)]


class StandIns:
    """What the cycle of the run in ``folder`` sees of the devices beside it, and tells them."""

    def __init__(self, rig: RigConfig, folder: Path) -> None:
        streams = beside(rig)
        self._table = LatestTable.attach(folder / TABLE, streams) if streams else None
        self.windows: Mapping[str, Windows] = {}  #: when their rows are recorded, by stream
        if self._table is not None:
            self.windows = {stream.name: self._table.windows(stream.name) for stream in streams}

    def of(self, device: DeviceConfig) -> Driver:
        """Return what stands in the cycle for ``device``."""
        if self._table is None:
            raise TypeError(f"{device.name} does not run beside the cycle")
        return Latest(device, self._table.slot(device.name))
