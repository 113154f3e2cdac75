"""Campaigns on rigs drawn at random, alike or 5 % apart in one parameter, compared by rigd."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from support.lugre.random_rigs import FLOORS, measured, random_rig

from rigd.analysis.api import Result, identify
from rigd.analysis.compare.campaign import of_result
from rigd.analysis.compare.comparison import CampaignComparison, compare
from rigd.model.errors import RigdError

CHANGE: Final = 0.05
#: By the names of results, and of the plant's file: each rig changes one of them, in turn.
CHANGED: Final = {"sigma_0": "sigma_0", "mu_c": "mu_coulomb", "sigma_2": "sigma_2"}
CURRENTS: Final = "{from: 0.15 A, to: 1.5 A, step: 0.15 A}"
#: The parameters of the friction law, of which the truth is known.
NAMES: Final = ("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2")


@dataclass(frozen=True)
class Try:
    """One comparison of two campaigns.

    ``determined``: both campaigns have the parameter that differs; ``found``: it was named;
    ``holds``: its interval holds the change. ``others``: parameters that were named and do not
    differ. ``intervals`` are those of all differences, ``missed`` the parameters whose interval
    does not hold the truth.
    """

    number: int
    floor: str
    parameter: str
    changed: bool
    refused: str = ""
    determined: bool = True
    found: bool = False
    holds: bool = False
    others: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def tries(number: int, folder: Path, currents: str = CURRENTS, *, twice: bool = False) -> list[Try]:
    """Return what is found of the rig with this number: of two equal campaigns, of two apart.

    All campaigns have one rig and its constants, as far off as their u; each has noise and a place
    at the start of its own. ``twice``: a fourth campaign makes one more try of each kind.
    """
    floor = FLOORS[number % len(FLOORS)]
    parameter = tuple(CHANGED)[number // len(FLOORS) % len(CHANGED)]
    truth = random_rig(number, floor, folder).truth
    if parameter == "mu_c" and truth["mu_c"] * (1.0 + CHANGE) >= truth["mu_s"]:
        parameter = "sigma_0"  # no plant has a static friction below that of sliding
    apart = {CHANGED[parameter]: truth[parameter] * (1.0 + CHANGE)}
    found: list[Result | str] = []
    for seed, friction in enumerate([{}, {}, apart, apart][: 4 if twice else 3], start=4 * number):
        own = folder / str(seed)
        own.mkdir()
        rig = random_rig(number, floor, own, friction=friction, currents=currents, start=seed)
        rig.record(own / "run.mcap", seed)
        try:
            found.append(identify(measured(own / "run.mcap", number, floor), method="output-error"))
        except RigdError as error:
            found.append(str(error))
    pairs = [(found[:2], False), (found[:3:2], True)]
    pairs += [(found[2:], False), (found[1::2], True)] if twice else []
    return [_tried(number, floor, parameter, pair, changed=changed) for pair, changed in pairs]


def _tried(
    number: int, floor: str, parameter: str, results: Sequence[Result | str], *, changed: bool
) -> Try:
    wrong = [item for item in results if isinstance(item, str)]
    wrong += ["does not fit" for item in results if isinstance(item, Result) and not item.fits]
    if wrong:
        return Try(number, floor, parameter, changed, refused=wrong[0])
    first, second = (item for item in results if isinstance(item, Result))
    found = compare([of_result("first", first), of_result("second", second)])
    return judged(found, number, floor, parameter, changed=changed)


def judged(
    found: CampaignComparison, number: int, floor: str, parameter: str, *, changed: bool
) -> Try:
    """Return how a comparison agrees with the truth."""
    truth = dict.fromkeys(NAMES, 0.0) | ({parameter: CHANGE} if changed else {})
    rows = {row.name: row for row in found.compared if row.name in truth and row.test is not None}
    intervals = {name: row.change(row.differences["second"])[1:] for name, row in rows.items()}
    missed = tuple(
        name for name, (low, high) in intervals.items() if not low <= truth[name] <= high
    )
    return Try(
        number, floor, parameter, changed,
        determined=parameter in rows,
        found=parameter in rows and rows[parameter].differs,
        holds=parameter in rows and parameter not in missed,
        others=tuple(name for name, row in rows.items() if row.differs and not truth[name]),
        missed=missed,
        intervals=intervals,
    )  # fmt: skip
