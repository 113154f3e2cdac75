"""Findings of the doctor on streams and channels watched at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from rigd.config.loader import load_rig, parse_rig
from rigd.config.rig import RigConfig
from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.daemon.doctor.rig import Reason, split_reasons
from rigd.daemon.doctor.statistics import Statistics
from rigd.daemon.doctor.survey import Survey, judge_channel
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, Channel
from rigd.model.rows import row_dtype
from rigd.sdk.shipped_files import shipped_folder

RIG = load_rig("lugre-1")
STREAMS = {stream.name: stream for stream in streams_of(RIG)}


def rows(stream: str, count: int, period_ns: int = 1_000_000) -> Rows:
    made = np.zeros(count, row_dtype(STREAMS[stream]))
    made["t_ns"] = np.arange(count) * period_ns
    return made


def verdict_on(name: str, checks: Sequence[Check]) -> Check:
    (check,) = (item for item in checks if item.name == name)
    return check


def channel(values: Sequence[float], low: float = -math.inf, high: float = math.inf) -> Check:
    seen = Statistics()
    seen.add(np.array(values))
    device = RIG.devices["accelerometer"]
    return judge_channel("channels", device, Channel("acceleration", "m/s^2", "", low, high), seen)


def test_doctor_reports_zero_and_noise_of_channel() -> None:
    check = channel([0.9, 1.1, 0.9, 1.1])
    assert check.verdict is CheckVerdict.OK
    assert check.found == "zero 1 m/s^2, noise 0.115 m/s^2"
    assert check.figures["zero"] == pytest.approx(1.0)


def test_doctor_reports_in_unit_that_people_read() -> None:
    warm = Channel.read_in("degC", "heat", low=273.15, high=573.15)
    device = RIG.devices["accelerometer"]
    seen = Statistics()
    seen.add(np.array([293.1, 293.2]))
    check = judge_channel("channels", device, warm, seen)
    assert check.found == "zero 20 degC, noise 0.0707 K"
    assert (check.figures["unit"], check.figures["zero"]) == ("K", pytest.approx(293.15))
    seen.add(np.array([573.15, 293.1]))
    assert "its range, 300 degC:" in judge_channel("channels", device, warm, seen).advice


def test_channel_at_end_of_its_range_is_saturated() -> None:
    check = channel([1.0, 10.0, 2.0], low=-10.0, high=10.0)
    assert check.verdict is CheckVerdict.WARN
    assert "10 m/s^2" in check.advice


def test_relay_open_at_rest_is_not_saturated() -> None:
    relay = load_rig("angle-1").devices["relay"]
    (closed,) = relay.channels
    for value, verdict in ((0.0, CheckVerdict.OK), (1.0, CheckVerdict.WARN)):
        seen = Statistics()
        seen.add(np.full(10, value))
        assert judge_channel("channels", relay, closed, seen).verdict is verdict


def test_a_channel_without_numbers_fails() -> None:
    assert channel([1.0, math.nan]).verdict is CheckVerdict.FAIL
    assert channel([]).verdict is CheckVerdict.FAIL


DERIVED = """\
derived:
  motion.speed: {is: derivative(carriage.position), where: carriage.position > 1 m}
  motion.twice: {is: 2 * motion.speed}
  motion.last: {is: "hold(carriage.position, carriage.position > 1 m)"}
  motion.share: {is: carriage.position / wheel_encoder.angle}
controllers:
  place: {measured: carriage.position, output: longitudinal_belt.speed, kp: 2 1/s}
interlocks:
"""


@pytest.fixture(scope="module")
def rig() -> RigConfig:
    path = shipped_folder("configs") / "sim_lugre.yaml"
    return parse_rig(path.read_text("utf-8").replace("interlocks:\n", DERIVED, 1), path)


def test_controller_at_rest_is_not_saturated(rig: RigConfig) -> None:
    place = rig.devices["place"]
    for active in place.channels:
        seen = Statistics()
        seen.add(np.zeros(10))
        assert judge_channel("channels", place, active, seen).verdict is CheckVerdict.OK


@pytest.mark.parametrize(
    ("name", "verdict", "said"),
    [
        ("speed", CheckVerdict.OK, "`where` or `hold` does not hold"),
        ("twice", CheckVerdict.OK, "`where` or `hold` does not hold"),
        ("last", CheckVerdict.OK, "`where` or `hold` does not hold"),
        ("share", CheckVerdict.WARN, "1 of 2 values are not a number"),
    ],
)
def test_derived_channel_without_value_is_fit(
    rig: RigConfig, name: str, verdict: CheckVerdict, said: str
) -> None:
    motion = rig.devices["motion"]
    seen = Statistics()
    seen.add(np.array([math.nan, 1.0]))
    (channel,) = (item for item in motion.channels if item.name == name)
    check = judge_channel("channels", motion, channel, seen)
    assert check.verdict is verdict
    assert said in check.found
    assert bool(check.advice) is (verdict is not CheckVerdict.OK)


def test_constant_channel_is_reported() -> None:
    assert "constant" in channel([0.5, 0.5, 0.5]).found


def test_device_is_judged_by_rate_and_stale_rows() -> None:
    survey = Survey(RIG)
    survey.take("carriage", rows("carriage", 1000))
    survey.take("wheel_encoder", rows("wheel_encoder", 800, 1_250_000))
    late = rows("wheel_servo", 1000)
    late["status"][:20] |= STALE
    late["current"][:20] = 99.0  # what stands in a stale row is no measurement
    survey.take("wheel_servo", late)
    checks = list(survey.devices("rig"))
    assert verdict_on("carriage", checks).verdict is CheckVerdict.OK
    assert verdict_on("carriage", checks).figures["rate_hz"] == pytest.approx(1000)
    assert verdict_on("wheel_encoder", checks).verdict is CheckVerdict.WARN
    assert "20 of 1000 stale" in verdict_on("wheel_servo", checks).found
    assert verdict_on("accelerometer", checks).verdict is CheckVerdict.FAIL  # it gave nothing
    current = verdict_on("wheel_servo.current", list(survey.channels("channels")))
    assert current.figures["high"] == 0.0


def test_the_cycle_is_judged_by_its_own_stream() -> None:
    survey = Survey(RIG)
    assert next(iter(survey.cycle("rig", {}))).verdict is CheckVerdict.FAIL  # none has run
    cycles = rows("cycle", 2000)
    cycles["scheduled"] = np.arange(2000) * 1e-3
    cycles["actual"] = cycles["scheduled"] + 40e-6
    cycles["spent"] = 700e-6
    survey.take("cycle", cycles[:500])
    survey.take("cycle", cycles[500:])
    late, work, _ = survey.cycle("rig", {})
    assert late.verdict is CheckVerdict.OK
    assert late.figures["cycles"] == 2000
    assert work.verdict is CheckVerdict.WARN  # 70 % of the period


def test_reasons_are_separated_by_their_device() -> None:
    told = [
        "bus: cannot be opened\n  is it up?",
        "scale: nothing answers; is it off; scale_2: shows lb, expected kg\n  press UNIT\n  twice",
        "the cycle process ended by itself",
    ]
    assert split_reasons(told, ["bus", "scale", "scale_2"]) == [
        Reason("bus", "cannot be opened", "is it up?"),
        Reason("scale", "nothing answers; is it off", "press UNIT twice"),
        Reason("scale_2", "shows lb, expected kg", "press UNIT twice"),
        Reason("", "the cycle process ended by itself", ""),
    ]
