"""Checks whether the certificates of a rig can be used, and until when."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from rigd.config.rig import RigConfig
from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.model.errors import ConfigError
from rigd.remote.certificates import RENEW, SOON, check_usable, distrusted, end_of


def examine_certificates(rig: RigConfig, now: datetime) -> Iterator[Check]:
    """Yield a check of the certificates that ``rig`` names, as they are ``now``; none without."""
    tls = rig.remote.tls
    if tls is None:
        return
    group, name = f"rig {rig.name}", "certificates"
    try:
        check_usable(tls, now)
        until, path = min((end_of(path), path) for path in (tls.certificate, tls.ca))
    except ConfigError as error:
        yield Check(group, name, CheckVerdict.FAIL, error.message, error.hint or "")
        return
    if why := distrusted(tls):
        yield Check(group, name, CheckVerdict.FAIL, why)
        return
    days = (until - now).days
    found = f"{path.name} expires first, in {days} days ({until:%Y-%m-%d})"
    soon = until - now <= SOON
    yield Check(
        group,
        name,
        CheckVerdict.WARN if soon else CheckVerdict.OK,
        found,
        f"no client can connect from then on: {RENEW}" if soon else "",
        {"days_left": days},
    )
