"""What further tests are predicted to give is what the estimator gives when they are recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from support.lugre.bench import FLOORS, Bench, known_rig

from rigd.analysis.result import FurtherTest, IdentificationResult, Verdict
from rigd_analyses.lugre.conclusion import identify_output_error
from rigd_analyses.lugre.design.further import open_slips
from rigd_analyses.lugre.trials.trial import LugreTrial

FAST_A = (1.35, 1.43, 1.5)  #: they alone say little of V_s, sigma_1 and g at low slip


def identified(floor: str, trials: Sequence[LugreTrial]) -> IdentificationResult:
    rig = Bench(floor)
    return identify_output_error(trials, rig.constants, known_rig(rig.constants))


def recorded(rig: Bench, currents: Sequence[float], name: str, seed: int) -> list[LugreTrial]:
    return [
        replace(rig.trial(current, seed + k), recording=name) for k, current in enumerate(currents)
    ]


def first(floor: str) -> list[LugreTrial]:
    return recorded(Bench(floor), FAST_A, "first.mcap", 3)


@cache
def before(floor: str) -> IdentificationResult:
    return identified(floor, first(floor))


def further(floor: str, name: str) -> FurtherTest:
    (found,) = (item for item in before(floor).further if item.target == name)
    return found


def half_width(result: IdentificationResult, name: str) -> float:
    """Return the half width of the logarithm of a parameter; infinite if an end is open."""
    entry = result.parameter(name)
    if entry.low is None or entry.high is None or entry.low <= 0.0:
        return math.inf
    return 0.5 * math.log(entry.high / entry.low)


def test_every_open_quantity_has_a_sentence() -> None:
    result = before("stone")
    found = {item.target: item for item in result.further}
    for entry in (*result.parameters, *result.derived):
        if entry.verdict in (Verdict.UNIDENTIFIABLE, Verdict.WEAK):
            assert entry.advice == found[entry.name].sentence
    for item in found.values():
        assert (item.count > 0) == bool(item.test) == (item.half_width is not None)
        assert ("predicted to determine" in item.sentence) == item.certain
    told: Any = result.to_json()["further_tests"]
    assert [item["target"] for item in told] == list(found)


def test_unshown_effect_makes_no_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a Stribeck effect there is no V_s; another test may show one."""
    monkeypatch.setitem(FLOORS, "flat", replace(FLOORS["pvc"], mu_s=FLOORS["pvc"].mu_c))
    found = identified("flat", first("flat")).further
    assert not any(item.certain for item in found)
    (likely, *_) = (item for item in found if item.count)
    assert likely.target in ("V_s", "mu_s")
    assert "may determine it" in likely.sentence
    assert "if friction is that of the best fit, but not with all" in likely.sentence


def test_no_test_is_promised_beyond_all_slip() -> None:
    """That of stone, 2 m/s, is; a fit to its first trials has it far below."""
    speed = further("stone", "V_s")
    assert (speed.count, speed.test) == (0, "")


def test_slip_outside_of_curve_is_open() -> None:
    result = before("stone")
    curve = result.curve
    part = curve.x < 0.012
    ends = {name: getattr(curve, name)[part] for name in ("x", "y", "low", "high")}
    assert not set(open_slips(result)) & {"g@20mm/s", "g@50mm/s"}
    short = replace(result, curve=replace(curve, **ends))
    assert set(open_slips(short)) >= {"g@20mm/s", "g@50mm/s"}


def test_parameter_that_no_test_determines_says_so() -> None:
    for name in ("V_s", "mu_c"):
        none = further("paperboard", name)
        assert none.sentence.startswith(
            "No further test of 7 that were computed (up to 1.5 A, with"
        )
        assert "determines it: V_s of the best fit lies outside of their slip" in none.sentence
        assert (none.test, none.count, none.half_width) == ("", 0, None)
        assert before("paperboard").parameter(name).advice == none.sentence


@pytest.mark.parametrize(
    ("floor", "name"), [("stone", "sigma_1"), ("pvc", "V_s"), ("pvc", "mu_s-mu_c")]
)
def test_advised_test_gives_about_promised_width(floor: str, name: str) -> None:
    promise = further(floor, name)
    assert promise.certain and promise.half_width is not None
    load = 0.5 if "carriage of" in promise.test else 1.0
    current = float(promise.test.split(" A held")[0].rpartition(" ")[2])
    other = replace(Bench(floor), mass_kg=load * Bench(floor).mass_kg)
    second = recorded(other, [current] * promise.count, "second.mcap", 50)
    after = identified(floor, [*first(floor), *(replace(item, load=load) for item in second)])
    assert before(floor).parameter(name).verdict is not Verdict.IDENTIFIABLE
    assert 0.5 < half_width(after, name) / promise.half_width < 2.0
