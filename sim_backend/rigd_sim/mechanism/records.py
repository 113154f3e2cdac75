"""Defines the memory of the compiled kernel, and fills it from a mechanism.

All fields are float64 without padding, so that a C struct of doubles has the same layout. The
field names are part of the kernel's compiled signature. If a name changes, numba compiles the
kernel again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd_sim.mechanism.network import Element, Instrument, Measure, Mechanism, Warm

Rows = NDArray[np.void]
Floats = NDArray[np.float64]


def _doubles(names: str) -> np.dtype[Any]:
    return np.dtype([(name, np.float64) for name in names.split()])


#: One element; ``i j`` are its degrees of freedom, the last is the ground; ``press`` is the element
#: whose compression is its load, or -1; ``command`` its place among the commands, or -1.
ELEMENT: Final = _doubles(
    "kind i j a b offset load press command "
    "k d play low high "
    "f_c f_s v_s shape visc s_0 s_1 smooth "
    "limit rate supply resistance fastest outer"
)
#: What an element does at one instant: its force and the rate of its state z, with their
#: derivatives by strain, speed and z; ``pushed`` is the force per normal force, times which the
#: normal force changes by ``press_e`` and ``press_v``; ``power`` is dissipated.
#: The last three are for the linear system of a step.
TERM: Final = _doubles(
    "f f_e f_v f_z g g_e g_v g_z pushed press_e press_v power stored way_f z_f settled"
)
SENSOR: Final = _doubles(
    "measure index lever offset factor rate noise resolution zero low high ideal"
)
#: ``heat`` is the share of the power of each element, in an array of its own.
WARM: Final = _doubles("rise rate")
#: Filters of sensors and parts: output, and input at the last instant.
FILTER: Final = _doubles("out last keep slope")
#: One row: whether energy is counted, and what was; whether filters have begun.
TALLY: Final = _doubles("counting supplied dissipated given lost begun")


@dataclass(eq=False)
class Memory:
    """All arrays of one plant; the kernel writes those of the second half."""

    masses: Floats  #: one for each degree of freedom, then the ground
    elements: Rows
    sensors: Rows
    warm: Rows
    heat: Floats  #: shape (warm parts, elements)
    ambient: float
    commands: Floats  #: shape (drives, 2): setpoint, whether enabled

    state: Floats  #: positions and speeds, each with the ground behind it, then z of each element
    terms: Rows
    again: Rows  #: as ``terms``, within a step
    work: Floats
    filters: Rows  #: of sensors, then of warm parts
    tally: Rows
    readings: Floats  #: of sensors, then temperatures


def memory(mechanism: Mechanism, *, noise: bool) -> Memory:
    """Return the memory of a mechanism at its start; without ``noise`` sensors are ideal."""
    bodies, elements = len(mechanism.masses), len(mechanism.elements)
    drives = {item.name: number for number, item in enumerate(mechanism.drives)}
    state = np.zeros(2 * (bodies + 1) + elements)
    state[bodies + 1 : 2 * bodies + 1] = mechanism.speeds
    heat = np.zeros((len(mechanism.warm), elements))
    for row, part in zip(heat, mechanism.warm, strict=True):
        row[list(part.heated_by)] = 1.0
    sensors, warm = len(mechanism.instruments), len(mechanism.warm)
    return Memory(
        masses=np.array([*mechanism.masses, 1.0]),
        elements=_rows(ELEMENT, [_element(item, mechanism, drives) for item in mechanism.elements]),
        sensors=_rows(SENSOR, [_sensor(item, mechanism, noise) for item in mechanism.instruments]),
        warm=_rows(WARM, [_warm(item) for item in mechanism.warm]),
        heat=heat,
        ambient=mechanism.ambient,
        commands=np.zeros((max(1, len(drives)), 2)),
        state=state,
        terms=np.zeros(elements, TERM),
        again=np.zeros(elements, TERM),
        work=np.zeros((6, 2 * (bodies + 1) + elements + (bodies + 1) ** 2)),
        filters=np.zeros(sensors + warm, FILTER),
        tally=np.zeros(1, TALLY),
        readings=np.zeros(max(1, sensors + warm)),
    )


def _rows(dtype: np.dtype[Any], rows: list[dict[str, float]]) -> Rows:
    table = np.zeros(len(rows), dtype)
    for number, row in enumerate(rows):
        for name, value in row.items():
            table[number][name] = value
    return table


def _element(item: Element, mechanism: Mechanism, drives: dict[str, int]) -> dict[str, float]:
    ground = len(mechanism.masses)
    first = item.ends[0]
    second = item.ends[1] if len(item.ends) > 1 else None
    numbers = dict(item.numbers)
    return {
        "kind": float(item.kind),
        "i": float(first.dof),
        "a": first.lever,
        "j": float(ground if second is None else second.dof),
        "b": 0.0 if second is None else second.lever,
        "offset": item.offset,
        "load": item.load,
        "press": float(mechanism.index[item.pressed_by]) if item.pressed_by else -1.0,
        "command": float(drives.get(item.name, -1)),
        **numbers,
    }


def _sensor(item: Instrument, mechanism: Mechanism, noise: bool) -> dict[str, float]:
    index, lever, offset = float(item.index), 1.0, 0.0
    if item.measure in (Measure.POSITION, Measure.SPEED):
        axis = list(mechanism.axes.values())[item.index]
        index, lever = float(axis.dof), axis.factor
        offset = axis.start if item.measure == Measure.POSITION else 0.0
    return {
        "measure": float(item.measure),
        "index": index,
        "lever": lever,
        "offset": offset,
        "factor": item.factor,
        "rate": 2 * math.pi * item.bandwidth,
        "noise": item.noise * noise,
        "resolution": item.resolution * noise,
        "zero": item.zero * noise,
        "low": item.low,
        "high": item.high,
        "ideal": float(not noise),
    }


def _warm(item: Warm) -> dict[str, float]:
    return {"rise": item.rise, "rate": item.rate}
