"""Defines what every layer shares: units, channels, streams, limits, states, errors."""

from rigd.model.channels import Channel, Stream
from rigd.model.errors import (
    Blocked,
    ConfigError,
    DataError,
    DeviceError,
    LinkError,
    Place,
    ProcedureError,
    ProtocolError,
    RecordingError,
    RigdError,
)
from rigd.model.states import RunEvent, RunState, next_state
from rigd.model.units import Quantity, Unit, format_quantity, parse_quantity, parse_unit

__all__ = [
    "Blocked",
    "Channel",
    "ConfigError",
    "DataError",
    "DeviceError",
    "LinkError",
    "Place",
    "ProcedureError",
    "ProtocolError",
    "Quantity",
    "RecordingError",
    "RigdError",
    "RunEvent",
    "RunState",
    "Stream",
    "Unit",
    "format_quantity",
    "next_state",
    "parse_quantity",
    "parse_unit",
]
