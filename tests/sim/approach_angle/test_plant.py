"""The plant as a rig uses it: time, determinism, changes at the bench, parameter files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support.approach_angle.plant import MS, S, make_plant, mean_volts, pass_time, shipped, truth

from rigd.model.errors import ConfigError
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition
from rigd_sim.approach_angle.plant import AngleConfig, AnglePlant


def played(times_ns: list[int], *, seed: int = 1) -> tuple[bytes, list[float], tuple[float, int]]:
    """Return samples, truth and scale of a run whose relay closes at 50 ms and opens at 450 ms."""
    plant = make_plant("clean_15", 5.0, 8.5, seed=seed)
    card = Acquisition(plant, start_ns=0, load_cell=True)
    volts = []
    for t_ns in sorted({*times_ns, 50 * MS, 450 * MS}):
        plant.advance(t_ns)
        if t_ns == 50 * MS:
            plant.command(True)
        if t_ns == 450 * MS:
            plant.command(False)
        while (samples := card.read()) is not None:
            volts.append(samples.volts)
    return np.concatenate(volts).tobytes(), plant.truth, plant.scale()


def test_same_seed_gives_same_bits_for_any_division() -> None:
    end = 3 * S
    by_cycles = played([k * MS for k in range(1, 3001)])
    in_jumps = played([*range(0, end, 333_333_333), end])
    uneven = played([*np.random.default_rng(5).integers(0, end, 900).tolist(), end])
    assert by_cycles == in_jumps == uneven
    assert played([end], seed=2)[0] != by_cycles[0]


def test_the_first_call_sets_the_origin_of_time() -> None:
    late_ns = 1_800_000_000_000_000_000
    plant = AnglePlant(AngleConfig(), period_ns=MS, seed=1, parameters=shipped())
    plant.advance(late_ns)
    card = Acquisition(plant, start_ns=plant.now_ns)
    first = card.read_due()
    assert card.times_ns(first)[0] == late_ns
    assert card.times_ns(first)[-1] == late_ns + round(95 * 1e9 / 9600)
    other = AnglePlant(AngleConfig(), period_ns=MS, seed=1, parameters=shipped())
    other.advance(0)
    assert np.array_equal(Acquisition(other, start_ns=0).read_due().volts, first.volts)


def test_repeated_time_does_nothing_and_earlier_is_refused() -> None:
    plant = make_plant()
    plant.advance(5 * MS)
    steps = plant.steps
    plant.advance(5 * MS)
    assert plant.steps == steps
    with pytest.raises(ValueError, match="cannot go back to 4000000"):
        plant.advance(4 * MS)


def test_every_push_back_begins_run_with_own_scatter() -> None:
    plant = make_plant()
    starts, surfaces = [], []
    for _ in range(3):
        plant.change("platform", "start")
        starts.append(tuple(mean_volts(plant, 0.2)[2:4].round(3)))
        surfaces.append(plant._run.surface)
        plant.command(True)
        pass_time(plant, 0.3)
        plant.command(False)
        pass_time(plant, 1.0)
        assert truth(plant, "platform_position") > 0.1
    assert len(set(starts)) == len(set(surfaces)) == 3
    wheel_v, platform_v = np.array(starts).T
    pots = shipped().potentiometers
    assert wheel_v / pots.volts_per_rad == pytest.approx(pots.wheel_start, abs=1.0)
    assert platform_v / pots.volts_per_rad * pots.pulley == pytest.approx(0.09, abs=0.003)


def test_push_back_leaves_wheel_at_rest_with_breakaway() -> None:
    """Two runs without scatter between them are the same, to within a step of the relay."""
    plant, torques = make_plant(noise=False), []
    for _ in range(2):
        plant.change("platform", "start")
        pass_time(plant, 1e-3)
        assert plant.resting
        assert not any(truth(plant, name) for name in ("platform_speed", "wheel_speed", "torque"))
        plant.command(True)
        began = plant.steps
        pass_time(plant, 0.2)
        rows = (began + np.arange(3800)) % layout.HISTORY_ROWS
        torques.append(plant.history[rows, layout.HISTORY.index("torque")])
        plant.command(False)
        pass_time(plant, 1.8)
    first, second = torques
    assert second.max() == pytest.approx(first.max(), rel=0.03)
    np.testing.assert_allclose(second[2000:], first[2000:], rtol=0.01)


def test_resting_plant_skips_integration() -> None:
    plant = make_plant()
    before = plant._state.copy()
    pass_time(plant, 3.0)
    assert plant.resting
    for name in ("rotor", "wheel", "x", "y", "z"):
        assert plant._state[name] == before[name]


@pytest.mark.parametrize(
    ("quantity", "value", "message"),
    [
        ("floor", "pvc", "no 'floor'; it can change angle, wheel, load"),
        ("angle", 0.3, "angle cannot be 17.1887 deg: it takes 0, 15, 30, 45 deg"),
        ("angle", "steep", "angle cannot be 'steep'"),
        ("wheel", "square", "it takes clean, coated"),
        ("load", 0.2, "it takes 1 kg to 12 kg"),
        ("load", math.nan, "it takes 1 kg to 12 kg"),
        ("voltage", 24.0, "it takes 0 V to 12 V"),
        ("platform", "middle", "it takes start, end"),
        ("push", 9.0, "it takes -2 m/s to 2 m/s"),
        ("wheel_lift", "up", "it takes lifted, down"),
        ("shaft", "bent", "it takes free, clamped"),
        ("arm_mass", 3.0, "clamp the shaft first"),
        ("scale_weight", -1.0, "it takes 0 kg to 50 kg"),
        ("rubbing", -0.1, "it takes 0 N m to 2 N m"),
        ("fault", "fire", "it takes none, gauges_swapped"),
    ],
)
def test_an_impossible_change_is_refused(quantity: str, value: float | str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_plant().change(quantity, value)


def test_unpublished_combination_can_be_mounted_but_not_run() -> None:
    """Either of angle and wheel may be changed first; nothing but a run asks for both."""
    plant = make_plant("clean_45")
    plant.change("wheel", "coated")
    with pytest.raises(ValueError, match=r"friction .*coated wheel at 45"):
        plant.command(True)
    with pytest.raises(ValueError, match="no friction is published"):
        plant.change("platform", "start")
    assert np.isfinite(mean_volts(plant, 0.02)).all()
    plant.change("angle", 0.0)
    plant.change("platform", "start")
    plant.command(True)
    pass_time(plant, 0.1)
    assert truth(plant, "platform_speed") > 0.0


@pytest.mark.parametrize("place", ["start", "end"])
def test_driven_or_clamped_platform_cannot_be_pushed(place: str) -> None:
    plant = make_plant()
    plant.command(True)
    with pytest.raises(ValueError, match="the relay is closed"):
        plant.change("platform", place)
    plant.command(False)
    plant.change("shaft", "clamped")
    with pytest.raises(ValueError, match="the shaft is clamped"):
        plant.change("platform", place)


def test_rig_file_gives_set_up_with_units() -> None:
    config = AngleConfig.model_validate({"angle": "45 deg", "load": "8 kg", "voltage": "7 V"})
    plant = AnglePlant(config, period_ns=MS, seed=1, parameters=shipped())
    assert plant._bench.angle == pytest.approx(math.pi / 4)
    assert plant._bench.limit == shipped().limits.clean_45
    with pytest.raises(ValueError, match="has no unit"):
        AngleConfig.model_validate({"load": "8"})
    with pytest.raises(ValueError, match="it takes 0, 15, 30, 45 deg"):
        AngleConfig.model_validate({"angle": "20 deg"})


def test_the_parameter_file_is_attached_to_recordings() -> None:
    path = AngleConfig.find_parameters("approach_angle")
    assert AngleConfig().files() == {path: path.read_text("utf-8")}


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("mass: 3 kg", "mass: 3 m", ["platform.mass", "is in m, expected kg"]),
        ("mass: 3 kg", "weight: 3 kg", ["platform.mass: this key is missing", "unknown key"]),
        ("clean_45: 0.5861", "clean_45: 5.861", ["limits.clean_45"]),
        ("bumper: 0.45 m", "bumper: 0.25 m", ["must lie beyond stop 0.3 m"]),
        ("stiffness: 700 N m/rad", "stiffness: 7e4 N m/rad", ["is too stiff", "at most"]),
        ("inductance: 0.25 mH", "inductance: 1 uH", ["the winding's rate", "is too fast"]),
    ],
)
def test_wrong_parameter_file_is_refused_with_place(
    tmp_path: Path, old: str, new: str, parts: list[str]
) -> None:
    text = AngleConfig.find_parameters("approach_angle").read_text("utf-8")
    assert text.count(old) == 1
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(ConfigError) as caught:
        AngleConfig(parameters=str(file)).read_parameters()
    for part in (*parts, "mine.yaml:", "configs/plants/approach_angle.yaml"):
        assert part in str(caught.value)


def test_angle_parameters_match_the_paper() -> None:
    p = shipped()
    assert p.motor.torque_per_current * 10 / p.motor.resistance == pytest.approx(13.0, rel=2e-3)
    assert 10 / p.motor.back_emf == pytest.approx(45.0, rel=2e-3)
    assert p.shaft.rigidity == pytest.approx(408.4, rel=1e-4)  # G J, N m^2
    assert p.shaft.radius / p.shaft.rigidity == pytest.approx(24.49e-6, rel=1e-3)  # per N m
    assert 3 * p.gravity * p.calibration_arm.length == pytest.approx(6.0, rel=1e-3)  # N m
    assert p.card.resolution(4) == pytest.approx(1.22e-3, rel=1e-3)
    assert p.card.resolution(5) == 2 * p.card.resolution(4)
    pots = p.potentiometers
    assert 2 * math.pi * pots.turns * pots.pulley == pytest.approx(0.942, rel=1e-3)
