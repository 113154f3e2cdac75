"""A description that no mechanism has is refused in one sentence, with its line and column."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest

from rigd.model.errors import ConfigError
from rigd_sim.mechanism.plant import MechanismConfig

GOOD = """\
bodies:
  motor: {inertia: 1e-4 kg m^2}
  disk: {inertia: 2e-3 kg m^2}
  pin: {mass: 0.2 kg}
gears:
  reducer: {between: [motor, disk], ratio: 10}
springs:
  arm: {between: [pin, ground], stiffness: 50 kN/m, damping: 5 N s/m}
friction:
  contact:
    between: [disk, pin]
    radius: 30 mm
    load: 2 kg
    law: {kind: coulomb, coulomb: 0.3}
drives:
  spindle: {body: disk, mode: speed, limit: 2 N m, speed_limit: 50 rad/s, gain: 0.5 N m s/rad}
sensors:
  cell: {measures: force, of: arm, low: -20 N, high: 20 N}
"""


def problems(folder: Path, text: str) -> list[str]:
    """Return what is wrong, each as ``LINE:COLUMN: sentence``."""
    path = folder / "plant.yaml"
    path.write_text(text, "utf-8")
    try:
        MechanismConfig(parameters=str(path)).mechanism()
    except ConfigError as error:
        return [
            f"{item.place.line}:{item.place.column}: {item.message}"
            for item in (error, *error.others)
            if item.place is not None
        ]
    return []


def test_a_good_description_is_accepted(tmp_path: Path) -> None:
    assert problems(tmp_path, GOOD) == []


@pytest.mark.parametrize(
    ("old", "new", "where", "words"),
    [
        ("pin: {mass: 0.2 kg}", "pin: {}", "4:8", "pin has no mass: give its 'mass' if"),
        ("pin: {mass: 0.2 kg}", "pin: {mass: 0 kg}", "4:8", "pin has no mass"),
        ("pin: {mass: 0.2 kg}", "pin: {mass: 1 kg, inertia: 1 kg m^2}", "4:8", "not both"),
        ("pin: {mass: 0.2 kg}", "pin: {mass: 0.2 kg}\n  ground: {mass: 1 kg}", "5:11",
         "'ground' is"),
        ("body: disk,", "body: dsk,", "16:19", "no body 'dsk'; did you mean 'disk'?"),
        ("body: disk,", "body: ground,", "16:19", "acts on nothing"),
        ("[pin, ground]", "[pin, pin]", "8:18", "both ends are on pin"),
        ("[pin, ground]", "[pin, disk]", "8:8", "give the 'radius' at which they touch"),
        ("50 kN/m", "50 kN", "8:44", "expected N/m"),
        ("50 kN/m", "-1 N/m", "8:44", "must be at least 0"),
        ("stiffness: 50 kN/m, damping: 5 N s/m", "stiffness: 0", "8:8", "it does nothing"),
        ("ratio: 10", "ratio: 0", "6:12", "give the 'ratio'"),
        ("ratio: 10}", "ratio: 10}\n  belt: {between: [disk, motor], ratio: 2}", "7:9",
         "belt closes a loop: disk and motor are coupled already, through reducer, belt"),
        ("[motor, disk]", "[motor, ground]", "6:30", "coupled to the ground it cannot move"),
        ("    radius: 30 mm\n", "", "11:5", "give the 'radius'"),
        ("load: 2 kg", "load: 2 m", "13:11", "expected a mass or a force"),
        ("load: 2 kg", "load: 2 kg\n    most_load: 1 kg", "14:16", "must be at least 'load', 2 kg"),
        ("load: 2 kg", "pressed_by: arms", "13:17", "no spring 'arms'; did you mean 'arm'?"),
        ("kind: coulomb, coulomb: 0.3", "kind: lugre, coulomb: 0.3", "14:10", "needs 'static'"),
        ("kind: coulomb, coulomb: 0.3", "kind: viscous, viscous: 1 s/m, coulomb: 0.3", "14:51",
         "law viscous has no 'coulomb'"),
        ("kind: coulomb, coulomb: 0.3",
         "kind: stribeck, coulomb: 0.3, static: 0.2, stribeck_speed: 1 m/s", "14:49",
         "'static', 0.2, is below 'coulomb', 0.3"),
        ("gain: 0.5 N m s/rad", "gain: 0.5 N m s/rad, supply: 24 V", "16:104",
         "mode speed has no 'supply'"),
        (", gain: 0.5 N m s/rad", "", "16:12", "mode speed needs 'gain'"),
        ("limit: 2 N m,", "limit: 50 mN m,", "16:67",
         "the drive cannot reach 50 rad/s: friction takes 0.176"),
        ("mode: speed, limit: 2 N m, speed_limit: 50 rad/s, gain: 0.5 N m s/rad",
         "mode: current, limit: 6 A, torque_constant: 50 mN m/A, supply: 24 V, resistance: 5 ohm",
         "16:47", "the drive cannot reach 6 A: 24 V over 5 ohm give 4.8 A"),
        ("of: arm", "of: amr", "18:31", "no spring, friction or drive 'amr'; did you mean 'arm'?"),
        ("low: -20 N", "low: 1 N", "18:9", "cell reads 0 N at rest, outside its range of 1 N to"),
        ("high: 20 N", "high: -30 N", "18:54", "must be more than 'low'"),
        ("measures: force, of: arm", "measures: force, of: spindle", "18:20", "measure 'torque'"),
        ("measures: force, of: arm", "measures: load, of: arm", "18:30",
         "friction with a load 'arm'"),
        ("pin: {mass: 0.2 kg}", "pin: {mass: 1e-12 kg}", "4:8", "too fast to be integrated"),
        ("  cell:", "  contact:\n    measures: force\n    of: arm\n    low: 0\n"
         "    high: 0\n  cell:",
         "22:11", "must be more than"),
        ("sensors:", "stops:\n  arm: {body: pin, low: 0, high: 0, stiffness: 1 N/m}\nsensors:",
         "18:8", "'arm' is the name of one of the springs too"),
    ],
)  # fmt: skip
def test_each_impossible_description_has_its_place(
    tmp_path: Path, old: str, new: str, where: str, words: str
) -> None:
    assert old in GOOD
    found = problems(tmp_path, GOOD.replace(old, new, 1))
    assert len(found) == 1, found
    assert found[0].startswith(f"{where}: "), found
    assert words in found[0]
    assert "\n" not in found[0]


def test_contact_pressed_by_a_pull_is_refused(tmp_path: Path) -> None:
    text = GOOD.replace("load: 2 kg", "pressed_by: arm")
    assert problems(tmp_path, text.replace("5 N s/m}", "5 N s/m, preload: -3 N}")) == []
    (found,) = problems(tmp_path, text.replace("5 N s/m}", "5 N s/m, preload: 3 N}"))
    assert found.startswith("8:80: "), found
    assert "3 N pulls, and the compression of arm presses contact" in found
    assert "write '-3 N'" in found


def test_massless_body_between_two_springs_is_named(tmp_path: Path) -> None:
    text = GOOD.replace("  pin: {mass: 0.2 kg}", "  pin: {mass: 0.2 kg}\n  joint: {mass: 0 kg}")
    text = text.replace("friction:", textwrap.indent(
        "one: {between: [pin, joint], stiffness: 1 N/m}\n"
        "two: {between: [joint, ground], stiffness: 1 N/m}\n", "  ") + "friction:", 1)  # fmt: skip
    (found,) = problems(tmp_path, text)
    assert re.match(r"5:10: bodies.joint: joint between one and two has no mass", found)


def test_all_problems_are_shown_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("of: arm", "of: amr").replace("  pin:", "  pin_:")
    assert [line[:30] for line in problems(tmp_path, text)] == [
        "8:19: springs.arm.between.0: n",
        "11:21: friction.contact.betwee",
    ]


def test_massless_pulley_on_a_shaft_is_accepted(tmp_path: Path) -> None:
    assert problems(tmp_path, GOOD.replace("inertia: 1e-4 kg m^2", "inertia: 0 kg m^2")) == []
