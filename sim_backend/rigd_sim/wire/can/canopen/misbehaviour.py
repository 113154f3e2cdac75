"""Simulates the faults of a CANopen node, and checks the options of each fault."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from typing import Any, Final

from rigd_sim.wire.can.canopen.sdo import abort_frame, is_segment
from rigd_sim.wire.options import number, whole

FAULTS: Final[Mapping[str, str]] = {
    "silent": "loses its supply: no word, no torque; boots when cleared",
    "reset": "resets itself, once: boot-up message, configuration lost",
    "emergency": "reports an emergency, once (code: 0x8130, 0x8210, 0x2310, 0x3220, 0x7305, ...)",
    "tpdo_missing": "sends no TPDO (number: 0 all, 1 to 4; probability of each)",
    "tpdo_stale": "sends TPDOs with frozen values, heartbeat still alive (number)",
    "tpdo_short": "sends TPDOs one byte too short (number)",
    "tpdo_duplicate": "sends TPDOs twice (number)",
    "tpdo_wrong_id": "sends TPDOs under another COB-ID (number, id)",
    "sdo_abort": "aborts SDO transfers (code; index: 0 for every object)",
    "sdo_silent": "answers no SDO",
    "sdo_wrong_toggle": "answers SDO segments with the wrong toggle bit",
    "mapping_refused": "refuses to change any PDO mapping (abort 0x06040041)",
    "watchdog_dead": "takes no notice of lost heartbeats and late RPDOs",
    "heartbeat_missing": "gives no heartbeat of its own",
    "slow": "sends everything late (delay_s)",
    "twin": "another node with the same id appears on the bus",
}

#: Options by fault: name -> (default, lowest, highest).
_WHOLE: Final[Mapping[str, Mapping[str, tuple[int | None, int, int]]]] = {
    "emergency": {"code": (None, 0x0001, 0xFFFF)},
    "tpdo_missing": {"number": (0, 0, 4)},
    "tpdo_stale": {"number": (0, 0, 4)},
    "tpdo_short": {"number": (0, 0, 4)},
    "tpdo_duplicate": {"number": (0, 0, 4)},
    "tpdo_wrong_id": {"number": (0, 0, 4), "id": (0x1FF, 0x181, 0x57F)},
    "sdo_abort": {"code": (0x08000000, 1, 0xFFFFFFFF), "index": (0, 0, 0xFFFF)},
}
_NUMBERS: Final[Mapping[str, Mapping[str, tuple[float | None, float, float]]]] = {
    "tpdo_missing": {"probability": (1.0, 0.0, 1.0)},
    "slow": {"delay_s": (None, 0.0, 10.0)},
}


def read_options(fault: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of ``fault`` with their defaults.

    Raises:
        ValueError: one is missing, unknown, or out of range.

    """
    given = dict(options)
    kept: dict[str, Any] = {}
    for name, (default, low, high) in _WHOLE.get(fault, {}).items():
        kept[name] = whole(given, name, default, low=low, high=high)
    for name, (usual, least, most) in _NUMBERS.get(fault, {}).items():
        kept[name] = number(given, name, usual, low=least, high=most)
    if given:
        raise ValueError(f"fault {fault!r} takes no option {', '.join(sorted(given))}")
    return kept


class Misbehaviour:
    """The faults that a node has now, and their effect on its frames."""

    def __init__(self, seed: int) -> None:
        #: Options by fault.
        self.shown: dict[str, dict[str, Any]] = {}
        self._random = random.Random(seed)
        self._frozen: dict[int, bytes] = {}

    def hide(self, fault: str) -> dict[str, Any] | None:
        """Stop showing ``fault``; return its options, or None if it was not shown."""
        if fault == "tpdo_stale":
            self._frozen.clear()
        return self.shown.pop(fault, None)

    def tpdo(self, number: int, can_id: int, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield what goes over the wire instead of TPDO ``number``."""
        missing = self._meant("tpdo_missing", number)
        if missing is not None and self._random.random() < missing["probability"]:
            return
        if self._meant("tpdo_stale", number) is not None:
            data = self._frozen.setdefault(number, data)
        if self._meant("tpdo_short", number) is not None:
            data = data[:-1]
        wrong = self._meant("tpdo_wrong_id", number)
        if wrong is not None:
            can_id = wrong["id"]
        yield can_id, data
        if self._meant("tpdo_duplicate", number) is not None:
            yield can_id, data

    def sdo(self, request: bytes, answer: bytes) -> bytes:
        """Return what goes over the wire instead of ``answer``."""
        refused = self.shown.get("sdo_abort")
        index = int.from_bytes(request[1:3], "little")
        if refused is not None and refused["index"] in (0, index):
            return abort_frame(index, request[3], refused["code"])
        if "sdo_wrong_toggle" in self.shown and is_segment(request):
            return bytes([answer[0] ^ 0x10]) + answer[1:]
        return answer

    def _meant(self, fault: str, number: int) -> dict[str, Any] | None:
        """Return the options of ``fault`` if it is shown and means TPDO ``number``."""
        options = self.shown.get(fault)
        return options if options is not None and options["number"] in (0, number) else None
