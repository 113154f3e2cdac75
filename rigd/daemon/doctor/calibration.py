"""Checks whether the calibration of a rig exists, is for this rig, and until when it is valid."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date
from typing import Final

from rigd.config.rig import RigConfig
from rigd.daemon.calibration_check import unusable
from rigd.daemon.doctor.check import Check, CheckVerdict

_NAME: Final = "calibration"
#: So many days before a calibration expires, the check warns.
_SOON_DAYS: Final = 30


def examine_calibration(rig: RigConfig, on: date) -> Iterator[Check]:
    """Yield a check of the calibration that ``rig`` names, as it is on that day; none without."""
    setup = rig.calibration
    if setup is None:
        return
    group = f"rig {rig.name}"
    if setup.held is None:
        advice = "`rigd calibrate` makes it: a run that needs it does not begin"
        yield Check(group, _NAME, CheckVerdict.FAIL, f"there is no file {setup.path}", advice)
        return
    names = tuple(setup.held.values)
    reasons = unusable(rig, names, on)
    for reason in reasons:
        found, _, advice = reason.partition("\n")
        yield Check(group, _NAME, CheckVerdict.FAIL, found, advice.strip())
    if reasons:
        return
    count = f"{len(names)} values"
    ends = {
        name: value.valid_until
        for name, value in setup.held.values.items()
        if value.valid_until is not None
    }
    if not ends:
        yield Check(group, _NAME, CheckVerdict.OK, f"{setup.held.name}: {count}, none expires")
        return
    first = min(ends, key=ends.__getitem__)
    days = (ends[first] - on).days
    found = f"{setup.held.name}: {count}; {first} expires first, in {days} days ({ends[first]})"
    soon = days <= _SOON_DAYS
    yield Check(
        group,
        _NAME,
        CheckVerdict.WARN if soon else CheckVerdict.OK,
        found,
        "calibrate again before: no run that needs an expired value begins" if soon else "",
        {"days_left": days},
    )
