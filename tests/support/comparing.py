"""Campaigns on rigs drawn at random, alike or 5 % apart in one parameter, compared by rigd."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from support.random_rigs import FLOORS, measured, random_rig

from rigd.analysis.compare.campaign import of_result
from rigd.analysis.compare.comparison import CampaignComparison, compare
from rigd.analysis.front import Result, identify
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
    differ. ``inside``: whether each interval of a difference holds the truth.
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
    inside: tuple[bool, ...] = field(default=())
    interval: tuple[float, float] = (0.0, 0.0)


def tries(number: int, folder: Path, currents: str = CURRENTS) -> list[Try]:
    """Return what is found of the rig with this number: of two equal campaigns, of two apart."""
    floor = FLOORS[number % len(FLOORS)]
    parameter = tuple(CHANGED)[number // len(FLOORS) % len(CHANGED)]
    (folder / "same").mkdir()
    (folder / "other").mkdir()
    rig = random_rig(number, floor, folder / "same", currents=currents)
    if parameter == "mu_c" and rig.truth["mu_c"] * (1.0 + CHANGE) >= rig.truth["mu_s"]:
        parameter = "sigma_0"  # no plant has a static friction below that of sliding
    value = rig.truth[parameter] * (1.0 + CHANGE)
    other = random_rig(
        number, floor, folder / "other", currents=currents,
        friction={CHANGED[parameter]: value},
    )  # fmt: skip
    results: list[Result | str] = []
    for seed, played in enumerate((rig, rig, other), start=3 * number):
        (folder / str(seed)).mkdir()
        path = folder / str(seed) / "run.mcap"
        played.record(path, seed)
        try:
            results.append(identify(measured(path, number, floor), method="output-error"))
        except RigdError as error:
            results.append(str(error))
    return [
        _tried(number, floor, parameter, results[:2], changed=False),
        _tried(number, floor, parameter, results[::2], changed=True),
    ]


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
    inside = {}
    for name, row in rows.items():
        _, low, high = row.change(row.differences["second"])
        inside[name] = (low <= truth[name] <= high, low, high)
    others = tuple(name for name, row in rows.items() if row.differs and not truth[name])
    mine = inside.get(parameter, (False, 0.0, 0.0))
    return Try(
        number, floor, parameter, changed,
        determined=parameter in rows,
        found=parameter in rows and rows[parameter].differs,
        holds=mine[0],
        others=others,
        inside=tuple(item[0] for item in inside.values()),
        interval=mine[1:],
    )  # fmt: skip
