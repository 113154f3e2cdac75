"""Simulates one run of the approach-angle rig without rigd's engine.

The result has the raw volts of the sensors and the true values beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition, Samples
from rigd_sim.approach_angle.parameters import AngleParameters
from rigd_sim.approach_angle.plant import AngleConfig, AnglePlant

FloatArray = NDArray[np.float64]

#: What a procedure does around a run: how long the scale settles before the relay closes, the
#: samples kept before the command and after the stop, the watchdog, in s; and where it stops.
SETTLE_S: Final = 5.0
PRE_S: Final = 0.1
POST_S: Final = 0.05
WATCHDOG_S: Final = 1.5
WHEEL_STOP_RAD: Final = 50.0
#: Samples whose median decides on the stop, so that no single one does.
NEWEST: Final = 5


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """Raw volts of shape (n,) over the time since the relay's command, and the true values.

    ``truth`` has the columns of ``layout.TRUTH`` by name, at the times of the samples.
    """

    set_name: str
    alpha_rad: float
    announced_load_kg: float
    voltage_v: float
    t_s: FloatArray
    gauge_a_v: FloatArray
    gauge_b_v: FloatArray
    wheel_v: FloatArray
    platform_v: FloatArray
    normal_force_v: FloatArray | None
    stop_s: float  #: of the command to stop
    watchdog: bool  #: stopped by the watchdog
    scale_kg: float  #: what the scale showed before the start; NaN if it showed nothing
    scale_stable: bool
    truth: dict[str, FloatArray]
    #: N m per V of (gauge a - gauge b), as a calibration with the arm's nominal length finds it.
    torque_scale: float
    wheel_scale: float  #: nominal rad per V
    platform_scale: float  #: nominal m per V
    normal_force_scale: float  #: nominal N per V of the load cell
    normal_force_zero_v: float  #: true V of the load cell at 0 N

    def window(self, start_s: float, end_s: float) -> NDArray[np.bool_]:
        """Return which samples lie from ``start_s`` to ``end_s``."""
        return (self.t_s >= start_s) & (self.t_s <= end_s)

    def true_mu(self, start_s: float, end_s: float) -> float:
        """Return mean F_r over mean N from ``start_s`` to ``end_s``."""
        at = self.window(start_s, end_s)
        return float(self.truth["rolling_force"][at].mean() / self.truth["normal_force"][at].mean())


def simulate(
    set_name: str = "clean_0",
    load_kg: float = 4.0,
    voltage_v: float = 10.0,
    *,
    seed: int = 0,
    individual: int = 1,
    noise: bool = True,
    drag: bool = True,
    rubbing_nm: float = 0.0,
    fault: str = "none",
    load_cell: bool = False,
    block: int = 96,
    latency_s: float = 8e-3,
    jitter_s: float = 3e-3,
    parameters: AngleParameters | None = None,
) -> SimulatedRun:
    """Set up the rig, drive to the stop, and return what the card and the scale gave.

    The stop acts on the newest block: on the median of its last samples, at the time at which the
    block can be had. ``seed`` gives noise and the scatter of load and surface, ``individual`` the
    rig; ``parameters`` are the shipped ones, if they are not given.

    Raises:
        ValueError: no such set or fault, or a load or voltage that cannot be.

    """
    if set_name not in layout.SETS:
        raise ValueError(f"no set {set_name!r}; one of {', '.join(layout.SETS)}")
    degrees, wheel = layout.SETS[set_name]
    config = AngleConfig.model_construct(individual=individual, noise=noise, drag=drag)
    plant = AnglePlant(
        config, period_ns=1_000_000, seed=seed, parameters=parameters or _shipped_parameters()
    )
    plant.change("angle", math.radians(degrees))
    plant.change("wheel", wheel)
    plant.change("load", load_kg)
    plant.change("voltage", voltage_v)
    plant.change("rubbing", rubbing_nm)
    plant.change("fault", fault)

    plant.advance(0)
    plant.advance(round((SETTLE_S - PRE_S) * 1e9))
    card = Acquisition(
        plant, start_ns=plant.now_ns, block=block, load_cell=load_cell,
        latency_s=latency_s, jitter_s=jitter_s,
    )  # fmt: skip
    plant.advance(round(SETTLE_S * 1e9))
    drive = _drive(plant, card)
    return _recorded(plant, drive, set_name, load_kg, voltage_v)


@dataclass(frozen=True, eq=False)
class _Drive:
    """What was seen of a run, and when the relay was commanded, on the plant's clock."""

    times_ns: NDArray[np.int64]
    volts: FloatArray
    command_ns: int
    stop_ns: int
    watchdog: bool
    scale: tuple[float, int]


