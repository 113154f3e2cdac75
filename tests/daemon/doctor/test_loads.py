"""How full each link of a rig is: a full one delays what comes late."""

from __future__ import annotations

import pytest

from rigd.daemon.doctor.check import CheckVerdict
from rigd.daemon.doctor.rig import judge_loads


@pytest.mark.parametrize(
    ("load", "verdict"),
    [(0.79, CheckVerdict.OK), (0.81, CheckVerdict.WARN), (0.98, CheckVerdict.WARN)],
)
def test_nearly_full_bus_is_a_warning(load: float, verdict: CheckVerdict) -> None:
    (check,) = judge_loads("rig", {"servo_bus": load})
    assert check.verdict is verdict
    assert f"{load:.0%} of its capacity" in check.found
    assert ("move devices to another bus" in (check.advice or "")) is (verdict is CheckVerdict.WARN)
