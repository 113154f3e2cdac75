"""The paper's method on the simulated rig: as wrong as it must be there, and no more."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.approach_angle.runs import SETS, TABLE_1, Trial, campaign, drawn_rig, trial
from support.approach_angle.truth import WINDOWS, Steady, slip_error, steady

from rigd_analyses.approach_angle.paper import PaperRun, analyse_paper
from rigd_analyses.approach_angle.raw.run_data import Regime


@dataclass(frozen=True)
class Row:
    """One run of the campaign: what was found, what was true."""

    set_name: str
    found: PaperRun
    true: Steady
    at_limit: float  #: share of the steady segment with F_r/N at the limit of the surface


def analysed(item: Trial) -> PaperRun:
    return analyse_paper(item.known.run, item.known.calibration, item.known.rig)


def row(item: Trial) -> Row:
    found, run = analysed(item), item.simulated
    at = run.window(found.t_steady_s, run.stop_s)
    truth = {name: signal[at] for name, signal in run.truth.items()}
    share = truth["rolling_force"] / (truth["normal_force"] * truth["friction_limit"])
    return Row(
        run.set_name,
        replace(found, curves=None),
        steady(run, found.t_steady_s),
        float(np.mean(share > 0.95)),
    )


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """Return the campaign of the paper, 200 runs, on one rig; some seconds."""
    return [row(item) for item in campaign(seed=4, individual=11)]


def test_no_good_run_is_excluded(rows: list[Row]) -> None:
    assert len(rows) == 200
    assert [item.found.flags for item in rows if item.found.excluded] == []
    assert {f.code for item in rows for f in item.found.flags} == {"no_sliding", "partly_sliding"}


def test_maximum_of_each_set_exceeds_truth_like_reference(rows: list[Row]) -> None:
    largest: dict[str, float] = defaultdict(float)
    for item in rows:
        largest[item.set_name] = max(largest[item.set_name], item.found.mu)
    assert set(largest) == set(TABLE_1)
    for name, (low, high) in WINDOWS.items():
        assert low <= largest[name] / TABLE_1[name] - 1.0 <= high, name


def test_the_papers_slip_is_within_4_per_cent(rows: list[Row]) -> None:
    errors = [slip_error(item.found.slip, item.true.slip) for item in rows]
    assert max(np.abs(errors)) < 0.04
    assert 0.0 < np.median(errors) < 0.02  # the speeds end 16 ms before the torque


def test_the_regime_is_that_of_the_contact(rows: list[Row]) -> None:
    """It slides if F_r/N is at the limit all through, and rolls if it hardly ever is."""
    regimes = Counter(item.found.regime for item in rows)
    assert min(regimes[regime] for regime in Regime) > 20
    for item in rows:
        sliding = item.found.regime is Regime.SLIDING
        assert math.isfinite(item.found.friction_coefficient) == sliding
        assert item.at_limit > 0.95 or not sliding
        assert item.at_limit < 0.5 or item.found.regime is not Regime.ROLLING


@pytest.mark.parametrize("set_name", SETS)
@pytest.mark.parametrize(("load_kg", "voltage_v"), [(4.0, 10.0), (8.0, 4.0), (8.0, 10.0)])
def test_on_ideal_rig_only_inertia_is_missing(
    set_name: str, load_kg: float, voltage_v: float
) -> None:
    item = trial(
        set_name, load_kg, voltage_v, 1, 1, rig=drawn_rig(0), seed=1, noise=False, drag=False
    )
    found = analysed(item)
    true = steady(item.simulated, found.t_steady_s)
    assert found.torque_nm == pytest.approx(true.torque_nm, rel=0.005)
    assert found.mu - true.mu == pytest.approx(true.inertia, abs=0.002)
    assert found.mu - true.mu > 0.5 * true.inertia > 0.0005


@pytest.mark.parametrize("voltage_v", [4.0, 10.0])
@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        ("gauges_swapped", {"negative_torque"}),
        ("platform_pot_dead", {"pot_dead"}),
        ("wheel_pot_dead", {"pot_dead"}),
        ("wheel_pot_at_end", {"pot_at_end"}),
        ("scale_unsteady", {"scale_unsteady"}),
    ],
)
def test_faults_of_the_rig_are_reported(fault: str, codes: set[str], voltage_v: float) -> None:
    item = trial("clean_15", 5.0, voltage_v, 1, 1, rig=drawn_rig(0), seed=7, fault=fault)
    found = analysed(item)
    assert codes <= {flag.code for flag in found.flags}
    assert ("watchdog" in {flag.code for flag in found.flags}) == item.simulated.watchdog
    assert np.isnan([found.mu, found.torque_nm, found.slip, found.slip_corrected]).all()


def test_wheel_that_cannot_slide_has_no_friction_coefficient() -> None:
    item = trial("clean_30", 5.0, 10.0, 1, 1, rig=drawn_rig(0), seed=7, fault="no_sliding")
    found = analysed(item)
    assert found.regime is Regime.ROLLING
    assert [flag.code for flag in found.flags] == ["no_sliding"]
    assert "not a friction coefficient" in found.flags[0].reason
    assert math.isnan(found.friction_coefficient)
