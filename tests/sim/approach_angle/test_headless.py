"""simulate(): runs as the paper saw them, the automatic stop, and each way to spoil a run."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.approach_angle.headless import POST_S, PRE_S, WATCHDOG_S, SimulatedRun, simulate

from rigd_sim.approach_angle import layout

#: set, load, voltage; mean F_r/N of the reference runs r0, r2, r3, r5 of angle_golden.npz, which
#: stop on blocks of 50 ms.
REFERENCE = (
    ("clean_0", 4.0, 10.0, 0.1890),
    ("clean_15", 5.0, 8.5, 0.2493),
    ("clean_30", 6.0, 7.0, 0.2819),
    ("clean_45", 8.0, 4.0, 0.1552),
)


def torque(run: SimulatedRun) -> NDArray[np.float64]:
    """Return the torque by the gauges, without the zero before the start."""
    difference = run.gauge_a_v - run.gauge_b_v
    measured: NDArray[np.float64] = difference - difference[run.t_s < 0.0].mean()
    return run.torque_scale * measured


@pytest.mark.parametrize(("set_name", "load_kg", "voltage_v", "mu"), REFERENCE)
def test_runs_resemble_those_of_an_independent_simulator(
    set_name: str, load_kg: float, voltage_v: float, mu: float
) -> None:
    """The surface scatters by 1.5 % and the load by 1 %, here and there."""
    runs = [simulate(set_name, load_kg, voltage_v, seed=seed, block=480) for seed in range(3)]
    found = np.mean([run.true_mu(0.1, run.stop_s) for run in runs])
    assert found == pytest.approx(mu, rel=0.06)


@pytest.mark.parametrize("set_name", list(layout.SETS))
@pytest.mark.parametrize(("load_kg", "voltage_v"), [(4, 4), (4, 10), (8, 4), (8, 10)])
def test_run_below_700_ms_has_peak_then_plateau(
    set_name: str, load_kg: float, voltage_v: float
) -> None:
    run = simulate(set_name, load_kg, voltage_v)
    assert 0.25 < run.stop_s < 0.7
    assert not run.watchdog
    assert run.t_s[0] == pytest.approx(-PRE_S, abs=1e-9)
    assert run.t_s[-1] == pytest.approx(run.stop_s + POST_S, abs=2e-4)
    np.testing.assert_allclose(np.diff(run.t_s), 1 / 9600, atol=2e-9)
    smooth = np.convolve(torque(run), np.ones(96) / 96, "same")
    early, late = run.window(0.01, 0.12), run.window(0.2, run.stop_s)
    assert smooth[early].max() > 1.3 * np.median(smooth[late])
    assert run.scale_stable
    assert run.scale_kg == pytest.approx(load_kg, rel=0.05)


def test_the_pre_trigger_samples_are_at_rest() -> None:
    run = simulate("clean_30", 6.0, 8.5)
    before = run.t_s < 8e-3  # until the relay has picked up
    assert np.ptp(run.truth["wheel_angle"][before]) == 0.0
    assert np.ptp(run.truth["platform_position"][before]) == 0.0
    assert run.truth["platform_position"][-1] > 0.3


def test_stop_comes_within_block_and_its_latency() -> None:
    """On average half a block and the latency after the threshold: 12.5 ms with 10 ms blocks."""
    late = []
    for seed in range(30):
        run = simulate("clean_15", 5.0, 7.0, seed=seed, individual=seed)
        stop = int(np.searchsorted(run.t_s, run.stop_s))
        travel = run.truth["platform_position"][stop] - 0.30
        late.append(travel / run.truth["platform_speed"][stop])
    # The slope of a potentiometer (0.2 % of 0.4 m) shifts the threshold by 1 mm.
    assert np.mean(late) == pytest.approx(12.5e-3, abs=2.5e-3)
    assert max(late) < 40e-3


def test_longer_blocks_stop_later() -> None:
    travelled = {}
    for block in (24, 480):
        runs = [simulate("clean_15", 5.0, 8.5, seed=seed, block=block) for seed in range(8)]
        travelled[block] = np.mean([np.interp(r.stop_s, r.t_s, r.truth["platform_position"])
                                    for r in runs])  # fmt: skip
    assert travelled[480] > travelled[24] + 0.01


def test_ideal_rig_errs_by_wheels_inertia_alone() -> None:
    for set_name, load_kg, voltage_v in (("clean_0", 4.0, 10.0), ("clean_45", 4.0, 8.5)):
        run = simulate(set_name, load_kg, voltage_v, noise=False, drag=False)
        steady = run.window(0.15, run.stop_s)
        measured = torque(run)[steady].mean()
        assert measured == pytest.approx(run.truth["torque"][steady].mean(), rel=5e-3)
        n = run.truth["normal_force"][steady]
        assert np.ptp(n) == 0.0
        spin = run.truth["wheel_speed"][steady]
        inertia = 4e-4 * (spin[-1] - spin[0]) / (run.t_s[steady][-1] - run.t_s[steady][0])
        mu = measured / (0.05 * run.scale_kg * 9.81)
        excess = inertia / (0.05 * n[0])
        assert mu - run.true_mu(0.15, run.stop_s) == pytest.approx(excess, abs=2e-3)


def test_bearing_and_rolling_add_to_the_torque() -> None:
    run = simulate("clean_0", 4.0, 10.0)
    steady = run.window(0.2, run.stop_s)
    n, w = run.truth["normal_force"][steady], run.truth["wheel_speed"][steady]
    friction = 0.05 * 0.995 * run.truth["rolling_force"][steady].mean()
    drags = 0.012 + 2e-4 * w.mean() + 1e-4 * n.mean() + 0.006 * 0.05 * n.mean()
    inertia = 4e-4 * (w[-1] - w[0]) / (run.t_s[steady][-1] - run.t_s[steady][0])
    mean = run.truth["torque"][steady].mean()
    assert mean == pytest.approx(friction + drags + inertia, rel=0.01)


def test_seeds_scatter_and_repeat() -> None:
    found, again, other = (simulate(seed=seed) for seed in (3, 3, 4))
    assert found.gauge_a_v.tobytes() == again.gauge_a_v.tobytes()
    assert found.stop_s == again.stop_s
    assert found.scale_kg != other.scale_kg or found.stop_s != other.stop_s
    assert found.torque_scale == other.torque_scale  # the same rig
    assert simulate(seed=3, individual=2).torque_scale != found.torque_scale


def test_load_cell_shows_normal_force_while_it_varies() -> None:
    run = simulate("clean_45", 6.0, 8.5, load_cell=True)
    assert run.normal_force_v is not None
    force = (run.normal_force_v - run.normal_force_zero_v) * run.normal_force_scale
    error = force / run.truth["normal_force"] - 1
    assert np.mean(error) == pytest.approx(0.0, abs=4 * 0.003)
    assert np.std(run.truth["normal_force"]) > 1.0
    assert np.std(error * 6.0 * 9.81) == pytest.approx(0.6, rel=0.1)
    assert simulate().normal_force_v is None


def test_rubbing_adds_torque_but_no_friction() -> None:
    clean, rubbed = (simulate("clean_0", 4.0, 10.0, rubbing_nm=moment) for moment in (0.0, 0.3))
    means = [torque(run)[run.window(0.25, 0.5)].mean() for run in (clean, rubbed)]
    assert means[1] - means[0] == pytest.approx(0.3, abs=0.02)
    assert rubbed.true_mu(0.25, 0.5) == pytest.approx(clean.true_mu(0.25, 0.5), rel=0.01)


def test_swapped_gauges_show_a_negative_torque() -> None:
    run = simulate(fault="gauges_swapped")
    assert torque(run)[run.window(0.02, run.stop_s)].mean() < -0.2


@pytest.mark.parametrize(
    ("fault", "dead"), [("platform_pot_dead", "platform_v"), ("wheel_pot_dead", "wheel_v")]
)
def test_a_dead_potentiometer_stays_where_it_was(fault: str, dead: str) -> None:
    run = simulate("clean_45", 6.0, 8.5, fault=fault)
    assert np.std(getattr(run, dead)) < 2.5e-3
    assert run.truth["platform_position"].max() > 0.3
    if fault == "platform_pot_dead":
        assert run.watchdog
        assert run.stop_s == WATCHDOG_S
    else:
        assert not run.watchdog


def test_potentiometer_at_its_end_shows_nothing_until_back() -> None:
    run = simulate("clean_0", 4.0, 10.0, fault="wheel_pot_at_end")
    before = run.truth["wheel_angle"] < 2 * math.pi - 1.0
    assert np.abs(run.wheel_v[before]).max() < 0.01
    assert run.wheel_v[-1] > 0.5


def test_an_unsteady_scale_is_never_stable() -> None:
    assert not any(simulate(seed=seed, fault="scale_unsteady").scale_stable for seed in range(5))


def test_on_rubber_the_wheel_does_not_slide() -> None:
    """The force stays far below the limit; the bristles' convection alone lets the wheel creep."""
    used, creep = {}, {}
    for fault in ("none", "no_sliding"):
        run = simulate("clean_0", 4.0, 10.0, fault=fault)
        rolling = run.window(0.1, run.stop_s)
        known = {name: values[rolling] for name, values in run.truth.items()}
        share = known["rolling_force"] / (known["normal_force"] * known["friction_limit"])
        used[fault] = np.abs(share).max()
        creep[fault] = np.abs(known["sliding_speed"] / known["platform_speed"]).min()
    assert used["none"] > 0.95
    assert used["no_sliding"] < 0.5
    assert creep["no_sliding"] < 0.05 < 0.5 < creep["none"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"set_name": "clean_60"}, "no set 'clean_60'; one of clean_0"),
        ({"fault": "fire"}, "it takes none"),
        ({"voltage_v": 30.0}, "it takes 0 V to 12 V"),
        ({"load_kg": 80.0}, "it takes 1 kg to 12 kg"),
    ],
)
def test_impossible_simulation_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(**options)  # type: ignore[arg-type] # by name
