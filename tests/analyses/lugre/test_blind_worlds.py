"""`rigd identify` on rigs of a second author, and how their study judges it."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from blind.judge import LUGRE, run, verdict, worst
from blind.rig import Rig, draw, drive
from blind.worlds import kinds, world

from rigd.analysis.api import identify
from rigd.analysis.compare.campaign import of_result
from rigd.analysis.compare.comparison import compare

KINDS = kinds()


def row(
    kind: str, outcome: str, cause: str = "", miss: float = 0.0, **others: Any
) -> dict[str, Any]:
    explanations = [{"name": cause, "look": "", "others": []}] if cause else []
    told = {"sentence": "", "warnings": [], "explanations": explanations, "misses": {"mu_c": miss}}
    return {"kind": kind, "outcome": outcome, **told, **others}


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (row("right", "fits", miss=0.4), "right"),
        (row("right", "fits", miss=1.6), "A NUMBER WRONG"),
        (row("right", "fits with what is named", "a slope of the floor"), "A CAUSE NAMED"),
        (row("right", "does not fit"), "REFUSED"),
        (row("slope", "fits", miss=0.4), "right"),
        (row("slope", "fits", miss=1.6), "WRONG IN SILENCE"),
        (row("slope", "fits with what is named", "a slope of the floor"), "rightly named"),
        (row("slope", "fits with what is named", "wear of the contact"), "WRONG NAME"),
        (row("slope", "does not fit"), "refused without a name"),
        (row("slope", "does not fit", "wear of the contact"), "REFUSED, WRONG NAME"),
        (row("clutch left in", "fits", warnings=["0.6 A was left out"]), "rightly named"),
        (row("guide bears weight", "fits", miss=6.0), "KNOWN, IN SILENCE"),
    ],
)
def test_verdict_follows_what_was_said(said: dict[str, Any], words: str) -> None:
    assert verdict(said, KINDS) == words


def test_second_rig_converges_with_its_step() -> None:
    """docs/physics/lugre.md, section 7: 2e-5 m/s of the carriage and 5e-5 m/s of slip."""
    for rig in (draw(4), world("soft coupling", 1, 0)):
        coarse, fine = drive(rig, 3), drive(rig, 3, 2 * rig.substeps)
        assert len(coarse) == len(fine)
        assert np.abs(coarse[:, 9] - fine[:, 9]).max() < 2e-5
        assert np.abs(rig.true["radius"] * (coarse[:, 7] - fine[:, 7])).max() < 5e-5


def test_every_world_differs_from_its_rig() -> None:
    for number, kind in enumerate(KINDS.values()):
        for size in range(len(kind.sizes)):
            assert world(kind.name, size, 0) != draw(1000 + 10 * number), kind.name


def test_right_rig_of_second_author_fits(tmp_path: Path) -> None:
    found = run("right", 0, 4, tmp_path, LUGRE)
    assert verdict(found, KINDS) == "right"
    assert len(found["misses"]) >= 5


def test_creep_before_the_step_is_no_cause(tmp_path: Path) -> None:
    """The simulation begins at rest: the guide's friction seemed to be 27 uncertainties off."""
    assert verdict(run("right", 0, 106, tmp_path, LUGRE), KINDS) == "right"


def test_wrong_torque_constant_is_rightly_named(tmp_path: Path) -> None:
    assert verdict(run("torque_constant low", 1, 1, tmp_path, LUGRE), KINDS) == "rightly named"


@pytest.mark.parametrize(
    ("kind", "size", "seed", "name", "words"),
    [
        ("friction waves along", 0, 1, "friction that repeats each", "rightly named"),
        ("no_load_viscous low", 1, 1, "viscous no-load torque", "refused, rightly named"),
        ("motor fades", 1, 7683, "a drive that fades as it heats", "rightly named"),
    ],
)
def test_named_cause_explains_best_once_fitted(
    kind: str, size: int, seed: int, name: str, words: str, tmp_path: Path
) -> None:
    """By the score tests friction, or the current, depended on speed or slip."""
    found = run(kind, size, seed, tmp_path, LUGRE)
    assert found["explanations"][0]["name"].startswith(name)
    assert verdict(found, KINDS) == words


@pytest.mark.parametrize(
    ("kind", "size", "seed", "words"),
    [
        ("wheel encoder late", 0, 1, "rightly named"),
        ("both encoders late", 1, 2, "refused, rightly named"),
        ("carriage spikes", 1, 0, "rightly named"),
        ("wheel encoder spikes", 1, 2, "rightly named"),
    ],
)
def test_spoilt_encoder_is_rightly_named(
    kind: str, size: int, seed: int, words: str, tmp_path: Path
) -> None:
    """All were refused, without a name or with a wrong one."""
    assert verdict(run(kind, size, seed, tmp_path, LUGRE), KINDS) == words


def with_exponent(exponent: float, seed: int = 20) -> Rig:
    rig = draw(20)
    rig.true["exponent"], rig.seed, rig.name = exponent, seed, "blind"
    return rig


def test_exponent_not_shown_is_in_the_intervals(tmp_path: Path) -> None:
    """V_s was 2.3 half widths off in silence, mu_s 2.1; of a right rig V_s was 1.5 off."""
    study = replace(LUGRE, draw=lambda seed: with_exponent(0.45))
    found = run("right", 0, 20, tmp_path, study)
    assert found["outcome"] == "fits"
    assert {"V_s", "mu_s"} < set(found["misses"])
    assert worst(found) < 1.0


def test_exponent_of_both_campaigns_cancels(tmp_path: Path) -> None:
    """The difference of V_s was known to 18 %, with an exponent that is 0.45 in both."""
    campaigns = []
    for name, exponent, seed in (("before", 0.45, 1), ("after", 0.45, 2), ("other", 0.5, 3)):
        LUGRE.write(with_exponent(exponent, seed), tmp_path / f"{name}.mcap")
        campaigns.append(of_result(name, identify(tmp_path / f"{name}.mcap")))
    alike, apart = (
        {row.name: row for row in compare([campaigns[0], other]).compared}
        for other in campaigns[1:]
    )
    for name in ("V_s", "mu_s", "mu_s-mu_c"):
        alone = alike[name].estimates["before"]
        found = alike[name].differences["after"]
        assert alone is not None and alone.low is not None and alone.high is not None
        assert found.low < 0.0 < found.high
        without = math.sqrt(2.0) * math.log(alone.high / alone.low)
        assert found.high - found.low < 0.5 * without
        if apart[name].differs:
            assert apart[name].rests_on == "exponent of the Stribeck effect"
    assert apart["V_s"].differs
