"""Streams that are recorded around what they wait for: exactly that, and nothing looks lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.record import Recording

RIG = load_rig("lugre-1")
MS = 1_000_000  #: in ns
TEXT = """\
procedure: bursts
title: Turn to and fro
doc: For tests.
parameters:
  past: {doc: How long before, unit: ms, default: 30 ms}
derived:
  own.way: {is: 2 * wheel_encoder.angle}
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.5 A, frequency: 2 Hz}}}
      for: 1.1 s
record:
  wheel_servo: 1
  own: {when: wheel_servo.current > 0.45 A, before: "${past}", after: 20 ms}
  carriage:
    every: 3
    when: [wheel_servo.current > 0.45 A, wheel_servo.current < -0.45 A for 5 ms]
    before: 30 ms
    after: 1 ms
"""


def compiled(text: str) -> RunRequest:
    procedure = compile_procedure(parse_procedure(text, Path("bursts.yaml")), RIG)
    return RunRequest(procedure, text, RIG, 1)


def around(times_ns: np.ndarray, met: np.ndarray, before_ms: int, after_ms: int) -> np.ndarray:
    """Return which times are around those at which it was met, the slow way."""
    inside = np.zeros(len(times_ns), bool)
    for at in times_ns[met]:
        inside |= (times_ns >= at - before_ms * MS) & (times_ns <= at + after_ms * MS)
    return inside


def test_only_rows_around_condition_are_recorded(tmp_path: Path) -> None:
    request = compiled(TEXT)
    run = perform(
        RunRequest(request.procedure, TEXT, RIG, 1, output=tmp_path / "b.mcap"), Control()
    )
    assert run.result.exit_code == 0, run.result.reason
    recording = Recording.open(run.path)
    servo, own = recording.read("wheel_servo"), recording.read("own")
    times_ns, current = servo["t_ns"], servo["current"]
    wanted = around(times_ns, current > 0.45, 30, 20)
    assert 0 < np.count_nonzero(wanted) < 0.6 * len(wanted)
    assert np.array_equal(own["t_ns"], times_ns[wanted])
    assert not np.any(np.isnan(own["way"]))
    thinned = recording.read("carriage")["t_ns"]
    assert len(thinned) > len(own) / 6
    assert np.all(np.diff(thinned) >= 3 * MS)
    assert set(thinned) <= set(times_ns[around(times_ns, abs(current) > 0.45, 30, 1)])
    events = [item.data for item in recording.events() if item.kind == "capture"]
    ones = [item["recorded"] for item in events if item["stream"] == "own"]
    assert ones == [True, False, True, False, True][: len(ones)]
    assert len(ones) >= 4
    assert recording.info.gaps == ()


def test_end_of_run_does_not_cut_what_follows(tmp_path: Path) -> None:
    text = TEXT.replace("for: 1.1 s", "for: 0.12 s").replace("after: 20 ms", "after: 500 ms")
    request = compiled(text)
    path = tmp_path / "b.mcap"
    perform(RunRequest(request.procedure, text, RIG, 1, output=path), Control())
    recording = Recording.open(path)
    servo = recording.read("wheel_servo")
    first = servo["t_ns"][np.argmax(servo["current"] > 0.45)]
    wanted = servo["t_ns"][servo["t_ns"] >= first - 30 * MS]
    assert np.array_equal(recording.read("own")["t_ns"], wanted)


@pytest.mark.parametrize("every", [7, 401])
def test_many_captures_of_slow_stream_are_kept(tmp_path: Path, every: int) -> None:
    text = TEXT[: TEXT.index("record:")].replace("frequency: 2 Hz", "frequency: 100 Hz")
    text += "record:\n  wheel_servo: 1\n"
    text += f"  carriage: {{every: {every}, when: wheel_servo.current > 0.3 A, "
    text += "before: 1 ms, after: 1 ms}\n"
    path = tmp_path / "b.mcap"
    run = perform(RunRequest(compiled(text).procedure, text, RIG, 1, output=path), Control())
    assert run.result.exit_code == 0, run.result.reason
    servo, carriage = (
        Recording.open(path).read("wheel_servo"),
        Recording.open(path).read("carriage"),
    )
    slots = servo["t_ns"] // MS
    first = carriage["t_ns"][0] // MS
    assert len(carriage) > 0
    inside = around(servo["t_ns"], servo["current"] > 0.3, 1, 1) & ((slots - first) % every == 0)
    assert np.array_equal(carriage["t_ns"], servo["t_ns"][inside])


@pytest.mark.parametrize(
    ("old", "new", "token", "part"),
    [
        ("wheel_servo.current > 0.45 A,", "wheel_servo.curent > 0.45 A,", "wheel_servo.curent", ""),
        ("> 0.45 A, before", "> 0.45 V, before", "0.45 V", "expected A"),
        ('before: "${past}"', "before: 1000 h", "1000 h", "more than 64 MB"),
        ('before: "${past}"', "before: 0 s", "0 s", "above 0 s"),
        ("  own: {when", "  cycle: {when", "cycle: {when", "always recorded whole"),
        (
            "record:\n",
            "identify:\n  model: lugre\n  signals: {wheel_angle: own.way}\nrecord:\n",
            "own.way}",
            "trials would lack rows",
        ),
    ],
)
def test_wrong_capture_is_named_with_its_place(old: str, new: str, token: str, part: str) -> None:
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    with pytest.raises(ConfigError) as caught:
        compiled(text)
    problems = [caught.value, *caught.value.others]
    found = [item for item in problems if part in item.message]
    offset = text.index(token, text.index("identify:" if "identify" in new else "record:"))
    line = text.count("\n", 0, offset) + 1
    assert line in [item.place.line for item in found if item.place], problems


def test_slow_device_is_not_held() -> None:
    rig = load_rig("wire-1")
    text = TEXT[: TEXT.index("derived:")] + (
        "trial:\n  steps:\n    - {step: a, for: 1 s}\n"
        "record:\n  scale: {when: wheel_servo.current > 1 A, before: 1 s, after: 1 s}\n"
    )
    with pytest.raises(ConfigError) as caught:
        compile_procedure(parse_procedure(text, Path("slow.yaml")), rig)
    problems = [caught.value, *caught.value.others]
    assert any("read beside the cycle" in item.message for item in problems)
