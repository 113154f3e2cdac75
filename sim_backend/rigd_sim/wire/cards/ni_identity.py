"""What a simulated NI card answers about itself and its driver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rigd_sim.wire.cards.ni_card import DaqFault
from rigd_sim.wire.cards.ni_grpc import Call, looked_up

DRIVER_VERSION: Final = (24, 5, 0)

# Numbers of NI-DAQmx: attributes (nidaqmx.proto, enums *Attribute).
_SYSTEM_NUMBERS: Final = dict(zip((0x1272, 0x1923, 0x2F22), DRIVER_VERSION, strict=True))
_DEVICE_NAMES: Final = 0x193B
_PRODUCT_TYPE, _SERIAL_NUMBER = 0x0631, 0x0632


@dataclass(frozen=True)
class Identity:
    """One card on its server: name in NI MAX, product, serial number, whether it is gone."""

    device: str
    product: str
    serial: int
    is_removed: Callable[[], bool]

    @property
    def calls(self) -> Mapping[str, Call]:
        """The calls that it serves, by their names in nidaqmx.proto."""
        return {
            "GetSystemInfoAttributeUInt32": self._system_number,
            "GetSystemInfoAttributeString": self._system_text,
            "GetDeviceAttributeString": self._device_text,
            "GetDeviceAttributeUInt32": self._device_number,
        }

    def check(self, device: str) -> None:
        """Do nothing if ``device`` is the card, and there.

        Raises:
            DaqFault: it is not.
        """
        if device != self.device or self.is_removed():
            raise DaqFault(-200220, f"Device identifier is invalid. Device Specified: {device}")

    def _system_number(self, request: Any) -> dict[str, Any]:
        return {"value": looked_up(_SYSTEM_NUMBERS, request)}

    def _system_text(self, request: Any) -> dict[str, Any]:
        present = "" if self.is_removed() else self.device
        return {"value": looked_up({_DEVICE_NAMES: present}, request)}

    def _device_text(self, request: Any) -> dict[str, Any]:
        self.check(request.device_name)
        return {"value": looked_up({_PRODUCT_TYPE: self.product}, request)}

    def _device_number(self, request: Any) -> dict[str, Any]:
        self.check(request.device_name)
        return {"value": looked_up({_SERIAL_NUMBER: self.serial}, request)}
