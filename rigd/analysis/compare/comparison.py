"""Compares campaigns parameter by parameter, and holds what is found as data."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain, combinations, product
from typing import Final

import numpy as np

from rigd.analysis.compare.campaign import MEASURES, Campaign, label_of
from rigd.analysis.compare.statistics import (
    Homogeneity,
    Level,
    LevelDifference,
    Slope,
    difference,
    holm,
    homogeneity,
    trend,
)
from rigd.analysis.estimates import Estimate, Share
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.measures import varied
from rigd.analysis.measures.ranges import changed_formula
from rigd.analysis.report.opening import listed
from rigd.model.errors import DataError

#: All parameters together: so often a difference is named where there is none.
LEVEL: Final = 0.05
NO_SHARES: Final = (
    "No interval here states which part of it comes from a constant. If the analysis takes "
    "constants as exact, their errors are in no interval; if not, nothing cancels, and the "
    "differences have wider intervals than they need."
)
YEAR_S: Final = 365.25 * 86400.0


@dataclass(frozen=True)
class Compared:
    """One parameter of one group of trials in all campaigns.

    ``estimates`` are those of the campaigns, None if one lacks it. ``differences`` are those from
    ``base``, the first campaign with a number (and several runs, if two have them), by name of
    campaign: of the logarithm if ``log``. ``test`` is that of all that may be judged being equal,
    ``p_holm`` its p value for all parameters together. Without a test, ``why`` states what is
    missing: numbers, or runs that show how runs differ. ``p_apart`` is the p value for all
    parameters together if each campaign may have its own of what the model assumes; ``assumed`` is
    that which counts most.
    """

    group: str
    name: str
    unit: str
    log: bool
    estimates: Mapping[str, Estimate | None]
    base: str = ""
    differences: Mapping[str, LevelDifference] = field(default_factory=dict)
    test: Homogeneity | None = None
    p_holm: float = 1.0
    slope: Slope | None = None  #: for each year
    why: str = ""
    p_apart: float = 1.0
    assumed: str = ""

    @property
    def differs(self) -> bool:
        """Whether the campaigns differ in it, by the test for all parameters together."""
        return self.test is not None and self.p_holm < LEVEL

    @property
    def rests_on(self) -> str:
        """What must be the same in all campaigns for them to differ in it; empty if nothing."""
        return self.assumed if self.differs and self.p_apart >= LEVEL else ""

    @property
    def verdict(self) -> str:
        """What is found, in words."""
        if self.test is None:
            return "not judged" if self.differences else "not compared"
        return "differs" if self.differs else "none found"

    @property
    def changes(self) -> dict[str, tuple[float, float, float]]:
        """The differences by name of campaign, each with its ends, as :meth:`change` has them."""
        return {name: self.change(found) for name, found in self.differences.items()}

    def change(self, found: LevelDifference | Slope) -> tuple[float, float, float]:
        """Return a difference with its ends as a share of the base if ``log``, else in ``unit``.

        An open end is infinite.
        """
        ends = (found.value, found.low, found.high)
        if not self.log:
            return ends
        value, low, high = (
            math.expm1(min(end, 700.0)) if math.isfinite(end) else end for end in ends
        )
        return value, low, high


@dataclass(frozen=True)
class CampaignComparison:
    """Campaigns side by side; ``constants`` are sentences on constants they do not share."""

    campaigns: tuple[Campaign, ...]
    compared: tuple[Compared, ...]
    constants: tuple[str, ...] = ()

    @property
    def different(self) -> tuple[Compared, ...]:
        """Those in which the campaigns differ."""
        return tuple(item for item in self.compared if item.differs)


def compare(campaigns: Sequence[Campaign]) -> CampaignComparison:
    """Return the comparison of two or more campaigns.

    Raises:
        DataError: there is only one, their models, methods, rigs or measures of one name differ,
            or they have no condition or no parameter in common.
    """
    _check(campaigns)
    campaigns = _by_what_varies(campaigns)
    found = []
    names = {(item.group, item.name): None for campaign in campaigns for item in campaign.estimates}
    for group, name in names:
        estimates = {
            campaign.name: next(
                (e for e in campaign.estimates if (e.group, e.name) == (group, name)), None
            )
            for campaign in campaigns
        }
        if campaigns[0].model == MEASURES:
            _refuse_other_definitions(name, estimates)
            _refuse_other_formulas(name, [item for item in campaigns if estimates[item.name]])
        found.append(_compared(group, name, estimates, campaigns))
    if all(sum(e is not None for e in item.estimates.values()) < 2 for item in found):
        raise _nothing_in_common(campaigns)
    tested = [item for item in found if item.test is not None]
    adjusted = iter(holm([item.test.p_value for item in tested if item.test is not None]))
    apart = iter(holm([item.p_apart for item in tested]))
    rows = [
        replace(item, p_holm=next(adjusted), p_apart=next(apart)) if item.test else item
        for item in found
    ]
    constants = (*_shared(campaigns), *_unshared(campaigns))
    return CampaignComparison(tuple(campaigns), tuple(rows), constants)


def _check(campaigns: Sequence[Campaign]) -> None:
    if len(campaigns) < 2:
        raise DataError(
            "one group has nothing to be compared with",
            hint="give two: `rigd compare before.mcap after.mcap`, or several and `--by month`",
        )
    for first, second in combinations(campaigns, 2):
        both = {origin.recording for origin in first.origins} & {
            origin.recording for origin in second.origins
        }
        if both:
            raise DataError(
                f"{min(both)} is in both {first.name} and {second.name}",
                hint="give each recording to one group: the same samples are no new evidence",
            )
        _refuse_other_signals(first, second)
    for what, of in (
        ("identify different models", lambda item: item.model),
        ("were recorded on different rigs", lambda item: ", ".join(item.rigs)),
    ):
        if len({of(item) for item in campaigns}) > 1:
            told = "; ".join(f"{item.name}: {of(item)}" for item in campaigns)
            raise DataError(
                f"the groups {what} ({told})", hint="compare recordings of one rig and one model"
            )
    for group in {group for item in campaigns for group in item.method}:
        methods = {item.name: item.method[group] for item in campaigns if group in item.method}
        if len(set(methods.values())) > 1:
            told = "; ".join(f"{name}: {method}" for name, method in methods.items())
            raise DataError(
                f"{group} was identified in different ways ({told})",
                hint="give the recordings of all and --method, so that all are identified alike",
            )


def _by_what_varies(campaigns: Sequence[Campaign]) -> list[Campaign]:
    """Return ``campaigns`` with groups of measures named by what varies over all of them.

    A value that two campaigns show in different units has the text of the first.
    """
    names = varied([point for item in campaigns for point in item.points.values()])
    shown: dict[tuple[str, str], str] = {}

    def named(campaign: Campaign) -> Campaign:
        points = {
            group: {
                name: shown.setdefault((name, point[name]), campaign.conditions[group][name])
                for name in names
                if name in point
            }
            for group, point in campaign.points.items()
        }
        estimates = tuple(
            replace(item, group=label_of(points[item.group])) for item in campaign.estimates
        )
        conditions = {label_of(point): point for point in points.values()}
        return replace(campaign, estimates=estimates, conditions=conditions)

    return [named(item) if item.conditions else item for item in campaigns]


def _refuse_other_signals(first: Campaign, second: Campaign) -> None:
    """Refuse campaigns that were identified from a derived channel with two formulas.

    Raises:
        DataError: they were.
    """
    for mine, theirs in product(first.origins, second.origins):
        channel = changed_formula(mine.formulas, theirs.formulas)
        if channel is not None:
            raise DataError(
                f"{first.name} and {second.name} are identified from {channel}, which is "
                f"{mine.formulas[channel]!r} in {mine.recording} and "
                f"{theirs.formulas[channel]!r} in {theirs.recording}",
                hint="compare recordings whose derived channels have the same formulas",
            )


def _refuse_other_formulas(name: str, campaigns: Sequence[Campaign]) -> None:
    for first, second in combinations(campaigns, 2):
        mine, theirs = first.formulas.get(name, {}), second.formulas.get(name, {})
        channel = changed_formula(mine, theirs)
        if channel is not None:
            raise _other_definitions(
                name,
                {first.name: f"{channel} = {mine[channel]}",
                 second.name: f"{channel} = {theirs[channel]}"},
            )  # fmt: skip


def _refuse_other_definitions(name: str, estimates: Mapping[str, Estimate | None]) -> None:
    told = {
        key: item.meaning + (f", in {item.unit}" if item.unit != "1" else "")
        for key, item in estimates.items()
        if item is not None
    }
    if len({*told.values()}) > 1:
        raise _other_definitions(name, told)


def _other_definitions(name: str, told: Mapping[str, str]) -> DataError:
    each = "; ".join(f"{key}: {text}" for key, text in told.items())
    return DataError(
        f"the groups measure {name} in different ways ({each})",
        hint="compare recordings that measure it alike; give another measure another name",
    )


def _nothing_in_common(campaigns: Sequence[Campaign]) -> DataError:
    """Return the error of campaigns without a common group, with the parameters that differ."""
    points = {item.name: list(item.conditions.values()) for item in campaigns}
    apart = []
    for name in varied([point for found in points.values() for point in found]):
        texts = {key: dict.fromkeys(point.get(name, "not stated") for point in found)
                 for key, found in points.items()}  # fmt: skip
        if len({*chain(*texts.values())}) == sum(map(len, texts.values())):
            told = (f"{' and '.join(found)} in {key}" for key, found in texts.items())
            apart.append(f"{name} is {', '.join(told)}")
    groups = "; ".join(
        f"{item.name}: {', '.join(dict.fromkeys(e.group or e.name for e in item.estimates))}"
        for item in campaigns
    )
    what = f"trials of one kind in common ({groups})"
    if apart:
        what = f"condition in common: {'; '.join(apart)}"
    return DataError(
        f"the groups have no {what}",
        hint="compare recordings of the same conditions, such as the same floor",
    )


def _compared(
    group: str, name: str, estimates: Mapping[str, Estimate | None], campaigns: Sequence[Campaign]
) -> Compared:
    there = [item for item in estimates.values() if item is not None]
    known = {
        key: item
        for key, item in estimates.items()
        if item is not None and item.value is not None and item.determined
    }
    log = all(item.log for item in known.values())
    row = Compared(group, name, there[0].unit, log, estimates)
    if len(known) < 2:
        return _with_reason(row)
    rigs = campaigns[0].rigs
    left = _left(known.values())
    levels = {key: level_of(item, rigs, left, log=log) for key, item in known.items()}
    if not all(math.isfinite(item.own) or math.isfinite(min(item.below, item.above))
               for item in levels.values()):  # fmt: skip
        return _with_reason(row)
    dates = {item.name: item.dates for item in campaigns}
    one_run = [key for key, item in known.items() if item.is_within_run]
    judged = {key: level for key, level in levels.items() if key not in one_run}
    base = next(iter(judged if len(judged) > 1 else levels))
    slope = None
    if all(dates[key] for key in judged):
        at = np.array([_middle(dates[key]) for key in judged]) / YEAR_S
        slope = trend(list(judged.values()), at)
    missing = [key for key in estimates if key not in known]
    assumed = [share for key in judged for share in known[key].shares if share.left is not None]
    apart = [level_of(_of_the_rig(known[key]), rigs, left, log=log) for key in judged]
    return replace(
        row,
        base=base,
        differences={key: difference(levels[base], levels[key]) for key in levels if key != base},
        test=homogeneity(list(judged.values())) if len(judged) > 1 else None,
        slope=slope,
        p_apart=homogeneity(apart).p_value,
        assumed=max(assumed, key=lambda item: abs(item.held)).constant if assumed else "",
        why="; ".join(filter(None, (_reason(row, missing), _of_one_run(one_run, judged)))),
    )


def _of_one_run(names: Sequence[str], judged: Collection[str]) -> str:
    """Return why groups of one run have no part in the verdict; empty if there is none."""
    if not names:
        return ""
    return (
        f"{', '.join(names)}: one run, which shows how trials differ and not how runs do; "
        f"{'the verdict is that of the others; ' if len(judged) > 1 else ''}"
        "give two runs of each group or more"
    )


def level_of(item: Estimate, rigs: Hashable, left: Mapping[Hashable, float], *, log: bool) -> Level:
    """Return an estimate with a value as a level, of its logarithm if ``log``.

    Constants are the same if rig, name, stated value and uncertainty are. ``left`` is what all
    campaigns leave open of assumptions.
    """
    value = item.value or 0.0
    scale = value if item.log and not log else 1.0
    shares: dict[Hashable, float] = {
        (rigs, *_key(share)): share.effect * left.get(_key(share), 1.0) * scale
        for share in item.shares
    }
    if item.u is not None:
        return Level(value, item.u, item.u, shares, item.freedom)
    centre = math.log(value) if log else value
    common = math.hypot(*(share.held * scale for share in item.shares))

    def own(end: float | None) -> float:
        if end is None:
            return math.inf
        there = math.log(end) if log else end
        whole = max(abs(there - centre) / Z_95, common)
        return math.sqrt(whole - common) * math.sqrt(whole + common)

    return Level(centre, own(item.low), own(item.high), shares)


def _left(estimates: Iterable[Estimate]) -> dict[Hashable, float]:
    """Return the part of u that is left open of each assumption, which has one size in all.

    It is that of the campaign that knows it least: chance makes the others smaller.
    """
    found: dict[Hashable, float] = {}
    for share in chain.from_iterable(item.shares for item in estimates):
        if share.left is not None:
            found[_key(share)] = max(share.left, found.get(_key(share), 0.0))
    return found


def _of_the_rig(item: Estimate) -> Estimate:
    """Return ``item`` without the shares of assumptions, which are then part of its own error."""
    return replace(item, shares=tuple(share for share in item.shares if share.left is None))


def _key(share: Share) -> tuple[str, float, float]:
    return share.constant, share.stated, share.u


def _middle(dates: Sequence[datetime]) -> float:
    return float(np.mean([date.astimezone(UTC).timestamp() for date in dates]))


def _with_reason(row: Compared) -> Compared:
    missing = [
        key
        for key, item in row.estimates.items()
        if item is None or item.value is None or not item.determined
    ]
    return replace(row, why=_reason(row, missing) or "an interval has no end")


def _reason(row: Compared, missing: Sequence[str]) -> str:
    told = []
    for key in missing:
        item = row.estimates[key]
        if item is None:
            told.append(f"{key}: no such trials, or they were refused")
        else:
            told.append(f"{key}: {item.verdict}")
    return "; ".join(told)


def _shared(campaigns: Sequence[Campaign]) -> tuple[str, ...]:
    """Return sentences on what is taken as the same in all campaigns, so that it cancels.

    Named are the constants that add most to a parameter.
    """
    by_campaign = [
        {_key(share): share for item in campaign.estimates for share in item.shares}
        for campaign in campaigns
    ]
    common = {
        key: share
        for key, share in by_campaign[0].items()
        if all(key in other for other in by_campaign)
    }
    assumed = [share for share in common.values() if share.left is not None]
    rig = {key for key, share in common.items() if share.left is None}
    most = [
        max(shares, key=lambda share: abs(share.effect)).constant
        for item in campaigns[0].estimates
        if (shares := [share for share in item.shares if _key(share) in rig])
    ]
    told = []
    if most:
        told.append(
            f"What all groups take alike, above all {listed(list(dict.fromkeys(most)))}, counts as "
            "the same in all: what it adds to the intervals cancels as far as it is equal."
        )
    told += [
        f"The {share.constant}, which no file states (u = {share.u:g}), counts as the same in all "
        "too. Where a difference may be one of it instead, the sentence on the difference says so."
        for share in assumed
    ]
    return tuple(told)


def _unshared(campaigns: Sequence[Campaign]) -> tuple[str, ...]:
    """Return a sentence on each constant that the campaigns state otherwise.

    One more if no interval states which part of it comes from a constant.
    """
    stated: dict[str, dict[str, set[tuple[float, float | None]]]] = {}
    for campaign in campaigns:
        for item in campaign.estimates:
            for share in item.shares:
                values = stated.setdefault(share.constant, {}).setdefault(campaign.name, set())
                values.add((share.stated, share.u))
    of_intervals = set(stated)
    for campaign in campaigns:
        for origin in campaign.origins:
            for name, (value, u) in origin.constants.items():
                if name not in of_intervals:
                    by_name = stated.setdefault(name, {})
                    by_name.setdefault(campaign.name, set()).add((value, u))
    told = []
    for constant, by_name in stated.items():
        if len(by_name) < 2 or len({frozenset(values) for values in by_name.values()}) == 1:
            continue
        alone = {name: sorted({value for value, _ in both}) for name, both in by_name.items()}
        if len({tuple(item) for item in alone.values()}) == 1:
            told.append(
                f"{constant} is stated with several uncertainties: the groups count as having "
                "measured it each by itself, and nothing of it cancels."
            )
            continue
        parts = "; ".join(
            f"{name}: {', '.join(f'{value:.6g}' for value in item)}" for name, item in alone.items()
        )
        told.append(
            f"{constant} is not stated alike ({parts}): its uncertainty does not cancel, and "
            "another value alone makes a difference. `--set` evaluates recordings with one value."
        )
    if stated and not of_intervals:
        told.append(NO_SHARES)
    return tuple(told)
