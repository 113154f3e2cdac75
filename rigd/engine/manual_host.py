"""Host of a rig that is opened without a run: it is never armed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rigd.engine import messages as m
from rigd.engine.clock import monotonic_ns
from rigd.engine.player import Outcome
from rigd.engine.process_host import OPEN_S, ProcessHost
from rigd.engine.wiring import in_cycle
from rigd.model.errors import DeviceError

#: A device in the cycle says within this what became of an action.
ACT_S: Final = 15.0


class ManualHost(ProcessHost):
    """A :class:`ProcessHost` that is never armed."""

    def judge(self) -> Sequence[str]:
        """Return what keeps the open devices from being armed; proves every watchdog."""
        return self._ask(m.Judge(self._next()), OPEN_S)

    def standing(self) -> Sequence[str]:
        """Return the names of the interlocks that stand tripped."""
        return self._ask(m.Ask(self._next(), "standing"))

    def tell_loads(self) -> None:
        """Have the cycle process tell how much each link carries, as an event ``loads``."""
        self._ask(m.Ask(self._next(), "loads"))

    def act(self, device: str, action: str) -> str:
        """Do one of a device's actions while the rig stays at rest; return what it said.

        Raises:
            DeviceError: it refused, did not answer, or something else ended it.
            LinkError: it cannot be reached.
            ProtocolError: it answered nonsense.
        """
        if in_cycle(self._rig.devices[device]):
            return self._act_in_cycle(device, action)
        beside, said = self._beside, list[str]()
        if beside is None:
            raise TypeError(f"{device} does not run beside the cycle")
        outcome = self.ask(lambda: said.append(beside.act(device, action)))
        if outcome is not None:
            raise _ended(device, action, outcome)
        return said[0]

    def _check_rings(self) -> None:
        """Do nothing: nothing is recorded, a full ring only loses what nobody looked at."""

    def _act_in_cycle(self, device: str, action: str) -> str:
        serial = self._next()
        self._send(m.Act(serial, device, action))
        until_ns = monotonic_ns() + round(ACT_S * 1e9)
        outcome = self.rest_while(
            lambda: serial not in self._cycle.acted and monotonic_ns() < until_ns
        )
        acted = self._cycle.acted.pop(serial, None)
        if acted is not None and acted.error is not None:
            raise acted.error
        if acted is not None:
            return acted.said
        if outcome is not None:
            raise _ended(device, action, outcome)
        raise DeviceError(f"{device} did not {action} within {ACT_S:g} s")


def _ended(device: str, action: str, outcome: Outcome) -> DeviceError:
    return DeviceError(f"{device} did not {action}: {outcome.reason}")
