"""The suite finds mistakes by what the device does; ``benchmarks/conformance.py`` makes all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from sdk.mutants.fresh.kinds import AUTHORS
from sdk.mutants.known import Mutant, made, texts
from sdk.mutants.known.kinds import KINDS
from support.cases import some
from support.instruments.memory_motor import Good, motor
from support.written_drivers import KINDS as WRITTEN

from rigd.sdk.check import Observed, Peer, examine_driver
from rigd.sdk.check.sequences import DrawnStep, DrawnTrial, SequenceDrawing

#: Those of analyses take some seconds each: the benchmark plays them.
MUTANTS = [
    (kind, mutant) for kind, mutants in KINDS.items() if kind != "analysis" for mutant in mutants
]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # they leave things
@pytest.mark.parametrize(
    ("kind", "mutant"),
    [pytest.param(kind, mutant, id=f"{kind}, {mutant.name}") for kind, mutant in some(MUTANTS, 7)],
)
def test_mutant_is_found_by_its_rule(kind: str, mutant: Mutant, tmp_path: Path) -> None:
    with made(kind, mutant, tmp_path) as package:
        report = package.examine([mutant.rule])
    assert {finding.rule for finding in report.findings} == {mutant.rule}


@pytest.mark.parametrize("kind", WRITTEN)
def test_driver_without_mistake_passes_each_rule(kind: str, tmp_path: Path) -> None:
    with made(kind, None, tmp_path) as package:
        assert package.examine([]).findings == ()


def test_answer_to_cancelled_question_is_no_row(tmp_path: Path) -> None:
    (mutant,) = (each for each in KINDS["slow"] if each.name == "answer to a cancelled question")
    with made("slow", mutant, tmp_path) as package:
        report = package.examine(["any order of calls"])
    assert "a row shows what the device measured" in str(report)


def test_rules_skipped_without_an_observer_are_reported() -> None:
    @contextmanager
    def refusing() -> Iterator[Peer]:
        with motor() as peer:
            yield replace(peer, faults={**peer.faults, "refusing": lambda: None})

    report = examine_driver(Good, peer=refusing, only=["refused"])
    assert report.skipped == {"refused": "the peer does not show what the device does"}


def test_peer_must_show_an_actuator_per_setpoint() -> None:
    @contextmanager
    def empty() -> Iterator[Peer]:
        with motor() as peer:
            yield replace(peer, observed=Observed)

    (finding,) = examine_driver(Good, peer=empty, only=["any order of calls"]).findings
    assert "the peer shows 0 driven values for 1 setpoints" in finding.problem


def test_watchdog_that_acts_unarmed_is_no_mistake(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    steps = [DrawnStep("open"), *[DrawnStep("go on", 0.0)] * 5, DrawnStep("arm")]
    monkeypatch.setattr(SequenceDrawing, "trials", lambda *_: [DrawnTrial(tuple(steps))])
    with made("fast", None, tmp_path) as package:
        report = package.examine(["any order of calls"])
    assert not report.findings


@pytest.mark.parametrize("author", AUTHORS)
def test_fresh_mutants_fit_what_new_writes(author: str) -> None:
    for kind, mutants in AUTHORS[author].items():
        module, class_name, files = texts(kind, None)
        for mutant in mutants:
            text = files[f"{module}/{mutant.file}.py"]
            assert mutant.applied(text, class_name) != text


def test_text_that_is_not_there_is_no_mutant(tmp_path: Path) -> None:
    mutant = Mutant("of nothing", "rows", "no such text", "")
    with (
        pytest.raises(ValueError, match="does not contain 'no such text'"),
        made("fast", mutant, tmp_path),
    ):
        pass
