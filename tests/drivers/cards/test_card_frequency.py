"""The frequency and the width of pulses at a counter of a card."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from rigd.config.loader import load_rig
from rigd.model.errors import ConfigError
from rigd_drivers.cards.card import Train
from rigd_drivers.cards.frequency import STANDING, CardFrequency, CardFrequencyConfig
from rigd_drivers.cards.ni_io.config import NiIoConfig
from rigd_drivers.cards.ni_io.link import NiIo


class Bench:
    """A device on a card that is not open, and whose counter the test turns."""

    def __init__(self, **options: Any) -> None:
        self.card = NiIo(NiIoConfig())
        config = CardFrequencyConfig.model_validate({"counter": 0, **options})
        self.device = CardFrequency(config, self.card)
        self.device.reserve()
        self.card.sampled_ns = 10**12

    def after(self, seconds: float, *periods_s: float, duty: float = 0.5) -> list[float]:
        """Return the row of a cycle ``seconds`` after the last, in which these periods ended."""
        self.card.sampled_ns += round(seconds * 1e9)
        before, total = self.card.trains[0], sum(periods_s)
        self.card.trains[0] = Train(
            before.pulses + len(periods_s), before.periods_s + total, before.high_s + total * duty
        )
        return self.device.read(0)


def test_frequency_is_the_mean_of_a_cycle() -> None:
    bench = Bench()
    bench.after(0.01, 0.004)
    assert bench.after(0.01, 0.004, 0.006) == [pytest.approx(200.0), pytest.approx(200.0), 0]


def test_first_pulse_measures_nothing() -> None:
    bench = Bench()
    assert bench.after(0.01, 1e-5) == [0.0, 0.0, STANDING]
    assert bench.after(0.01) == [0.0, 0.0, STANDING]
    assert bench.after(0.2, 0.21)[0] == pytest.approx(1 / 0.21)


def test_frequency_holds_between_regular_pulses() -> None:
    bench = Bench()
    bench.after(0.01, 0.1)
    bench.after(0.1, 0.1)
    rows = [bench.after(0.01) for _ in range(9)]
    assert all(row == [pytest.approx(10.0), pytest.approx(10.0), 0] for row in rows)


def test_frequency_falls_while_no_pulse_comes() -> None:
    bench = Bench(slowest="0.5 Hz")
    bench.after(0.01, 0.1)
    bench.after(0.1, 0.1)
    bench.after(0.01)
    assert bench.after(0.5)[0] == pytest.approx(2.0)
    assert bench.after(1.0)[0] == pytest.approx(1 / 1.5)


def test_standing_shaft_reads_zero_after_longest_period() -> None:
    bench = Bench(slowest="2 Hz")
    bench.after(0.01, 0.1)
    bench.after(0.1, 0.1)
    bench.after(0.01)
    assert bench.after(0.49)[2] == 0
    assert bench.after(0.02) == [0.0, 0.0, STANDING]


def test_period_over_a_stand_is_not_shown() -> None:
    bench = Bench()
    bench.after(0.01, 0.1)
    bench.after(0.1, 0.1)
    bench.after(0.01)
    bench.after(43.0)
    assert bench.after(0.01, 0.003)[0] == 0.0  # the counter has wrapped: not 333 Hz
    assert bench.after(0.05, 0.05)[0] == pytest.approx(20.0)


def test_flow_follows_the_factor() -> None:
    bench = Bench(name="flow", unit="m^3/s", scale="0.5 cm^3/count")
    bench.after(0.01, 0.01)
    flow, frequency, _ = bench.after(0.01, 0.01)
    assert frequency == pytest.approx(100.0)
    assert flow == pytest.approx(50e-6)


def test_speed_in_rpm_is_recorded_in_si() -> None:
    bench = Bench(name="speed", unit="rpm", scale="1 rev/count")
    bench.after(0.01, 0.02)
    assert bench.after(0.02, 0.02)[0] == pytest.approx(50 * 2 * math.pi)
    channel = bench.device.declare(bench.device.config).channels[0]
    assert (channel.unit, channel.shown_in) == ("rad/s", "rpm")


def test_width_and_duty_are_unknown_while_standing() -> None:
    bench = Bench(width=True, slowest="100 Hz")
    bench.after(0.001, 0.002)
    frequency, raw, width, duty, status = bench.after(0.004, 0.002, 0.002, duty=0.25)
    assert (frequency, raw) == pytest.approx((500.0, 500.0))
    assert (width, duty) == pytest.approx((0.5e-3, 0.25))
    assert status == 0
    bench.after(0.001)
    frequency, _, width, duty, status = bench.after(0.02)
    assert (frequency, status) == (0.0, STANDING)
    assert math.isnan(width)
    assert math.isnan(duty)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"unit": "rpm"}, "needs `scale`: the quantity per pulse, in rpm s/count"),
        ({"unit": "rpm", "scale": "1 mm/count"}, "scale '1 mm/count' is not in rpm s/count"),
        ({"unit": "rpm", "scale": "0 rev/count"}, "must not be 0"),
        ({"slowest": "0.01 Hz"}, "slowest"),
        ({"slowest": "1 s"}, "slowest"),
        ({"counter": -1}, "counter"),
    ],
)
def test_pulses_without_meaning_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CardFrequencyConfig.model_validate({"counter": 0, **options})


RIG = """\
rig: flow-1
title: A flow meter
cycle: 100 Hz

links:
  card: {link}

devices:
  flow:
    driver: card-frequency
    link: card
    options: {{counter: {counter}, unit: L/min, scale: 0.5 cm^3/count}}
  other:
    driver: {driver}
    link: card
    options: {{{options}}}

interlocks: []
"""


@pytest.mark.parametrize(
    ("link", "counter", "driver", "options", "place", "words"),
    [
        ("{type: ni-card}", 1, "card-encoder", "encoder: 1, quantity: angle, "
         "counts_per_revolution: 4096 count/rev", "16:24", "counter 1 is used twice"),
        ("{type: ni-card}", 1, "card-frequency", "counter: 1", "16:24", "is used twice"),
        ("{type: ni-card, options: {edge_counters: [1]}}", 1, "card-frequency", "counter: 0",
         "12:24", "counter 1 counts edges"),
        ("{type: ni-card}", 9, "card-frequency", "counter: 0", "12:24", "it has 0 to 7"),
        ("{type: mf624}", 1, "card-frequency", "counter: 0", "12:24", "cannot time pulses"),
    ],
)  # fmt: skip
def test_wrong_counter_is_named_with_its_line(
    tmp_path: Path, link: str, counter: int, driver: str, options: str, place: str, words: str
) -> None:
    file = tmp_path / "flow.yaml"
    file.write_text(RIG.format(link=link, counter=counter, driver=driver, options=options))
    with pytest.raises(ConfigError) as caught:
        load_rig(str(file))
    assert f"flow.yaml:{place}" in str(caught.value)
    assert words in str(caught.value)


def test_wrong_options_are_named_with_their_line(tmp_path: Path) -> None:
    file = tmp_path / "flow.yaml"
    text = RIG.format(
        link="{type: ni-card}", counter=0, driver="card-frequency", options="counter: 1"
    )
    file.write_text(text.replace("0.5 cm^3/count", "0.5 mm/count"))
    with pytest.raises(
        ConfigError, match=r"scale '0.5 mm/count' is not in L/min s/count"
    ) as caught:
        load_rig(str(file))
    assert "flow.yaml:12" in str(caught.value)
