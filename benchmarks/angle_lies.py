"""Faults and lies in three sizes on whole campaigns of the approach-angle rig: is each one seen?

    python benchmarks/angle_lies.py --table lies.jsonl
                        continues the table: stop it and start it as you like
    python benchmarks/angle_lies.py --rigs 2 --only gain
                        fewer rigs, kinds whose name holds the word
    python benchmarks/angle_lies.py --world foreign --table foreign.jsonl
                        of another simulator (angle_world.py), with a table of its own
    python benchmarks/angle_lies.py --runs 200 --world foreign --table whole.jsonl
                        campaigns of so many runs: 24, 40, 100 or 200
    python benchmarks/angle_lies.py --runs 200 --middle --world foreign --table whole.jsonl
                        the middle size of each kind alone
    python benchmarks/angle_lies.py --good 200 --world foreign --table good.jsonl
                        good campaigns alone, so many

Each rig is another individual with hidden parameters (drags, contact, rise of the load, noise, all
drawn), calibrated to what a calibration knows of it. A campaign is three sets under four loads at
the two highest voltages, 24 runs, or another of ``DESIGNS``. A fault is put into all its runs. It
counts if it moves a maximum from the truth by more than the U that the good campaign has; it is
then seen if the interval that is reported holds the truth, or if something is named that the good
campaign has not: a shared error, a warning, a run that is left out or marked, a maximum that is
refused. How many of the published maxima hold the truth is counted whatever is named. If a table
has campaigns of several numbers of runs, the same maxima of the same rigs and faults are compared:
more runs are not to be worse than fewer.

The plant is rigd's own, or with `--world foreign` one written from the physics text alone, with
another integration scheme, friction law, normal force, noise and sensors; there the kinds go round
the rigs, so that each rig has some of them. The analysis shares no code with either.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one core, set before numpy counts them

import angle_world
import numpy as np
from figures import at_least, at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.approach_angle.headless import simulate
from support.approach_angle.plant import shipped, varied
from support.approach_angle.runs import drawn_rig, known_run

from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.raw.run_data import FloatArray, KnownRun
from rigd_analyses.approach_angle.result import CampaignResult
from rigd_sim.approach_angle.parameters import AngleParameters

Row = dict[str, Any]
Runs = list[KnownRun]
#: Rig, kind and size; the kind is "good" without a fault.
Case = tuple[int, str, float]
Fault = Callable[[Runs, float], Runs]

LOADS_KG = (4.0, 5.0, 6.0, 8.0)
ALL_SETS = ("clean_0", "clean_15", "clean_30", "clean_45", "coated_0")
ALL_VOLTAGES_V = (4.0, 5.5, 7.0, 8.5, 10.0)
#: Sets and voltages of a campaign, by the number of its runs; 200 are those of approach_angles.
DESIGNS = {
    24: (("clean_0", "clean_15", "clean_45"), (8.5, 10.0)),
    40: (("clean_0", "clean_45"), ALL_VOLTAGES_V),
    100: (ALL_SETS, ALL_VOLTAGES_V),
    200: (ALL_SETS, tuple(v for v in ALL_VOLTAGES_V for _ in range(2))),
}
VOLTS_PER_USTRAIN = 0.02
BLOCK = 96


def hidden(number: int) -> AngleParameters:
    """Return parameters that the analysis does not know: drawn about the shipped ones."""
    rng = np.random.default_rng(7000 + number)

    def about(value: float, spread: float) -> float:
        return value * float(np.exp(spread * rng.standard_normal()))

    p = shipped()
    return varied(
        normal_force={
            "tilting": 0.02 * float(rng.uniform(0.0, 2.0)),
            "relaxation": 0.01 * float(rng.uniform(0.0, 2.0)),
        },
        contact={
            "peak_speed": about(p.contact.peak_speed, 0.25),
            "hump": about(p.contact.hump, 0.25),
            "breakaway": about(p.contact.breakaway, 0.3),
            "scatter": 0.015 * float(rng.uniform(0.5, 1.6)),
        },
        gauges={"noise": about(p.gauges.noise, 0.3), "hum": about(p.gauges.hum, 0.3)},
    )


def cells_of(count: int) -> list[tuple[str, float, float]]:
    """Return set, load in kg and voltage in V of each run of a campaign of ``count``."""
    sets, voltages_v = DESIGNS[count]
    return [(name, load, v) for name in sets for load in LOADS_KG for v in voltages_v]


def campaign(world: str, number: int, count: int, profile_m: float | None = None) -> Runs:
    """Return the ``count`` runs of one rig."""
    if world == "foreign":
        return angle_world.campaign(number, cells_of(count), profile_m)
    parameters = hidden(number)
    if profile_m is not None:
        normal = parameters.normal_force.model_copy(update={"profile_rollers": profile_m})
        parameters = parameters.model_copy(update={"normal_force": normal})
    rig = drawn_rig(900 + number)
    runs: Runs = []
    for name, load, voltage in cells_of(count):
        seed = 10_000 * number + len(runs) + 1
        done = simulate(name, load, voltage, seed=seed, individual=number, parameters=parameters)
        runs.append(known_run(done, rig, 1, len(runs) + 1))
    return runs


def each(change: Callable[[KnownRun, float, int], KnownRun]) -> Fault:
    """Return the fault that ``change`` makes of every run, with its size and its place from 0."""
    return lambda runs, size: [change(item, size, k) for k, item in enumerate(runs)]


def growing(change: Callable[[KnownRun, float], KnownRun]) -> Fault:
    """Return the fault of ``change`` whose size grows from 0 over the campaign."""
    return lambda runs, size: [change(item, size * k / len(runs)) for k, item in enumerate(runs)]


def signals(item: KnownRun, **changed: Any) -> KnownRun:
    return replace(item, run=replace(item.run, **changed))


def gauges(a: float, b: float) -> Fault:
    """Return the fault of gains (1 + a size), (1 + b size)."""
    return each(
        lambda item, size, _: signals(
            item,
            gauge_a_v=item.run.gauge_a_v * (1.0 + a * size),
            gauge_b_v=item.run.gauge_b_v * (1.0 + b * size),
        )
    )


def added(item: KnownRun, difference_v: FloatArray | float) -> KnownRun:
    """Return ``item`` with so much more in (gauge a - gauge b)."""
    half = 0.5 * difference_v
    return signals(item, gauge_a_v=item.run.gauge_a_v + half, gauge_b_v=item.run.gauge_b_v - half)


def rubbing(item: KnownRun, size_nm: float) -> KnownRun:
    driven = np.clip(item.run.t_s / 0.02, 0.0, 1.0)
    return added(item, driven * size_nm / item.calibration.torque.value)


def some_rub(item: KnownRun, size: float, place: int) -> KnownRun:
    return rubbing(item, size) if place % 5 in (0, 2) else item


def zero_drift(item: KnownRun, size: float, _: int) -> KnownRun:
    grown = np.clip(item.run.t_s / item.run.stop_s, 0.0, 1.0)
    return added(item, size * VOLTS_PER_USTRAIN * grown)


def stuck(at: float | None) -> Fault:
    """Return the fault of ``size`` samples of both gauges that repeat ``at``, or the one before."""

    def change(item: KnownRun, size: float, place: int) -> KnownRun:
        run = item.run
        first = int(np.searchsorted(run.t_s, 0.15)) + place
        volts = {}
        for name in ("gauge_a_v", "gauge_b_v"):
            signal = getattr(run, name).copy()
            signal[first : first + round(size)] = signal[first] if at is None else at
            volts[name] = signal
        return signals(item, **volts)

    return each(change)


def hum(together: bool, frequency_hz: float = 50.0) -> Fault:
    """Return the fault of ``size`` microstrain of hum, of both gauges alike or against."""

    def change(item: KnownRun, size: float, place: int) -> KnownRun:
        phase = 2.0 * math.pi * frequency_hz * item.run.t_s + place
        wave = size * VOLTS_PER_USTRAIN * np.sin(phase)
        sign = 1.0 if together else -1.0
        run = item.run
        return signals(item, gauge_a_v=run.gauge_a_v + wave, gauge_b_v=run.gauge_b_v + sign * wave)

    return each(change)


def spike(item: KnownRun, size: float, place: int) -> KnownRun:
    volts = item.run.gauge_a_v.copy()
    volts[int(np.searchsorted(item.run.t_s, 0.2)) + place] += size
    return signals(item, gauge_a_v=volts)


def converter(item: KnownRun, size: float, _: int) -> KnownRun:
    step = 20.0 / 2.0**size
    names = ("gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
    return signals(item, **{n: step * np.round(getattr(item.run, n) / step) for n in names})


def scaled(**factors: float) -> Fault:
    """Return the fault of signals times (1 + factor size)."""
    return each(
        lambda item, size, _: signals(
            item, **{n: getattr(item.run, n) * (1.0 + f * size) for n, f in factors.items()}
        )
    )


def pot_noise(item: KnownRun, size: float, place: int) -> KnownRun:
    noise = np.random.default_rng(place).standard_normal((2, item.run.t_s.size)) * size
    run = item.run
    return signals(item, wheel_v=run.wheel_v + noise[0], platform_v=run.platform_v + noise[1])


def trigger(item: KnownRun, size: float, _: int) -> KnownRun:
    return signals(item, t_s=item.run.t_s + size, stop_s=item.run.stop_s + size)


def lost(closed: bool) -> Fault:
    """Return the fault of ``size`` blocks that are lost, with a gap or with times closed up."""

    def change(item: KnownRun, size: float, place: int) -> KnownRun:
        run = item.run
        first = int(np.searchsorted(run.t_s, 0.15)) + place
        kept = np.ones(run.t_s.size, dtype=np.bool_)
        kept[first : first + round(size) * BLOCK] = False
        names = ("gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
        t_s = run.t_s[: int(kept.sum())] if closed else run.t_s[kept]
        gone = round(size) * BLOCK / 9600.0 if closed else 0.0
        return signals(
            item, t_s=t_s, stop_s=run.stop_s - gone, **{n: getattr(run, n)[kept] for n in names}
        )

    return each(change)


def repeated(item: KnownRun, size: float, place: int) -> KnownRun:
    run, count = item.run, round(size) * BLOCK
    first = int(np.searchsorted(run.t_s, 0.2)) + place
    names = ("gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
    changed = {n: getattr(run, n).copy() for n in names}
    for volts in changed.values():
        volts[first : first + count] = volts[first - count : first]
    return signals(item, **changed)


def angle(item: KnownRun, size: float, _: int) -> KnownRun:
    if item.run.alpha_rad == 0.0:
        return item
    return signals(item, alpha_rad=item.run.alpha_rad + math.radians(size))


def answered(item: KnownRun, size: float, _: int) -> KnownRun:
    return signals(item, announced_load_kg=item.run.announced_load_kg * (1.0 + size))


def tare(item: KnownRun, size: float, _: int) -> KnownRun:
    return signals(item, load_n=item.run.load_n + 9.81 * size)


def rig_value(name: str) -> Fault:
    """Return the fault of a constant or calibrated value of the rig that is (1 + size) times."""

    def change(item: KnownRun, size: float, _: int) -> KnownRun:
        value = getattr(item.rig, name)
        wrong: Any = (
            value * (1.0 + size)
            if isinstance(value, float)
            else replace(value, value=value.value * (1.0 + size))
        )
        return replace(item, rig=replace(item.rig, **{name: wrong}))

    return each(change)


def calibrated(name: str) -> Fault:
    """Return the fault of a calibrated value that is (1 + size) times the right one."""

    def change(item: KnownRun, size: float, _: int) -> KnownRun:
        value = getattr(item.calibration, name)
        wrong: Any = {name: replace(value, value=value.value * (1.0 + size))}
        return replace(item, calibration=replace(item.calibration, **wrong))

    return each(change)


def swapped(item: KnownRun, size: float, place: int) -> KnownRun:
    """Swap the gauges in that share of the runs."""
    run = item.run
    if place % 10 >= 10 * size:
        return item
    return signals(item, gauge_a_v=run.gauge_b_v, gauge_b_v=run.gauge_a_v)


def clipped(item: KnownRun, size: float, _: int) -> KnownRun:
    run = item.run
    return signals(
        item, gauge_a_v=np.clip(run.gauge_a_v, -size, size),
        gauge_b_v=np.clip(run.gauge_b_v, -size, size),
    )  # fmt: skip


def clock(item: KnownRun, size: float, _: int) -> KnownRun:
    run = item.run
    return signals(item, t_s=run.t_s * (1.0 + size), stop_s=run.stop_s * (1.0 + size))


def shifted(item: KnownRun, size: float, _: int) -> KnownRun:
    """Shift the gauges against the potentiometers by so many samples."""
    run = item.run
    return signals(item, gauge_a_v=np.roll(run.gauge_a_v, round(size)),
                   gauge_b_v=np.roll(run.gauge_b_v, round(size)))  # fmt: skip


def in_share(change: Callable[[KnownRun], KnownRun]) -> Fault:
    """Return the fault of ``change`` in that share of the runs."""
    return each(lambda item, size, place: change(item) if place % 10 < 10 * size else item)


def reversed_gauge(item: KnownRun) -> KnownRun:
    return signals(item, gauge_a_v=-item.run.gauge_a_v)


def dead_gauge(item: KnownRun) -> KnownRun:
    noise = 1e-3 * np.random.default_rng(item.run.number).standard_normal(item.run.t_s.size)
    return signals(item, gauge_a_v=noise)


def swapped_potentiometers(item: KnownRun) -> KnownRun:
    return signals(item, wheel_v=item.run.platform_v, platform_v=item.run.wheel_v)


def exchanged_angles(item: KnownRun) -> KnownRun:
    """Take 15 degrees for 45 and the other way round."""
    other = {15.0: 45.0, 45.0: 15.0}.get(round(math.degrees(item.run.alpha_rad), 3))
    return item if other is None else signals(item, alpha_rad=math.radians(other))


def wheel_stops(item: KnownRun, size: float, _: int) -> KnownRun:
    """Let the potentiometer of the wheel stand still from that time on."""
    volts = item.run.wheel_v.copy()
    first = int(np.searchsorted(item.run.t_s, size))
    volts[first:] = volts[min(first, volts.size - 1)]
    return signals(item, wheel_v=volts)


def slack_thread(item: KnownRun, size: float, _: int) -> KnownRun:
    """Let the platform go by that way before its thread pulls the potentiometer."""
    volts = item.run.platform_v
    start = float(np.mean(volts[item.run.t_s < 0.0]))
    return signals(
        item,
        platform_v=start + np.maximum(volts - start - size / item.calibration.platform.value, 0),
    )


def zero_step(item: KnownRun, size: float, place: int) -> KnownRun:
    later = item.run.t_s > 0.1 + 0.01 * (place % 10)
    return added(item, np.where(later, size * VOLTS_PER_USTRAIN, 0.0))


def gain(item: KnownRun, size: float) -> KnownRun:
    run = item.run
    return signals(
        item, gauge_a_v=run.gauge_a_v * (1.0 + size), gauge_b_v=run.gauge_b_v * (1.0 + size)
    )


def span(item: KnownRun, size: float) -> KnownRun:
    return signals(item, load_n=item.run.load_n * (1.0 + size))


#: Each kind of fault, and its three sizes.
KINDS: dict[str, tuple[Fault, tuple[float, float, float]]] = {
    "gain of gauge a low": (gauges(-1.0, 0.0), (0.03, 0.06, 0.10)),
    "gain of gauge b high": (gauges(0.0, 1.0), (0.03, 0.06, 0.10)),
    "gain of both low": (gauges(-1.0, -1.0), (0.03, 0.05, 0.08)),
    "gain of both high": (gauges(1.0, 1.0), (0.03, 0.05, 0.08)),
    "gain drifts up": (growing(gain), (0.04, 0.08, 0.12)),
    "gain drifts down": (growing(lambda i, s: gain(i, -s)), (0.04, 0.08, 0.12)),
    "rubbing in all runs": (each(lambda i, s, _: rubbing(i, s)), (0.02, 0.05, 0.10)),
    "rubbing in two fifths of the runs": (each(some_rub), (0.05, 0.10, 0.40)),
    "zero drifts in each run": (each(zero_drift), (1.0, 2.0, 4.0)),
    "zero drifts down in each run": (each(lambda i, s, p: zero_drift(i, -s, p)), (1.0, 2.0, 4.0)),
    "zero off in all": (each(lambda i, s, _: added(i, s * VOLTS_PER_USTRAIN)), (1.0, 3.0, 6.0)),
    "scale not tared, more": (each(tare), (0.1, 0.2, 0.3)),
    "scale not tared, less": (each(lambda i, s, p: tare(i, -s, p)), (0.1, 0.2, 0.3)),
    "span of the scale high": (scaled(load_n=1.0), (0.02, 0.04, 0.06)),
    "span of the scale low": (scaled(load_n=-1.0), (0.02, 0.04, 0.06)),
    "samples repeat the last": (stuck(None), (24, 96, 480)),
    "samples are 0": (stuck(0.0), (24, 96, 480)),
    "hum of both gauges": (hum(together=True), (3.0, 10.0, 40.0)),
    "hum against each other": (hum(together=False), (3.0, 10.0, 40.0)),
    "hum at 51 Hz": (hum(together=False, frequency_hz=51.0), (3.0, 10.0, 40.0)),
    "a spike": (each(spike), (0.05, 0.2, 2.0)),
    "a coarse converter, bits": (each(converter), (12, 10, 8)),
    "noise of the potentiometers": (each(pot_noise), (0.005, 0.02, 0.1)),
    "both potentiometers low": (scaled(wheel_v=-1.0, platform_v=-1.0), (0.01, 0.02, 0.05)),
    "pulley of the platform": (scaled(platform_v=1.0), (0.02, 0.05, 0.10)),
    "potentiometer of the wheel": (scaled(wheel_v=1.0), (0.02, 0.05, 0.10)),
    "trigger early": (each(trigger), (0.01, 0.02, 0.04)),
    "trigger late": (each(lambda i, s, p: trigger(i, -s, p)), (0.01, 0.02, 0.04)),
    "blocks lost, with a gap": (lost(closed=False), (1, 3, 8)),
    "blocks lost, closed up": (lost(closed=True), (1, 3, 8)),
    "blocks repeated": (each(repeated), (1, 3, 8)),
    "angle, degrees": (each(angle), (1.0, 3.0, 8.0)),
    "answered load": (each(answered), (0.03, 0.08, 0.25)),
    "gauges swapped in a share": (each(swapped), (0.1, 0.5, 1.0)),
    "gauges clipped, V": (each(clipped), (0.6, 0.4, 0.2)),
    "clock fast": (each(clock), (0.01, 0.03, 0.10)),
    "gauges late, samples": (each(shifted), (96, 480, 960)),
    "torque calibration": (calibrated("torque"), (0.03, 0.05, 0.10)),
    "load calibration": (calibrated("load"), (0.02, 0.04, 0.08)),
    "radius of the wheel": (rig_value("wheel_radius_m"), (0.02, 0.04, 0.08)),
    "moment of inertia": (rig_value("wheel_inertia"), (0.5, 1.0, 3.0)),
    "mass of the platform": (rig_value("platform_mass_kg"), (0.03, 0.10, 0.30)),
    "bearing constant": (rig_value("bearing_constant"), (0.5, 1.0, 3.0)),
    "rolling resistance": (rig_value("rolling_resistance"), (1.0, 2.0, 4.0)),
    "effective radius": (rig_value("effective_radius"), (0.02, 0.04, 0.08)),
    "drag of the rollers": (rig_value("roller_drag"), (0.5, 1.0, 2.0)),
    "rise of the load": (rig_value("load_rise"), (1.0, 2.0, 4.0)),
    "a gauge reversed in a share": (in_share(reversed_gauge), (0.1, 0.5, 1.0)),
    "a gauge dead in a share": (in_share(dead_gauge), (0.1, 0.5, 1.0)),
    "potentiometers swapped in a share": (in_share(swapped_potentiometers), (0.1, 0.5, 1.0)),
    "15 for 45 degrees in a share": (in_share(exchanged_angles), (0.1, 0.5, 1.0)),
    "excitation low": (
        scaled(gauge_a_v=-1.0, gauge_b_v=-1.0, wheel_v=-1.0, platform_v=-1.0),
        (0.02, 0.05, 0.10),
    ),
    "wheel's potentiometer stops, s": (each(wheel_stops), (0.3, 0.2, 0.1)),
    "slack thread, m": (each(slack_thread), (0.001, 0.003, 0.010)),
    "zero steps in each run": (each(zero_step), (1.0, 3.0, 6.0)),
    "scale drifts over the campaign": (growing(span), (0.03, 0.06, 0.10)),
}
HOPPING = ("rollers stand out, m", (3e-4, 6e-4, 1.2e-3))


def judged(result: CampaignResult) -> Row:
    """Return what is kept of a campaign: maxima with U, and all that is named."""
    return {
        "sets": {
            s.name: None if s.maximum is None else [s.maximum.value, s.maximum.expanded]
            for s in result.sets
        },
        "terms": {
            s.name: {term.name: term.better for term in s.budget.terms if term.systematic}
            for s in result.sets
            if s.budget is not None
        },
        "statistical": {s.name: s.statistical_u for s in result.sets},
        "unseen": {s.name: s.shared_u for s in result.sets},
        "shared": [error.code for error in result.shared],
        "left_out": sum(run.excluded for run in result.runs),
        "runs": len(result.runs),
        "codes": sorted({flag.code for run in result.runs for flag in run.flags}),
        "warnings": sorted({w.partition(":")[2] or w for w in result.warnings}),
    }


def true_mu(row: Row) -> dict[str, float]:
    """Return the largest coefficients of the rig of ``row``."""
    number = int(row["rig"])
    if row.get("world") == "foreign":
        world = angle_world.drawn(number)
        return {name: world.maximum(name) for name in row["sets"]}
    limits = hidden(number).limits
    return {name: float(getattr(limits, name)) for name in row["sets"]}


def plan(world: str, rigs: int, only: str, *, middle: bool = False) -> list[Case]:
    """Return the cases: each rig without a fault first; of each kind all sizes or the ``middle``.

    Of the foreign world each kind has one rig, in turn; of rigd's own each rig has all kinds.
    """
    kinds = {**{name: sizes for name, (_, sizes) in KINDS.items()}, HOPPING[0]: HOPPING[1]}
    cases: list[Case] = []
    for rig in range(1, rigs + 1):
        cases.append((rig, "good", 0.0))
        cases += [
            (rig, name, size)
            for place, (name, sizes) in enumerate(kinds.items())
            if only in name and (world != "foreign" or place % rigs == rig - 1)
            for size in (sizes[1:2] if middle else sizes)
        ]
    return cases


def spoilt_campaigns(world: str, cases: Sequence[Case], count: int) -> Iterator[tuple[Case, Runs]]:
    """Return the runs of each case, as they are asked for; a rig is simulated once."""
    runs: dict[int, Runs] = {}
    for rig, kind, size in cases:
        if kind == HOPPING[0]:
            yield (rig, kind, size), campaign(world, rig, count, profile_m=size)
            continue
        if rig not in runs:
            runs = {rig: campaign(world, rig, count)}
        yield (rig, kind, size), runs[rig] if kind == "good" else KINDS[kind][0](runs[rig], size)


def play(
    world: str, cases: Sequence[Case], count: int, rows: list[Row], table: Path | None
) -> None:
    """Play what ``rows`` lack, and append it to them and to the table."""
    done = {(row["rig"], row["kind"], row["size"]) for row in rows if row["runs"] == count}
    begun = time.process_time()
    for (rig, kind, size), runs in spoilt_campaigns(
        world, [case for case in cases if case not in done], count
    ):
        row = {"world": world, "rig": rig, "kind": kind, "size": size}
        row |= judged(analyse_campaign(runs))
        row["cpu_s"] = time.process_time() - begun
        begun = time.process_time()
        rows.append(row)
        if table is not None:
            with table.open("a") as file:
                file.write(json.dumps(row) + "\n")


def seen(row: Row, good: Row) -> str:
    """Return how a fault was seen; empty if not at all."""
    if set(row["shared"]) - set(good["shared"]):
        return "named"
    if set(row["codes"]) - set(good["codes"]) or row["left_out"] > good["left_out"] + 2:
        return "flagged"
    if any(row["sets"][name] is None for name in row["sets"] if good["sets"][name] is not None):
        return "refused"
    return "warned" if set(row["warnings"]) - set(good["warnings"]) else ""


def misses(row: Row) -> dict[str, float]:
    """Return the error of each published maximum over the U that is published with it."""
    true = true_mu(row)
    return {n: (found[0] - true[n]) / found[1] for n, found in row["sets"].items() if found}


def report(rows: Sequence[Row]) -> None:
    """Print what became of each kind, and the figures, for each number of runs."""
    _report_more(rows)
    for count in sorted({row["runs"] for row in rows}):
        some = [row for row in rows if row["runs"] == count]
        print(f"campaigns of {count} runs:")
        _report_faults(some)
        _report_good([row for row in some if row["kind"] == "good"])


def _report_more(rows: Sequence[Row]) -> None:
    """Print what more runs make of the same maxima, of the same rigs and faults."""
    found: dict[tuple[int, str, float, str], dict[int, tuple[float, float]]] = {}
    for row in rows:
        true = true_mu(row)
        for name, miss in misses(row).items():
            of = found.setdefault((row["rig"], row["kind"], row["size"], name), {})
            of[row["runs"]] = (miss, row["sets"][name][1] / true[name])
    counts = sorted({count for of in found.values() for count in of})
    for fewer, more in itertools.pairwise(counts):
        both = {case: of for case, of in found.items() if fewer in of and more in of}
        if not both:
            continue
        for count in (fewer, more):
            miss, u = np.array([of[count] for of in both.values()]).T
            rms = float(np.sqrt(np.mean((miss * u) ** 2)))
            print(f"{count} runs, {len(both)} maxima that {fewer} and {more} runs give: "
                  f"{np.mean(np.abs(miss) <= 1.0):.1%} within U, rms error {rms:.2%}, "
                  f"median U {np.median(u):.2%}")  # fmt: skip
        lost = [case for case, of in both.items() if abs(of[more][0]) > 1.0 >= abs(of[fewer][0])]
        at_most(f"maxima that {fewer} runs hold and {more} do not", len(lost), 0.02 * len(both), "")
        for rig, kind, size, name in lost:
            print(f"  lost: rig {rig}, {kind} {size:g}, {name}")


def _report_faults(rows: Sequence[Row]) -> None:
    good = {row["rig"]: row for row in rows if row["kind"] == "good"}
    faults = [row for row in rows if row["kind"] != "good" and row["rig"] in good]
    if not faults:
        return
    counts = {"held": 0, "named": 0, "flagged": 0, "refused": 0, "warned": 0, "": 0}
    for row in faults:
        true, base = true_mu(row), good[row["rig"]]
        there = [name for name, found in row["sets"].items() if found and base["sets"].get(name)]
        errors = {name: abs(row["sets"][name][0] - true[name]) for name in there}
        moved = {name: e / base["sets"][name][1] for name, e in errors.items()}
        refused = len(errors) < sum(found is not None for found in base["sets"].values())
        if not refused and max(moved.values(), default=0.0) <= 1.0:
            continue
        how = seen(row, base)
        if not how and all(errors[name] <= row["sets"][name][1] for name in errors):
            how = "held"
        counts[how] += 1
        if not how:
            worst = max(moved, key=lambda name: moved[name])
            print(f"  not seen: rig {row['rig']}, {row['kind']} {row['size']:g}: {worst} is off "
                  f"by {moved[worst]:.1f} U")  # fmt: skip
    total = sum(counts.values())
    if total:
        print(f"{total} cases move a maximum by more than its U, or lose it: {counts}")
        at_least("faults that matter and are seen", 100 * (1 - counts[""] / total), 95, "%")
    for row in faults:
        wrong = {name: miss for name, miss in misses(row).items() if abs(miss) > 1.0}
        if wrong:
            listed = ", ".join(f"{name} by {miss:+.1f} U" for name, miss in wrong.items())
            named = ", ".join(row["shared"]) or "nothing"
            print(f"  wrong: rig {row['rig']}, {row['kind']} {row['size']:g}: {listed}; {named} "
                  f"named, {row['left_out']} runs left out")  # fmt: skip
    inside = [abs(miss) <= 1.0 for row in faults for miss in misses(row).values()]
    at_least(f"faults: maxima within the published U ({len(inside)} maxima of {len(faults)} "
             "campaigns)", 100 * float(np.mean(inside)), 95, "%")  # fmt: skip


def _report_good(rows: Sequence[Row]) -> None:
    ratios = [miss for row in rows for miss in misses(row).values()]
    if not ratios:
        return
    inside = float(np.mean(np.abs(ratios) <= 1.0))
    noted(f"{len(rows)} good campaigns: {len(ratios)} maxima within U (92 to 98 % wanted)",
          100 * inside, "%")  # fmt: skip
    noted("good campaigns: rms of error over U (0.5 wanted)",
          float(np.sqrt(np.mean(np.square(ratios)))), "")  # fmt: skip
    alone = [
        miss / math.sqrt(1.0 - share**2)
        for row in rows
        if "unseen" in row
        for n, miss in misses(row).items()
        if (share := 2.0 * row["unseen"][n] * row["sets"][n][0] / row["sets"][n][1]) < 1.0
    ]
    if alone:  # fmt: skip
        noted("the same without what the balance cannot exclude",
              float(np.sqrt(np.mean(np.square(alone)))), "")  # fmt: skip
    out, runs = (sum(row[key] for row in rows) for key in ("left_out", "runs"))
    at_most("good runs left out", 100 * out / runs, 1, "%")
    alarms = sum(bool(row["shared"]) for row in rows)
    at_most("good campaigns with a shared error", 100 * alarms / len(rows), 3, "%")
    notes: dict[str, int] = {}
    for row in rows:
        for code in (*row["shared"], *row["codes"]):
            notes[code] = notes.get(code, 0) + 1
    print(f"named in good campaigns: {notes}")


def main() -> int:
    """Play what the table lacks, and print what it shows."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=2, help="rigs with all faults (default 2)")
    parser.add_argument("--only", default="", help="kinds whose name holds this", metavar="WORD")
    parser.add_argument(
        "--world", choices=("rigd", "foreign"), default="rigd", help="the simulator"
    )
    parser.add_argument(
        "--runs", type=int, default=24, choices=DESIGNS, help="runs of a campaign (default 24)"
    )
    parser.add_argument(
        "--good", type=int, default=0, metavar="N", help="N good campaigns alone, of rigs 1 to N"
    )
    parser.add_argument("--middle", action="store_true", help="the middle size of each kind alone")
    parser.add_argument("--table", type=Path, help="JSON lines, read and appended to")
    parser.add_argument("--report", action="store_true", help="of the table alone")
    arguments = parser.parse_args()
    table: Path | None = arguments.table
    known = table.read_text().splitlines() if table is not None and table.exists() else []
    rows: list[Row] = [json.loads(line) for line in known]
    if not arguments.report:
        cases = plan(arguments.world, arguments.rigs, arguments.only, middle=arguments.middle)
        if arguments.good:
            cases = [(rig, "good", 0.0) for rig in range(1, arguments.good + 1)]
        play(arguments.world, cases, arguments.runs, rows, table)
    report(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
