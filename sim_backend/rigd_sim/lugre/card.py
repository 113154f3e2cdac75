"""Connects the simulated LuGre rig to a simulated card, as in ``configs/card_lugre.yaml``.

| pin | wired to |
|---|---|
| DA0, DA1, DA2 | set values: wheel current, longitudinal and lateral belt speed |
| AI0, AI1, AI2, AI3 | current monitor, accelerometer, speed monitors of the two belts |
| AI7 | 5 V |
| IRC0, IRC1, IRC2, IRC3 | wheel motor, guide, longitudinal belt, bridge |
| DOUT0, DOUT1, DOUT3 | enable of wheel, longitudinal and lateral belt, through the one-shot |
| DOUT2, DOUT4 | release of the clutches |
| DOUT7 | trigger of the one-shot |
| DIN0, DIN1, DIN2, DIN7 | ready of the three drives, output of the one-shot |

Without a one-shot, DOUT7 is wired to DIN7 and the enable lines to the drives, as for a card with a
watchdog of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from rigd.sdk import LinkError
from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import FLOORS, LugreConfig, LugrePlant
from rigd_sim.wire.cards.analog_drives import AnalogDrive, OneShot
from rigd_sim.wire.cards.mf624_registers import Mf624Registers, Wires

WHEEL_A_PER_V: Final = 0.2
BELT_M_S_PER_V: Final = 0.25
BRIDGE_M_S_PER_V: Final = 0.08
MONITOR_M_S_PER_V: Final = 0.5
M_PER_COUNT: Final = 10e-6
REFERENCE_V: Final = 5.0
ONE_SHOT_S: Final = 0.2  #: nominal

_TRIGGER_LINE: Final = 7
_CLUTCHES: Final = {"belt": 2, "bridge": 4}
_ENABLES: Final = {"wheel": 0, "belt": 1, "bridge": 3}
_MOTOR_CURRENT: Final = [name for name, _, _ in layout.TRUTH].index("motor_current")
#: Between two reads of the wires within this time the physics does not advance.
_STILL_NS: Final = 50_000


class LugreWiring:
    """The LuGre rig as it is wired to the card.

    The plant is brought to ``clock_ns`` before the card reads. The server of the card calls
    :meth:`advance` too, so that the one-shot acts when no master reads.

    Args:
        plant: the rig; all its commands are the card's.
        clock_ns: the time of plant and one-shot.
        one_shot_s: how long the one-shot stays up; None: there is none.
        advance: brings the plant to a time; that of a plant which other devices read too.

    """

    faults: Mapping[str, str] = {
        "drive_fault": "a drive reports a fault and drives nothing (drive: wheel, belt, bridge)",
        "one_shot_dead": "the one-shot stays up for ever",
    }

    def __init__(
        self,
        plant: LugrePlant,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        *,
        one_shot_s: float | None = ONE_SHOT_S,
        advance: Callable[[int], object] | None = None,
    ) -> None:
        self._plant = plant
        self._clock_ns = clock_ns
        self._advance = plant.advance if advance is None else advance
        self._advanced_ns = clock_ns()
        self._advance(self._advanced_ns)
        self.one_shot = None if one_shot_s is None else OneShot(one_shot_s, clock_ns)
        if self.one_shot is None:
            self.faults = {"drive_fault": self.faults["drive_fault"]}
        self._level = False  # of the line that triggers it, or is wired back
        self.drives = {
            "wheel": AnalogDrive(WHEEL_A_PER_V, self.one_shot),
            "belt": AnalogDrive(BELT_M_S_PER_V, self.one_shot),
            "bridge": AnalogDrive(BRIDGE_M_S_PER_V, self.one_shot),
        }
        self._released = dict.fromkeys(_CLUTCHES, False)
        self.safe_since_ns = self._advanced_ns  #: since when no drive is enabled; 0: one is
        self._command()

    def wires(self) -> Wires:
        """Return the card's side."""
        return Wires(
            volts_in={
                0: self._reading(layout.CURRENT_VOLTS),
                1: self._reading(layout.ACCELERATION_VOLTS),
                2: self._reading(layout.BELT_READINGS + 1, 1 / MONITOR_M_S_PER_V),
                3: self._reading(layout.BRIDGE_READINGS + 1, 1 / MONITOR_M_S_PER_V),
                7: lambda: REFERENCE_V,
            },
            volts_out=dict(enumerate(drive.set_volts for drive in self.drives.values())),
            counts_in={
                0: self._counts(layout.MOTOR_COUNTS),
                1: self._counts(layout.GUIDE_COUNTS),
                2: self._counts(layout.BELT_READINGS, 1 / M_PER_COUNT),
                3: self._counts(layout.BRIDGE_READINGS, 1 / M_PER_COUNT),
            },
            lines_in=self._lines_in,
            lines_out=self._lines_out,
            advance=self.advance,
        )

    def advance(self) -> None:
        """Bring the plant to now, under what the drives ask for now."""
        now = self._clock_ns()
        if now - self._advanced_ns >= _STILL_NS:
            self._command()
            self._advance(now)
            self._advanced_ns = now

    def state(self) -> Mapping[str, float | int | bool | str]:
        """Return what the drives do, and since when none is enabled (CLOCK_MONOTONIC, ns)."""
        self._command()  # the one-shot may have dropped since
        shown: dict[str, float | int | bool | str] = {
            "enabled": any(drive.enabled for drive in self.drives.values()),
            "safe_since_ns": self.safe_since_ns,
            "one_shot": self._up,
            "current": self._plant.readings[layout.TRUTH_READINGS + _MOTOR_CURRENT],
        }
        for name, drive in self.drives.items():
            shown |= {f"{name}_enabled": drive.enabled, f"{name}_demand": drive.demand}
        return shown

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the drives or of the one-shot.

        Raises:
            ValueError: there is no such fault or drive.

        """
        if fault == "one_shot_dead" and not options and self.one_shot is not None:
            self.one_shot.dead = True
        elif (
            fault == "drive_fault" and set(options) == {"drive"} and options["drive"] in self.drives
        ):
            self.drives[options["drive"]].faulty = True
        else:
            raise ValueError(
                f"fault {fault!r} with {options} is not known; "
                + "; ".join(f"{name}: {doc}" for name, doc in self.faults.items())
            )

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        if fault in (None, "one_shot_dead") and self.one_shot is not None:
            self.one_shot.dead = False
        if fault in (None, "drive_fault"):
            for drive in self.drives.values():
                drive.faulty = False

    def _command(self) -> None:
        """Hand the plant what the drives do; a belt that is not enabled is braked."""
        commands, drives = self._plant.commands, self.drives
        commands[layout.WHEEL_ENABLED] = float(drives["wheel"].enabled)
        commands[layout.WHEEL_CURRENT] = drives["wheel"].demand
        for name, first in (("belt", layout.BELT_COMMANDS), ("bridge", layout.LATERAL_COMMANDS)):
            released = self._released[name] and drives[name].enabled
            commands[first] = drives[name].demand
            commands[first + 1] = float(not released)
        if any(drive.enabled for drive in drives.values()):
            self.safe_since_ns = 0
        elif self.safe_since_ns == 0:
            self.safe_since_ns = self._clock_ns()

    def _lines_out(self, lines: int) -> None:
        self._level = bool(lines >> _TRIGGER_LINE & 1)
        if self.one_shot is not None:
            self.one_shot.trigger(level=self._level)
        for name, line in _ENABLES.items():
            self.drives[name].set_line(high=bool(lines >> line & 1))
        for name, line in _CLUTCHES.items():
            self._released[name] = bool(lines >> line & 1)
        self._command()

    def _lines_in(self) -> int:
        ready = sum((not drive.faulty) << line for line, drive in enumerate(self.drives.values()))
        return ready | self._up << 7

    @property
    def _up(self) -> bool:
        return self._level if self.one_shot is None else self.one_shot.up

    def _reading(self, index: int, factor: float = 1.0) -> Callable[[], float]:
        plant = self._plant
        return lambda: plant.readings[index] * factor

    def _counts(self, index: int, factor: float = 1.0) -> Callable[[], int]:
        plant = self._plant
        return lambda: round(plant.readings[index] * factor)


def open_registers(resource: str) -> Mf624Registers:
    """Return a card in this process, on a plant of its own that follows the wall clock.

    Named in a rig file as ``{type: mf624, options: {interface: lugre, resource: FLOOR}}``.

    Raises:
        LinkError: there is no such floor.

    """
    if resource not in FLOORS:
        raise LinkError(
            f"no floor {resource!r} to stand on",
            hint=f"'resource' of this card is one of {', '.join(FLOORS)}",
        )
    options: dict[str, Any] = {"floor": resource}
    plant = LugrePlant(LugreConfig(**options), period_ns=1_000_000, seed=1)
    return Mf624Registers(LugreWiring(plant).wires())
