"""All that the author of a driver or a plant imports."""

from rigd.model.channels import Channel, Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.sdk.driver import Driver, DriverConfig
from rigd.sdk.plant import Plant, PlantConfig
from rigd.sdk.quantities import In

__all__ = [
    "Channel",
    "DeviceError",
    "Driver",
    "DriverConfig",
    "In",
    "LinkError",
    "Plant",
    "PlantConfig",
    "ProtocolError",
    "Stream",
]