def _drive(plant: AnglePlant, card: Acquisition) -> _Drive:
    """Close the relay now, open it at the stop, and go on until the record is complete."""
    scale, command_ns = plant.scale(), plant.now_ns
    watchdog_ns = command_ns + round(WATCHDOG_S * 1e9)
    plant.command(True)
    blocks = [card.read_due()]
    while not (arrived := _at_stop(plant, blocks[-1].volts)) and card.due_ns < watchdog_ns:
        blocks.append(card.read_due())
    if not arrived:
        plant.advance(watchdog_ns)
    stop_ns = plant.now_ns
    plant.command(False)
    end_ns = stop_ns + round(POST_S * 1e9)
    while card.times_ns(blocks[-1])[-1] < end_ns:
        blocks.append(card.read_due())
    whole = Samples(blocks[0].first, np.concatenate([block.volts for block in blocks]))
    times_ns = card.times_ns(whole)
    count = int(np.searchsorted(times_ns, end_ns, side="right"))
    return _Drive(times_ns[:count], whole.volts[:count], command_ns, stop_ns, not arrived, scale)


def _recorded(
    plant: AnglePlant, drive: _Drive, set_name: str, load_kg: float, voltage_v: float
) -> SimulatedRun:
    """Return the run with the truth at its samples, which the plant still remembers."""
    volts = drive.volts
    steps = (drive.times_ns - plant.origin_ns) * layout.STEPS_PER_S / 1e9
    rows = np.rint(steps).astype(np.int64) % layout.HISTORY_ROWS
    truth = plant.history[rows, layout.FIRST_TRUTH :]
    pots, cell = plant.parameters.potentiometers, plant.parameters.load_cell
    mass_kg, status = drive.scale
    return SimulatedRun(
        set_name=set_name,
        alpha_rad=math.radians(layout.SETS[set_name][0]),
        announced_load_kg=load_kg,
        voltage_v=voltage_v,
        t_s=(drive.times_ns - drive.command_ns).astype(np.float64) * 1e-9,
        gauge_a_v=volts[:, 0].copy(),
        gauge_b_v=volts[:, 1].copy(),
        wheel_v=volts[:, 2].copy(),
        platform_v=volts[:, 3].copy(),
        normal_force_v=volts[:, 4].copy() if volts.shape[1] > 4 else None,
        stop_s=(drive.stop_ns - drive.command_ns) * 1e-9,
        watchdog=drive.watchdog,
        scale_kg=mass_kg,
        scale_stable=status == layout.STABLE,
        truth={name: truth[:, k].copy() for k, (name, _, _) in enumerate(layout.TRUTH)},
        torque_scale=plant.torque_scale,
        wheel_scale=1 / pots.volts_per_rad,
        platform_scale=pots.pulley / pots.volts_per_rad,
        normal_force_scale=1 / cell.sensitivity,
        normal_force_zero_v=plant.individual.load_cell_zero_v,
    )


@cache
def _shipped_parameters() -> AngleParameters:
    parameters: AngleParameters = AngleConfig().read_parameters()
    return parameters


def _at_stop(plant: AnglePlant, volts: FloatArray) -> bool:
    """Return whether the newest samples show the platform, or the wheel's turns, at their end."""
    wheel_v, platform_v = np.median(volts[-NEWEST:, 2:4], axis=0)
    pots = plant.parameters.potentiometers
    travel_m = platform_v / pots.volts_per_rad * pots.pulley - pots.platform_start
    angle_rad = wheel_v / pots.volts_per_rad - pots.wheel_start
    return bool(travel_m > plant.parameters.platform.stop or angle_rad > WHEEL_STOP_RAD)
