"""Finds the date and time of a recording for display."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal

from rigd.record.read.info import RunInfo

#: The mode of a run in virtual time contains this text; its clock is not the calendar's.
VIRTUAL: Final = "virtual time"
#: In the metadata ``run``: the date of a file whose content was written anew since.
DATE_KEY: Final = "file_date"
_STAMP: Final = re.compile(r"(?<!\d)(\d{8})[-T](\d{6})(?!\d)")


@dataclass(frozen=True)
class Moment:
    """A date in UTC and its source: the run's own clock, the file's name, or the file."""

    at: datetime
    of: Literal["run", "file name", "file"]


def is_virtual(info: RunInfo) -> bool:
    """Return whether the clock of the run was made from its seed."""
    return VIRTUAL in info.mode


def recorded_at(info: RunInfo) -> Moment:
    """Return when the run began; for a run in virtual time, when its file was made.

    A run in virtual time repeats bit for bit and so contains no date: its file name contains the
    date if rigd chose the name, else the date of the file counts, which a copy may lose.

    Raises:
        OSError: the date of the file is needed, but the file is missing.
    """
    if not is_virtual(info):
        try:
            began = datetime.fromisoformat(info.started)
        except ValueError:
            pass  # a file of another program
        else:
            return Moment(began if began.tzinfo else began.replace(tzinfo=UTC), "run")
    stamp = _STAMP.search(info.path.name)
    if stamp is not None:
        try:
            named = datetime.strptime("".join(stamp.groups()), "%Y%m%d%H%M%S")
        except ValueError:
            pass  # digits that are no date
        else:
            return Moment(named.replace(tzinfo=UTC), "file name")
    kept = info.metadata.get("run", {}).get(DATE_KEY, "")
    if kept:
        try:
            return Moment(datetime.fromisoformat(kept), "file")
        except ValueError:
            pass  # of another program
    return Moment(datetime.fromtimestamp(info.path.stat().st_mtime, UTC), "file")
