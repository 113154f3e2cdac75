"""Compiles the steps of a procedure file that inject faults."""

from __future__ import annotations

from rigd.config.document import Path_
from rigd.config.rig import RigConfig
from rigd.procedure.expression import Scope
from rigd.procedure.program import Fault
from rigd.procedure.reader import Reader
from rigd.procedure.source import FaultSource


def read_fault(
    reader: Reader, path: Path_, source: FaultSource, scope: Scope, rig: RigConfig
) -> Fault:
    """Return the fault that stands at ``path``; problems are noted.

    Which devices and faults there are, the simulation knows: they are looked at in preflight.
    """
    if rig.simulation is None:
        reader.note_key(
            (*path, "fault"),
            f"the devices of the rig {rig.name} are not simulated at the wire: "
            "they show no faults when told to",
            "remove the step, or take a rig with `simulation:`, such as wire-1",
        )
    shown = source.fault
    after_s = reader.time((*path, "fault", "after"), shown.after, scope)
    for_s = reader.time((*path, "fault", "for"), shown.lasting, scope)
    options = {name: _plain(text) for name, text in shown.options.items()}
    return Fault(shown.part, shown.fault, after_s or 0.0, for_s, options)


def _plain(text: str) -> int | float | bool | str:
    """Return a scalar of a file as YAML 1.2 has it: whole number, number, truth value, or text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (lambda: int(text, 0), lambda: float(text)):
        try:
            return kind()
        except ValueError:
            continue
    return text
