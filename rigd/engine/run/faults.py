"""Makes the simulated devices of a rig show the faults that a procedure asks for.

The faults end with the run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from rigd.config.problems import suggest
from rigd.model.errors import LinkError
from rigd.procedure.program import CompiledProcedure, Fault

#: ``ask(request)``: see :meth:`rigd.sdk.Simulation.ask`.
Ask = Callable[[Mapping[str, Any]], Mapping[str, Any]]


class ShownFaults:
    """Starts and ends the faults of one run through ``ask``, a request to the simulation."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._shown: list[Fault] = []

    def unknown(self, procedure: CompiledProcedure) -> Sequence[str]:
        """Return the faults of ``procedure`` that the simulation cannot show, one sentence each."""
        wanted = [step for step in procedure.steps() if isinstance(step, Fault)]
        if not wanted:
            return ()
        try:
            parts: Mapping[str, Mapping[str, str]] = self._ask({"do": "faults"})["parts"]
        except (LinkError, ValueError) as error:
            return [f"the faults of the procedure cannot be shown: {error}"]
        reasons = []
        for item in wanted:
            if item.part not in parts:
                hint = suggest(item.part, parts)
                reasons.append(
                    f"the simulation has no device {item.part!r} that could fail: {hint}"
                )
            elif item.fault not in parts[item.part]:
                hint = suggest(item.fault, parts[item.part])
                reasons.append(f"{item.part} cannot show the fault {item.fault!r}: {hint}")
        return reasons

    def show(self, fault: Fault) -> None:
        """Show ``fault`` in the simulation.

        Raises:
            ValueError: the simulation cannot show it; the message gives the reason.
        """
        try:
            self._ask(
                {
                    "do": "fault",
                    "part": fault.part,
                    "fault": fault.fault,
                    "options": dict(fault.options),
                    "after_s": fault.after_s,
                    "for_s": fault.for_s,
                }
            )
        except LinkError as error:
            raise ValueError(f"the simulation does not answer: {error}") from error
        self._shown.append(fault)

    def clear(self) -> None:
        """End every fault, also those that have not begun yet."""
        with suppress(LinkError):  # a simulation that has ended shows no faults
            while self._shown:
                fault = self._shown.pop()
                self._ask({"do": "clear", "part": fault.part, "fault": fault.fault})
