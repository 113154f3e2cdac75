"""The suite for plants: a correct one passes, and a fault against each rule is found."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar

import pytest
from annotated_types import Gt, Le
from support.cart import DEVICES, Cart, CartConfig, Motor, Ruler, RulerRow

from rigd.sdk import Energy, In, ParameterGroup, ParametersConfig, PlantConfig
from rigd.sdk.check import NonConforming, check_plant, examine_plant
from rigd.sdk.check.plant.bench import CYCLE_NS, Device
from rigd.sdk.noise import normal_pair
from rigd_sim.approach_angle.daq import AngleDaq
from rigd_sim.approach_angle.plant import AnglePlant
from rigd_sim.approach_angle.relay import AngleRelay
from rigd_sim.approach_angle.sensors import AngleScale, AngleTruth
from rigd_sim.articulated.drive import ArticulatedDrive
from rigd_sim.articulated.plant import ArticulatedPlant
from rigd_sim.articulated.sensors import ArticulatedTracker, ArticulatedTruth
from rigd_sim.lugre.amplifier import LugreAmplifier
from rigd_sim.lugre.belt import LugreBelt
from rigd_sim.lugre.plant import LugrePlant
from rigd_sim.lugre.sensors import LugreAccelerometer, LugreEncoder, LugreTruth

LUGRE: dict[str, Device] = {
    "wheel_servo": (LugreAmplifier, {}),
    "belt": (LugreBelt, {"axis": "longitudinal"}),
    "bridge": (LugreBelt, {"axis": "lateral"}),
    "encoder": (LugreEncoder, {"axis": "wheel"}),
    "accelerometer": (LugreAccelerometer, {}),
    "truth": (LugreTruth, {}),
}
ENERGY = {"energy balances", "friction takes"}
ANGLE: dict[str, Device] = {
    "daq": (AngleDaq, {}),
    "relay": (AngleRelay, {}),
    "scale": (AngleScale, {}),
    "truth": (AngleTruth, {}),
}
ARTICULATED: dict[str, Device] = {
    "right_motor": (ArticulatedDrive, {"module": "front", "wheel": "front_right"}),
    "left_motor": (ArticulatedDrive, {"module": "front", "wheel": "rear_left"}),
    "marker": (ArticulatedTracker, {"module": "rear"}),
    "truth": (ArticulatedTruth, {"module": "front"}),
}


class Nameless(Cart):
    title: ClassVar[str] = ""


class BareConfig(CartConfig):
    gain: float = 1.0


class Bare(Cart):
    Config: ClassVar[type[PlantConfig]] = BareConfig


class ColouredConfig(CartConfig):
    paint_of_cart: str = "red"
    """Colour of the cart."""


class Unread(Cart):
    Config: ClassVar[type[PlantConfig]] = ColouredConfig


class Waxed(Cart):
    """Its damping stays that of the floor at the start."""

    def __init__(self, config: CartConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        self.kept = config.floor

    def apply(self, quantity: str, value: float | str) -> None:
        super().apply(quantity, value)
        self.floor = self.kept


class Unmade(Cart):
    def __init__(self, config: CartConfig, *, period_ns: int, seed: int) -> None:
        raise RuntimeError("no licence")


class LostConfig(CartConfig):
    def files(self) -> Mapping[Path, str]:
        return {Path("/nowhere/cart.yaml"): "mass: 2 kg"}


class Lost(Cart):
    Config: ClassVar[type[PlantConfig]] = LostConfig


class Gullible(Cart):
    def change(self, quantity: str, value: float | str) -> None:
        """Take anything."""


class Dice(Cart):
    def noise(self) -> float:
        return random.gauss()


class Seedless(Cart):
    def noise(self) -> float:
        return normal_pair(1, self.now_ns - self.origin_ns)[0]


class Stubborn(Cart):
    """Keeps the seed with which it was made."""

    def __init__(self, config: CartConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        self.kept = seed

    def noise(self) -> float:
        return normal_pair(self.kept, self.now_ns - self.origin_ns)[0]


class Absolute(Cart):
    def noise(self) -> float:
        return normal_pair(self.seed, self.now_ns)[0]


class Reversible(Cart):
    def advance(self, t_ns: int) -> None:
        if self.begun and t_ns < self.now_ns:
            return
        super().advance(t_ns)


class Restless(Cart):
    def advance(self, t_ns: int) -> None:
        if self.begun and t_ns == self.now_ns:
            self.step(1e-3)
        super().advance(t_ns)


class OneStep(Cart):
    """Takes one step per call, however long."""

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        self.step(elapsed_ns * 1e-9)


class Drawing(Cart):
    """Draws noise with every call."""

    drawn = 0

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        super().evolve(t_ns, elapsed_ns)
        self.drawn += 1

    def noise(self) -> float:
        return normal_pair(self.seed, self.drawn)[0]


class Hesitant(Motor):
    """Comes closer to its setpoint each time that it is written."""

    def write(self, setpoints: Sequence[float]) -> None:
        before = self.link.force
        super().write(setpoints)
        self.link.force = 0.5 * (before + self.link.force)


class Lazy(Ruler):
    """Waits for another device to advance the plant."""

    def read(self, t_ns: int) -> RulerRow:
        return RulerRow.of(position=self.link.state[0] + 1e-4 * self.link.noise())


class Unclipped(Motor):
    def write(self, setpoints: Sequence[float]) -> None:
        self.link.force = setpoints[0]


class Brittle(Cart):
    """Divides by nothing with oil on the floor."""

    def rates(self, state: Sequence[float]) -> tuple[float, ...]:
        v, rate, supplied, dissipated = super().rates(state)
        return v, math.nan if self.floor == "oiled" else rate, supplied, dissipated


class Perpetual(Cart):
    """Drives itself by its speed, and does not count it."""

    def rates(self, state: Sequence[float]) -> tuple[float, ...]:
        v, rate, supplied, dissipated = super().rates(state)
        return v, rate + 6.0 * v, supplied, dissipated


class Leaky(Cart):
    """Loses what it does not count."""

    def rates(self, state: Sequence[float]) -> tuple[float, ...]:
        v, rate, supplied, dissipated = super().rates(state)
        return v, rate, supplied, 0.5 * dissipated


class Generous(Cart):
    """Friction that gives back, in balance."""

    def energy(self) -> Energy | None:
        found = super().energy()
        assert found is not None
        given = 0.5 * found.stored
        return Energy(found.stored, found.supplied + given, found.dissipated + given)


class Unsafe(Motor):
    def make_safe(self) -> None:
        """Go on pushing."""


class Pushed(Motor):
    """Pushes with all force once it was made safe."""

    def make_safe(self) -> None:
        self.link.force = 20.0


class Euler(Cart):
    """States order 2, and has order 1."""

    def step(self, step_s: float) -> None:
        pairs = zip(self.state, self.rates(self.state), strict=True)
        x, v, supplied, dissipated = (value + step_s * rate for value, rate in pairs)
        self.state = x, v, supplied, dissipated


class PerStep(Cart):
    """A friction that acts once per step, with any length."""

    def step(self, step_s: float) -> None:
        super().step(step_s)
        x, v, supplied, dissipated = self.state
        self.state = x, 0.999 * v, supplied, dissipated


def motor(driver: type[Motor]) -> dict[str, Device]:
    return {**DEVICES, "motor": (driver, {})}


def test_a_correct_plant_keeps_every_rule() -> None:
    report = check_plant(Cart, devices=DEVICES, truth="truth")
    assert report.skipped == {}
    assert {"energy balances", "passive", "halved step", "finite"} <= set(report.checked)


@pytest.mark.parametrize(
    ("plant", "rule", "words"),
    [
        (Nameless, "title", "title is ''"),
        (Bare, "options", "gain is a bare float"),
        (Bare, "options", "gain has no documentation"),
        (Unmade, "constructor", "raises RuntimeError: no licence"),
        (Lost, "files", "/nowhere/cart.yaml, which is no such file"),
        (Gullible, "settings", "change('floor', 'no such value') is accepted"),
        (Gullible, "settings", "change('mass', nan) is accepted"),
        (Gullible, "settings", "change('no_such_setting_', 1.0) is accepted"),
        (Dice, "any sequence", "other rows if another plant is played beside it"),
        (Seedless, "any sequence", "plants of two seeds show the same rows"),
        (Stubborn, "any sequence", "trials of two seeds show the same rows"),
        (Absolute, "any sequence", "other rows begun at"),
        (Reversible, "any sequence", "earlier time is accepted"),
        (Restless, "any sequence", "of truth differs"),
        (OneStep, "any sequence", "of truth differs"),
        (Drawing, "any sequence", "of ruler differs"),
        (Unread, "everything is read", "nothing reads paint_of_cart of ColouredConfig"),
        (Waxed, "settings from the start", "floor at oiled from the start, and set after"),
        (Brittle, "finite", "NaN to integer with floor at oiled"),
        (Perpetual, "energy balances", "J are created"),
        (Leaky, "energy balances", "J are lost"),
        (Generous, "friction takes", "friction gives"),
        (Euler, "halved step", "expected 4 of order 2"),
        (PerStep, "halved step", "changes the truth by"),
    ],
)
def test_check_plant_finds_each_broken_rule(plant: type[Cart], rule: str, words: str) -> None:
    with pytest.raises(NonConforming) as caught:
        check_plant(plant, devices=DEVICES, truth="truth", only={rule})
    assert any(words in finding.problem for finding in caught.value.report.findings), str(
        caught.value
    )


@pytest.mark.parametrize(
    ("driver", "rule", "words"),
    [
        (Unclipped, "finite", "NaN to integer"),
        (Hesitant, "any sequence", "as its time is divided"),
        (Pushed, "passive", "the actuators supply"),
    ],
)
def test_a_fault_of_a_device_is_found(driver: type[Motor], rule: str, words: str) -> None:
    report = examine_plant(Cart, devices=motor(driver), truth="truth", only={rule})
    assert any(words in finding.problem for finding in report.findings), str(report)


def test_device_that_does_not_advance_is_found() -> None:
    devices: dict[str, Device] = {**DEVICES, "ruler": (Lazy, {})}
    (finding,) = examine_plant(Cart, devices=devices, truth="truth").findings
    assert finding.rule == "any sequence"
    assert "of ruler differs" in finding.problem


class Weight(ParameterGroup):
    """A parameter file."""

    mass: Annotated[float, In("kg"), Gt(0), Le(10)]
    """Mass."""
    length: Annotated[float, In("m")]
    """Any length at all."""
    ratio: float


class WeighedConfig(ParametersConfig):
    """Options with a parameter file."""

    parameters: str = "weight.yaml"
    """File of physical parameters."""

    @classmethod
    def parameter_model(cls) -> type[ParameterGroup]:
        return Weight


def test_a_parameter_without_bounds_is_found(tmp_path: Path) -> None:
    (tmp_path / "weight.yaml").write_text("mass: 2 kg\nlength: 10 mm\nratio: 1\n", "utf-8")

    class Here(WeighedConfig):
        shipped_folder: ClassVar[Path] = tmp_path

    class Weighed(Cart):
        Config: ClassVar[type[PlantConfig]] = Here

    report = examine_plant(Weighed, only={"parameters"})
    assert [finding.problem for finding in report.findings] == [
        "ratio is a bare float",
        "ratio has no documentation",
        "length takes any number: 1e30 and -1e30 mm are accepted",
        "ratio takes any number: 1e30 and -1e30 1 are accepted",
    ]


def test_skipped_checks_are_named() -> None:
    report = examine_plant(Cart)
    assert report.findings == ()
    assert report.skipped["any sequence"] == "no devices were given"
    assert report.skipped["halved step"] == "no truth was named"
    with pytest.raises(ValueError, match="no device 'tooth'; there are motor"):
        examine_plant(Cart, devices=DEVICES, truth="tooth")
    with pytest.raises(ValueError, match="no rule speed"):
        examine_plant(Cart, only={"speed"})
    with pytest.raises(ValueError, match=r"options .*not accepted"):
        examine_plant(Cart, {"mass": "2 m"})


def test_option_that_setting_does_not_take_is_refused() -> None:
    with pytest.raises(ValueError, match=r"floor .*'wet': .*dry, oiled"):
        Cart(CartConfig(floor="wet"), period_ns=CYCLE_NS, seed=1)


def test_lugre_plant_keeps_every_rule() -> None:
    report = check_plant(LugrePlant, devices=LUGRE, truth="truth", accuracy=0.002)
    assert report.skipped == {}


@pytest.mark.parametrize("options", [{}, {"floor": "paperboard", "mass": "9 kg"}])
def test_lugre_wheel_alone_balances_its_energy(options: Mapping[str, object]) -> None:
    """The belts turn over so much energy that they hide what the contact loses."""
    devices = {name: device for name, device in LUGRE.items() if name not in ("belt", "bridge")}
    report = check_plant(LugrePlant, options, devices=devices, accuracy=1e-3, only=ENERGY)
    assert set(report.checked) == ENERGY


def test_angle_plant_keeps_every_rule() -> None:
    report = check_plant(AnglePlant, devices=ANGLE, truth="truth")
    assert report.skipped == {"halved step": "the plant states no step_ns"}  # 1/19200 s is none


@pytest.mark.parametrize(
    "options",
    [{"angle": "45 deg", "voltage": "10 V"}, {"angle": "15 deg", "load": "8 kg", "drag": False}],
)
def test_angle_plant_balances_energy_as_set_up(options: Mapping[str, object]) -> None:
    report = check_plant(AnglePlant, options, devices=ANGLE, accuracy=1e-3, only=ENERGY)
    assert set(report.checked) == ENERGY


@pytest.mark.parametrize("law", ["paper", "smooth", "linear"])
def test_articulated_plant_keeps_every_rule(law: str) -> None:
    report = check_plant(ArticulatedPlant, {"law": law}, devices=ARTICULATED, truth="truth")
    assert report.skipped == {}


@pytest.mark.parametrize("loads", ["transfer", "vertical"])
def test_robot_on_its_suspension_keeps_its_energy(loads: str) -> None:
    check_plant(
        ArticulatedPlant, {"loads": loads}, devices=ARTICULATED, accuracy=1e-5,
        only={*ENERGY, "passive", "finite", "any sequence"},
    )  # fmt: skip
