"""Each fault of a run, made from a good one: its flag, its reason, and no number."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigd_analyses.approach_angle.paper import analyse_paper
from rigd_analyses.approach_angle.raw import flags
from rigd_analyses.approach_angle.raw.flags import raw_flags, whole
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    Severity,
)

Golden = Callable[[str], Any]
Fault = Callable[[AngleRun], AngleRun]

SIGNALS = ("t_s", "gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")


def cut(run: AngleRun, keep: Any) -> AngleRun:
    """Return ``run`` with the samples of ``keep`` only."""
    return replace(run, **{name: getattr(run, name)[keep] for name in SIGNALS})


def put(run: AngleRun, signal: str, since_s: float, value: float, count: int = 10**6) -> AngleRun:
    """Return ``run`` with ``count`` samples of ``signal`` at ``value`` from ``since_s`` on."""
    volts = getattr(run, signal).copy()
    first = int(np.searchsorted(run.t_s, since_s))
    volts[first : first + count] = value
    return replace(run, **{signal: volts})


def held(run: AngleRun, signal: str, since_s: float) -> AngleRun:
    """Return ``run`` with ``signal`` standing still from ``since_s`` on."""
    return put(run, signal, since_s, float(np.interp(since_s, run.t_s, getattr(run, signal))))


def noisy(run: AngleRun, signal: str, volts: float) -> AngleRun:
    """Return ``run`` with noise of ``volts`` on ``signal``."""
    noise = volts * np.random.default_rng(1).standard_normal(run.t_s.size)
    return replace(run, **{signal: getattr(run, signal) + noise})


def slower(run: AngleRun, factor: float) -> AngleRun:
    """Return ``run`` with its times stretched."""
    return replace(run, t_s=factor * run.t_s, stop_s=factor * run.stop_s)


def no_drive(run: AngleRun) -> AngleRun:
    still: dict[str, Any] = {
        name: np.full(run.t_s.size, np.mean(getattr(run, name)[:900])) for name in SIGNALS[1:]
    }
    return replace(run, **still)


#: Each fault, the code it must have, and what its reason must contain.
FAULTS: dict[str, tuple[Fault, str, str]] = {
    "no samples before the command": (
        lambda r: cut(r, r.t_s >= 0.0),
        "no_pre_trigger",
        r"begins 0 ms before the relay command, need 50 ms",
    ),
    "too few samples before the command": (
        lambda r: cut(r, r.t_s >= -0.02),
        "no_pre_trigger",
        r"begins 20 ms before",
    ),
    "card repeats a sample": (
        lambda r: put(r, "gauge_b_v", 0.2, 0.25, 24),
        "stuck_samples",
        r"From 0\.2\d* s on gauge b gives 0\.2500 V 24 times in a row",
    ),
    "record begins late": (
        lambda r: cut(r, r.t_s >= 0.03),
        "no_pre_trigger",
        r"begins 30 ms after",
    ),
    "record begins far too late": (
        lambda r: cut(r, r.t_s >= 0.15),
        "no_pre_trigger",
        r"begins 150 ms after",
    ),
    "stopped at once": (
        lambda r: replace(r, stop_s=0.14),
        "too_short",
        r"0\.140 s .* need 0\.15 s",
    ),
    "stop never given": (lambda r: replace(r, stop_s=float("nan")), "too_short", r"nan s"),
    "record ends early": (
        lambda r: cut(r, r.t_s <= 0.25),
        "too_short",
        r"ends at 0\.250 s, before the stop at 0\.457 s",
    ),
    "a card that is far too slow": (
        lambda r: cut(r, slice(None, None, 100)),
        "too_short",
        r"Only 44 samples lie between",
    ),
    "no samples": (lambda r: cut(r, slice(0, 0)), "too_short", r"holds no samples"),
    "a lost block": (
        lambda r: cut(r, (r.t_s < 0.2) | (r.t_s > 0.21)),
        "missing_samples",
        r"uneven at 1 places, first at 0\.1999 s with 10\.\d+ ms",
    ),
    "a lost block in which the stop came": (
        lambda r: cut(r, (r.t_s < 0.44) | (r.t_s > 0.47)),
        "missing_samples",
        r"uneven at 1 places, first at 0\.4399 s with 30\.\d+ ms",
    ),
    "times that go back": (
        lambda r: replace(r, t_s=np.where(r.t_s > 0.2, r.t_s - 0.01, r.t_s)),
        "missing_samples",
        r"uneven at 1 places",
    ),
    "a gauge without a number": (
        lambda r: put(r, "gauge_b_v", 0.2, float("nan"), 1),
        "nan_samples",
        r"1 samples of gauge b are no numbers",
    ),
    "a gauge with a number that no card gives": (
        lambda r: put(r, "gauge_b_v", 0.2, 1e300, 1),
        "nan_samples",
        r"1 samples of gauge b are no numbers",
    ),
    "a card whose clock gives no number": (
        lambda r: replace(r, t_s=np.full(r.t_s.size, float("nan"))),
        "nan_samples",
        r"The times of (\d+) of \1 samples are no numbers",
    ),
    "a gauge's screen comes off": (
        lambda r: noisy(r, "gauge_b_v", 0.3),
        "noisy",
        r"Noise of each sample: gauge b 0\.\d+ V; at most 0\.1 V",
    ),
    "a dirty potentiometer": (
        lambda r: noisy(r, "wheel_v", 0.05),
        "noisy",
        r"the wheel's potentiometer 0\.05\d* V",
    ),
    "an unbalanced amplifier": (
        lambda r: replace(r, gauge_a_v=r.gauge_a_v + 0.2),
        "gauges_off_zero",
        r"show \+0\.\d+ N m before the relay command, must be within 0\.15 N m",
    ),
    "a wiper that lifts off and comes back": (
        lambda r: put(r, "wheel_v", 0.2, float(np.interp(0.2, r.t_s, r.wheel_v)), 1200),
        "pot_jumps",
        r"The wheel's potentiometer jumps by 0\.\d+ V \(\d\.\d+ rad\) at 0\.3\d\d s",
    ),
    "a gauge at the rail": (
        lambda r: put(r, "gauge_a_v", 0.2, 9.9994, 50),
        "at_rail",
        r"gauge a is at the limit of the converter",
    ),
    "stopped by time": (lambda r: slower(r, 3.2), "watchdog", r"by time, after 1\.4\d s"),
    "scale never stable": (
        lambda r: replace(r, load_n=float("nan"), load_stable=False),
        "scale_unsteady",
        r"scale had not come to rest",
    ),
    "scale silent": (
        lambda r: replace(r, load_n=float("nan")),
        "load_missing",
        r"gave no load before the start",
    ),
    "scale gives no number of a load": (
        lambda r: replace(r, load_n=float("inf")),
        "load_missing",
        r"gave no load",
    ),
    "scale at zero": (lambda r: replace(r, load_n=0.0), "load_missing", r"gave no load"),
    "other weights": (
        lambda r: replace(r, announced_load_kg=6.0),
        "load_disagrees",
        r"showed 49\.2 N, announced were 6 kg \(58\.9 N\)",
    ),
    "kg for N": (lambda r: replace(r, load_n=5.0), "load_disagrees", r"showed 5\.0 N"),
    "gauges swapped": (
        lambda r: replace(r, gauge_a_v=r.gauge_b_v, gauge_b_v=r.gauge_a_v),
        "negative_torque",
        r"show -0\.\d+ N m .* swapped",
    ),
    "a gauge reversed": (
        lambda r: replace(r, gauge_b_v=2.0 * np.mean(r.gauge_b_v[:900]) - r.gauge_b_v),
        "gauges_disagree",
        r"Gauge b changes by \+0\.1\d+ V .* the other by \+0\.2\d+ V",
    ),
    "a gauge torn off": (
        lambda r: put(r, "gauge_b_v", -1.0, 0.0),
        "gauges_disagree",
        r"Gauge b changes by [+-]0\.000 V .* the other by \+0\.\d+ V",
    ),
    "the other torn off": (
        lambda r: put(r, "gauge_a_v", -1.0, 0.0),
        "gauges_disagree",
        r"Gauge a changes by [+-]0\.000 V",
    ),
    "amplifier off": (
        lambda r: put(put(r, "gauge_a_v", -1.0, 0.0), "gauge_b_v", -1.0, 0.0),
        "no_torque",
        r"show [+-]0\.000 N m",
    ),
    "wheel's leads swapped": (
        lambda r: replace(r, wheel_v=5.0 - r.wheel_v),
        "negative_speed",
        r"The wheel runs backwards, -1\.\d+ rad",
    ),
    "platform's leads swapped": (
        lambda r: replace(r, platform_v=5.0 - r.platform_v),
        "negative_speed",
        r"The platform runs backwards, -0\.01\d+ m",
    ),
    "wheel's potentiometer dead": (
        lambda r: held(r, "wheel_v", -1.0),
        "pot_dead",
        r"The wheel's potentiometer stands at 0\.49 V from 0\.11 s to 0\.17 s",
    ),
    "platform's thread off on the way": (
        lambda r: held(r, "platform_v", 0.25),
        "pot_dead",
        r"The platform's potentiometer stands at 0\.90 V from 0\.29 s to 0\.34 s",
    ),
    "wheel's potentiometer dies near the end": (
        lambda r: held(r, "wheel_v", 0.39),
        "pot_dead",
        r"from 0\.40 s to 0\.46 s",
    ),
    "wheel's potentiometer reaches its end": (
        lambda r: replace(r, wheel_v=np.minimum(r.wheel_v + 4.2, 5.0)),
        "pot_at_end",
        r"at its end at 0\.\d+ s \(4\.9\d V of 0 to 5\.00 V\): it has 10 turns",
    ),
    "platform's starts at its end": (
        lambda r: replace(r, platform_v=r.platform_v - np.mean(r.platform_v[:900]) + 0.02),
        "pot_at_end",
        r"The platform's potentiometer is at its end at -0\.100 s",
    ),
    "pushed before the start": (
        lambda r: replace(r, platform_v=r.platform_v + 0.2 * np.minimum(r.t_s, 0.0)),
        "moving_at_start",
        r"The platform moved \+0\.003\d* m before",
    ),
    "the motor does not run": (no_drive, "no_drive", r"Neither torque \(\S+ N m\) nor movement"),
}


@pytest.fixture
def found_in(
    calibration: AngleCalibration, rig: AngleRig
) -> Callable[[AngleRun], tuple[Flag, ...]]:
    return lambda run: raw_flags(run, calibration, rig)


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_reported_and_gives_no_number(
    fault: str, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    make, code, reason = FAULTS[fault]
    run = make(golden("r2").whole)
    matching = [f for f in raw_flags(run, calibration, rig) if f.code == code]
    assert matching
    assert all(f.severity is Severity.EXCLUDED for f in matching)
    assert any(re.search(reason, f.reason) for f in matching), [f.reason for f in matching]

    result = analyse_paper(run, calibration, rig)
    assert result.excluded
    assert np.isnan(
        [result.mu, result.torque_nm, result.slip, result.slip_corrected, result.relative_speed]
    ).all()
    assert set(matching) <= set(result.flags)


@pytest.mark.parametrize("name", ["r0", "r2", "r3", "r5"])
def test_a_good_run_has_no_flag(
    name: str, golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    assert found_in(golden(name).whole) == ()


def test_every_fault_of_the_table_is_made_here() -> None:
    table = re.findall(r"^(\w+) +(excluded|note)  ", flags.__doc__ or "", re.MULTILINE)
    tested = {code for _, code, _ in FAULTS.values()}
    tested.add("load_cell_disagrees")  # where the corrected method is tested, which alone uses it
    assert {code for code, severity in table if severity == "excluded"} == tested
    assert [code for code, severity in table if severity == "note"] == ["pot_near_end"]


def test_potentiometer_possibly_at_its_end_is_a_note(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run = replace(golden("r5").whole, wheel_v=golden("r5").whole.wheel_v + 3.0)
    (flag,) = raw_flags(run, calibration, rig)
    assert (flag.code, flag.severity) == ("pot_near_end", Severity.NOTE)
    assert "started at 3.44 V, 19.6 rad before its end" in flag.reason
    assert np.isfinite(analyse_paper(run, calibration, rig).mu)


def test_single_spikes_are_no_rail_or_end(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    run = put(golden("r2").whole, "gauge_a_v", 0.2, 10.0, 3)
    assert found_in(put(run, "wheel_v", 0.25, 5.0, 3)) == ()


def test_events_after_the_stop_are_not_judged(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    run = golden("r2").whole
    after = run.stop_s + 0.001
    for signal, value in (("gauge_a_v", 10.0), ("wheel_v", 5.0), ("platform_v", float("nan"))):
        run = put(run, signal, after, value)
    assert found_in(cut(run, (run.t_s < after) | (run.t_s > after + 0.02))) == ()


def test_several_faults_are_all_reported(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    run = golden("r2").whole
    bad = replace(cut(run, run.t_s >= 0.0), wheel_v=5.0 - golden("r2").run.wheel_v[:1], load_n=10.0)
    bad = replace(bad, wheel_v=np.full(bad.t_s.size, 2.0), gauge_a_v=bad.gauge_b_v,
                  gauge_b_v=bad.gauge_a_v)  # fmt: skip
    assert {flag.code for flag in found_in(bad)} == {
        "no_pre_trigger", "load_disagrees", "negative_torque", "pot_dead",
    }  # fmt: skip


def test_flag_of_recording_comes_first_and_only_once(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    told = (Flag("watchdog", "Step drive timed out."), Flag("incomplete", "Cut off."))
    run = replace(slower(golden("r2").whole, 3.2), flags=told)
    assert found_in(run)[:2] == told
    assert [flag.code for flag in found_in(run)].count("watchdog") == 1


def test_undriven_run_is_not_also_called_short(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]]
) -> None:
    undriven = Flag("not_driven", "The relay was never commanded to close.")
    run = replace(cut(golden("r2").whole, slice(0, 0)), flags=(undriven,))
    assert found_in(run) == (undriven,)


@pytest.mark.parametrize("share", [0.951, 1.0, 1.049])
def test_load_beside_plan_is_judged_by_answer(
    golden: Golden, found_in: Callable[[AngleRun], tuple[Flag, ...]], share: float
) -> None:
    """The prompt takes 10 % from the plan, and a scale that shows the answer to 5 %."""
    run = golden("r2").whole
    answered = run.load_n / 9.81 / share
    honest = replace(run, announced_load_kg=answered, planned_load_kg=answered / 1.09)
    assert found_in(honest) == ()


def test_record_like_the_papers_is_accepted_on_request(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    assert raw_flags(golden("r2").run, calibration, rig, Limits(pre_trigger_s=0.0)) == ()


def test_incomplete_signals_are_not_computed_with(golden: Golden) -> None:
    run = golden("r2").whole
    assert whole(run)
    assert not whole(put(run, "platform_v", -0.05, float("inf"), 1))
    assert whole(put(run, "platform_v", run.stop_s + 0.01, float("nan")))
    assert not whole(cut(run, run.t_s < 0.005))
