"""Defines how a rig file describes a simulated speed drive on Modbus: its make and its line."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from annotated_types import Ge, Le
from pydantic import model_validator

from rigd.sdk import SimulationConfig, wrong_entry
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.modbus.line import Line, SerialLine, TcpLine


class ModbusDriveOptions(SimulationConfig):
    """A speed drive on Modbus TCP or RTU."""

    host: str = "127.0.0.1"
    """Address where it is reached."""
    port: Annotated[int, Ge(1), Le(65535)] | None = None
    """TCP port where it is reached; none: Modbus RTU at 19200 baud, on a serial port of the
    device's name in the folder."""
    make: Literal["delta-asda-b", "schneider-atv320"] = "schneider-atv320"
    """Which drive."""
    unit: Annotated[int, Ge(0), Le(255)] = 1
    """Its unit address."""

    def line(self, name: str, folder: Folder) -> Line:
        """Return the line on which the drive ``name`` is reached."""
        if self.port is None:
            return SerialLine(folder.socket(name))
        return TcpLine(self.host, self.port)

    @model_validator(mode="after")
    def _host_has_port(self) -> Self:
        if self.port is None and "host" in self.model_fields_set:
            raise wrong_entry(
                "'host' needs a 'port' (Modbus TCP); without both the drive is on a serial line",
                "host",
            )
        return self
