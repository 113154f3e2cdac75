"""Recordings of the approach-angle rig, written by the real recorder from simulated runs.

They look like those of a campaign (streams, events, plan, calibration), without the time that an
engine would take; each fault of a recording can be made here.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from support.approach_angle.headless import SimulatedRun, simulate
from support.approach_angle.runs import TABLE_1

from rigd.model.channels import STALE, Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter
from rigd.record.mcap.prefix import Attachment

START_NS: Final = 1_790_000_000_000_000_000
RATE_HZ: Final = 9600.0
#: From one trial to the next, and from a trial's start to the relay command, in s.
TRIAL_S: Final = 4.0
COMMAND_S: Final = 1.5
SIGNALS: Final = {
    "gauge_a": "daq.gauge_a_raw",
    "gauge_b": "daq.gauge_b_raw",
    "wheel_angle": "daq.wheel_angle_raw",
    "platform_position": "daq.platform_position_raw",
    "relay": "relay.closed",
    "load": "scale.mass",
}
CONSTANTS: Final[dict[str, float | str]] = {
    "angle": "angle", "wheel_radius": 0.05, "wheel_inertia": 4e-4, "platform_mass": 3.0,
    "gravity": 9.81,
}  # fmt: skip
_INPUTS: Final = (
    ("gauge_a", "1"), ("gauge_b", "1"), ("wheel_angle", "rad"), ("platform_position", "m"),
)  # fmt: skip
DAQ: Final = Stream(
    "daq",
    (
        *(
            channel
            for name, unit in _INPUTS
            for channel in (Channel(name, unit), Channel(f"{name}_raw", "V", raw_of=name))
        ),
        Channel("device_time", "s"),
        Channel("clock_rate", "Hz"),
    ),
    has_status=True,
)
RELAY: Final = Stream("relay", (Channel("closed"), Channel("closed_setpoint")))
SCALE: Final = Stream("scale", (Channel("mass", "kg"),), has_status=True)
STABLE: Final = 1

Rows = NDArray[np.void]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Recorded:
    """A run as one trial of a campaign, and what its recording reports."""

    run: SimulatedRun
    repeat: int = 1
    complete: bool = True
    reason: str = ""
    stable: bool = True
    stale: bool = False  #: one row of the card and one of the scale are no new ones
    rails: int = 0  #: status bits of the card in ``rail_rows``, ten samples
    rail_rows: tuple[int, int | None] = (1000, 1010)
    driven: bool = True
    stopped: bool = True
    again: bool = False  #: the relay closes once more, 0.1 s behind the stop
    card_s: Callable[[FloatArray], FloatArray] = np.copy  #: time to what the card's clock shows
    answers: tuple[Mapping[str, Any], ...] = ()  #: of events


def calibration_text(values: Mapping[str, tuple[str, str]], rig: str = "case") -> str:
    """Return a calibration file of ``rig`` with ``values``: each with unit, and its uncertainty."""
    entries = "".join(
        f"  {name}:\n    value: {value}\n    u: {u}\n    source: assumed\n"
        "    from: tests\n    made: 2026-11-21\n    operator: tests\n"
        for name, (value, u) in values.items()
    )
    return f"calibration: bench\nrigs: [{rig}]\nvalues:\n{entries}"


def calibration_of(run: SimulatedRun, *, torque: float = 1.0, rig: str = "angle-1") -> str:
    """Return a calibration file for the rig of ``run``; ``torque`` makes its torque scale wrong."""
    values = {
        "load_scale": ("1", "0.002"),
        "effective_radius": ("0.995", "0.002"),
        "bearing_constant": ("0.012 N m", "0.0015 N m"),
        "bearing_viscous": ("2e-4 N m s/rad", "5e-5 N m s/rad"),
        "bearing_load": ("1e-4 N m/N", "2e-5 N m/N"),
        "rolling_resistance": ("0.006", "0.001"),
        "roller_drag": ("0.05", "0.01"),
        "rail_constant": ("0.6 N", "0.1 N"),
        "rail_load": ("0.01", "0.002"),
        "rail_viscous": ("0.3 N s/m", "0.1 N s/m"),
        "torque_scale": (f"{torque * run.torque_scale:.9g} N m/V", "0.005 N m/V"),
        "wheel_scale": (f"{run.wheel_scale:.9g} rad/V", "0.025 rad/V"),
        "platform_scale": (f"{run.platform_scale:.9g} m/V", "4e-4 m/V"),
    }
    return calibration_text(values, rig)


@cache
def small_campaign() -> tuple[Recorded, ...]:
    """Return 24 runs: four sets at 4 kg, three voltages at which all of them slide."""
    points = [
        (name, voltage, repeat)
        for name in ("clean_0", "clean_15", "clean_45", "coated_0")
        for voltage in (7.0, 8.5, 10.0)
        for repeat in (1, 2)
    ]
    return tuple(
        Recorded(simulate(name, 4.0, voltage, seed=seed), repeat)
        for seed, (name, voltage, repeat) in enumerate(points, start=1)
    )


def write_campaign(
    path: Path,
    trials: Sequence[Recorded],
    *,
    calibration: str | None,
    state: str = "complete",
    numbers: Sequence[int] | None = None,
    signals: Mapping[str, str] = SIGNALS,
) -> Path:
    """Write ``trials`` as the recording of a run that played them one after the other.

    Without ``state`` the run has no end. ``numbers`` are those of the trials, from 1 by default.
    """
    plan = {
        "model": "approach-angle",
        "signals": json.dumps(dict(signals)),
        "constants": json.dumps(CONSTANTS),
        "group_by": json.dumps(["set"]),
        "reference": json.dumps({f"{name}.maximum": mu for name, mu in TABLE_1.items()}),
        "reference_label": "Table 1 of the paper",
    }
    run = {"procedure": "approach_angles", "rig": "angle-1", "seed": "1", "trials": "200"}
    attached = (
        ()
        if calibration is None
        else (Attachment("calibration.yaml", "application/yaml", calibration.encode()),)
    )
    with RecordingWriter.create(
        path,
        streams=[DAQ, RELAY, SCALE],
        metadata={"run": run, "parameters": {}, "identify": plan},
        attachments=attached,
        start_ns=START_NS,
        sync_interval_s=None,
    ) as writer:
        writer.event(START_NS, "run_start", -1, {"procedure": "approach_angles"})
        numbered = numbers or range(1, len(trials) + 1)
        for index, (number, item) in enumerate(zip(numbered, trials, strict=True)):
            _write_trial(writer, number, START_NS + round(index * TRIAL_S * 1e9), item)
        end = START_NS + round(len(trials) * TRIAL_S * 1e9)
        if state:
            writer.event(end, "run_end", -1, {"state": state, "reason": "all trials played"})
    return path


def _write_trial(writer: RecordingWriter, number: int, begin_ns: int, recorded: Recorded) -> None:
    run, command_ns = recorded.run, begin_ns + round(COMMAND_S * 1e9)
    parameters = {
        "set": run.set_name,
        "load": run.announced_load_kg,
        "voltage": run.voltage_v,
        "angle": run.alpha_rad,
        "wheel": run.set_name.partition("_")[0],
    }
    writer.event(
        begin_ns, "trial_start", number,
        {
            "number": number, "repeat": recorded.repeat, "parameters": parameters,
            "units": {"load": "kg", "voltage": "V", "angle": "deg"},
        },
    )  # fmt: skip
    for answer in recorded.answers:
        writer.event(begin_ns + 1, "answer", number, answer)
    writer.write("scale", _scale_rows(recorded, begin_ns, command_ns))
    writer.write("relay", _relay_rows(recorded, begin_ns, command_ns))
    writer.write("daq", _daq_rows(recorded, command_ns))
    end = {"complete": recorded.complete, "reason": recorded.reason}
    writer.event(begin_ns + round((TRIAL_S - 0.5) * 1e9), "trial_end", number, end)


def _daq_rows(recorded: Recorded, command_ns: int) -> Rows:
    run = recorded.run
    rows = np.zeros(len(run.t_s), row_dtype(DAQ))
    times_ns = np.rint(run.t_s * 1e9).astype(np.int64)
    # rigd's own time of a row moves a little from block to block; the card's does not.
    rows["t_ns"] = command_ns + times_ns + 20_000 * ((np.arange(len(rows)) // 96) % 3 - 1)
    for name, volts in (
        ("gauge_a", run.gauge_a_v),
        ("gauge_b", run.gauge_b_v),
        ("wheel_angle", run.wheel_v),
        ("platform_position", run.platform_v),
    ):
        rows[f"{name}_raw"] = volts
    rows["device_time"] = 17.0 + recorded.card_s(run.t_s)
    rows["clock_rate"] = RATE_HZ
    rows["status"][slice(*recorded.rail_rows)] = recorded.rails
    if recorded.stale:
        rows["gauge_a_raw"][500], rows["status"][500] = 7.0, STALE
    return rows


def _relay_rows(recorded: Recorded, begin_ns: int, command_ns: int) -> Rows:
    count = round((TRIAL_S - 0.5) * 1000)
    rows = np.zeros(count, row_dtype(RELAY))
    rows["t_ns"] = begin_ns + np.arange(count) * 1_000_000
    since_s = (rows["t_ns"] - command_ns) * 1e-9
    closed = (since_s >= 0.0) & ((since_s < recorded.run.stop_s) | (not recorded.stopped))
    closed |= recorded.again & (np.abs(since_s - recorded.run.stop_s - 0.2) < 0.1)
    rows["closed_setpoint"] = closed & recorded.driven
    return rows


def _scale_rows(recorded: Recorded, begin_ns: int, command_ns: int) -> Rows:
    """Readings at 4 Hz: those of the weights before, a while of unrest, then what stands there."""
    times_ns = np.arange(begin_ns, command_ns, 250_000_000)
    rows = np.zeros(len(times_ns), row_dtype(SCALE))
    rows["t_ns"] = times_ns
    rows["mass"] = recorded.run.scale_kg
    rows["mass"][:2] = 2.0
    rows["status"] = STABLE
    rows["status"][2] = 0
    if not recorded.stable:
        rows["status"] = 0
    if recorded.stale:
        rows["mass"][-2], rows["status"][-2] = 7.0, STALE | STABLE
    return rows
