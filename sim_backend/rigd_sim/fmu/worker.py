"""The process of one FMU: sets it up, takes its steps, and answers over a socket.

``python -m rigd_sim.fmu.worker FD``: the first message is a :class:`~.messages.Setup` as
JSON. Code of the FMU runs here alone, so that a crash or an endless loop in it ends this process
and no other.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import select
import shutil
import socket
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rigd_sim.fmu.messages import FAILED, LARGEST, OK, REQUEST, STEP, Setup, Wires

#: Last messages of the FMU that are kept for an error.
KEPT: Final = 3
#: FMI 2 and 3 count a status from 0: ok, warning, discard, error, fatal.
_STATUS: Final = ("ok", "warning", "discard", "error", "fatal", "pending")
#: Calls of FMPy by type of variable, for both versions: the end of ``get...`` and ``set...``.
_CALLS: Final = {"Enumeration": {2: "Integer", 3: "Int64"}}


class Refused(Exception):
    """A call of the FMU did not end as it should."""


class Unit:
    """One instance of an FMU, between set-up and the end of its process."""

    def __init__(self, setup: Setup) -> None:
        self._major = int(setup.version.split(".", maxsplit=1)[0])
        self._said: deque[str] = deque(maxlen=KEPT)
        self._file = Path(setup.path).name
        self._step_s = setup.step_ns * 1e-9
        self._step_ns = setup.step_ns
        self._setters: list[tuple[Callable[..., Any], list[int], list[int], type]] = []
        self._getters: list[tuple[Callable[..., Any], list[int], list[int]]] = []
        self._outputs = 0
        self._fmu = self._instance(setup)
        self._initialise(setup)

    def wire(self, wires: Wires) -> None:
        """Take the variables that steps set and return, in the order of their values."""
        self._setters = [
            (self._call("set", kind), references, places, _type(kind))
            for kind, references, places in _grouped(wires.inputs)
        ]
        self._getters = [
            (self._call("get", kind), references, places)
            for kind, references, places in _grouped(wires.outputs)
        ]
        self._outputs = len(wires.outputs)

    def take(self, first: int, count: int, inputs: Sequence[float]) -> list[float]:
        """Take ``count`` steps from the step ``first`` on with ``inputs``; return the outputs."""
        at_s = first * self._step_ns * 1e-9
        if count:
            self._guard("setting inputs", at_s, self._set, inputs)
        for index in range(first, first + count):
            at_s = index * self._step_ns * 1e-9
            ended = self._guard("doStep", at_s, self._fmu.doStep, at_s, self._step_s)
            if self._major == 3 and (ended[1] or ended[2]):
                why = "asks to end the simulation" if ended[1] else "returned before its end"
                raise Refused(f"doStep at {at_s:.9g} s {why}{self._words()}")
        values: list[float] = [0.0] * self._outputs
        self._guard("reading outputs", at_s, self._get, values)
        return values

    def _set(self, inputs: Sequence[float]) -> None:
        for call, references, places, kind in self._setters:
            call(references, [kind(inputs[place]) for place in places])

    def _get(self, values: list[float]) -> None:
        for call, references, places in self._getters:
            for place, value in zip(places, call(references), strict=True):
                values[place] = float(value)

    def _instance(self, setup: Setup) -> Any:
        import fmpy

        folder = Path(setup.folder) / "unit"
        raw = Path(setup.path).read_bytes()
        if hashlib.sha256(raw).hexdigest() != setup.sha256:
            raise Refused("the file has changed since it was checked: begin again")
        try:
            fmpy.extract(setup.path, folder)
        # fmpy raises Exception itself, and what zipfile and the disk raise.
        except Exception as error:
            raise Refused(f"cannot be unpacked: {error}") from error
        description = fmpy.read_model_description(str(folder), validate=False)
        return self._guard(
            "instantiation",
            None,
            fmpy.instantiate_fmu,
            str(folder),
            description,
            "CoSimulation",
            debug_logging=setup.logging,
            logger=self._logger if self._major == 2 else self._logger_3,
            require_functions=False,
        )

    def _initialise(self, setup: Setup) -> None:
        fmu = self._fmu
        if self._major == 2:
            self._guard("setupExperiment", None, fmu.setupExperiment, startTime=0.0)
        for name, kind, reference, value in setup.start:
            self._guard(
                f"start value of {name}", None, self._call("set", kind), [reference], [value]
            )
        self._guard("enterInitializationMode", None, fmu.enterInitializationMode)
        self._guard("exitInitializationMode", None, fmu.exitInitializationMode)

    def _call(self, verb: str, kind: str) -> Callable[..., Any]:
        name = _CALLS.get(kind, {}).get(self._major, kind)
        call: Callable[..., Any] = getattr(self._fmu, verb + name)
        return call

    def _guard(
        self, what: str, at_s: float | None, call: Callable[..., Any], *given: Any, **named: Any
    ) -> Any:
        try:
            return call(*given, **named)
        # fmpy raises Exception itself for what the FMU returns, and OSError for its library.
        except Exception as error:
            status = getattr(error, "status", -1)
            end = f"returned {_STATUS[status]}" if status in range(6) else f"failed: {error}"
            when = "" if at_s is None else f" at {at_s:.9g} s"
            raise Refused(f"{what}{when} {end}{self._words()}") from error

    def _words(self) -> str:
        return f"; the FMU reports: {' | '.join(self._said)}" if self._said else ""

    def _logger(self, _c: Any, _name: Any, status: int, _category: Any, message: bytes) -> None:
        self._keep(status, message)

    def _logger_3(self, _environment: Any, status: int, _category: Any, message: bytes) -> None:
        self._keep(status, message)

    def _keep(self, status: int, message: bytes) -> None:
        if status:
            self._said.append(" ".join(message.decode("utf-8", errors="replace").split())[:300])


def _grouped(wires: Sequence[tuple[str, int]]) -> list[tuple[str, list[int], list[int]]]:
    groups: dict[str, tuple[list[int], list[int]]] = {}
    for place, (kind, reference) in enumerate(wires):
        references, places = groups.setdefault(kind, ([], []))
        references.append(reference)
        places.append(place)
    return [(kind, *group) for kind, group in groups.items()]


def _type(kind: str) -> type:
    if kind == "Boolean":
        return _Switch
    return float if kind in ("Real", "Float64", "Float32") else _Whole


class _Switch(int):
    """A Boolean input: true from 0.5 on."""

    def __new__(cls, value: float) -> _Switch:
        return super().__new__(cls, value >= 0.5)


class _Whole(int):
    """An integer input: the nearest whole number."""

    def __new__(cls, value: float) -> _Whole:
        return super().__new__(cls, round(value))


def serve(connection: socket.socket) -> None:
    """Answer requests until the other end closes."""
    unit: Unit | None = None
    while raw := connection.recv(LARGEST):
        try:
            if unit is None:
                setup = Setup(**json.loads(raw))
                unit = Unit(setup)
                _schedule(setup.priority)
                answer = OK
            elif raw[:1] != STEP:
                unit.wire(Wires(**json.loads(raw)))
                answer = OK
            else:
                begun = time.perf_counter()
                _, first, count = REQUEST.unpack_from(raw)
                inputs = [value for (value,) in struct.iter_unpack("<d", raw[REQUEST.size :])]
                values = unit.take(first, count, inputs)
                took_s = time.perf_counter() - begun
                answer = OK + struct.pack(f"<{len(values) + 1}d", took_s, *values)
        except Refused as error:
            answer = FAILED + str(error).encode()[: LARGEST - 1]
        connection.send(answer)


def _schedule(priority: int) -> None:
    """Take steps before ordinary programs, as far as the kernel permits it; 0 changes nothing."""
    if not priority:
        return
    gc.collect()
    gc.freeze()  # what the set-up has made is not looked through again
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


def _end_with(connection: socket.socket, folder: str) -> None:
    """End this process as soon as the other end is gone, also while the FMU does not return."""
    poll = select.poll()
    poll.register(connection, select.POLLHUP)
    poll.poll()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


def main() -> None:
    """Serve the socket whose number is the first argument; the second is the folder to remove."""
    connection = socket.socket(fileno=int(sys.argv[1]))
    threading.Thread(target=_end_with, args=(connection, sys.argv[2]), daemon=True).start()
    serve(connection)
    os._exit(0)  # destructors of an FMU may wait or crash


if __name__ == "__main__":
    main()
