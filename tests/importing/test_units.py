"""Units that the files of others state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.recordings.imported import MAP, Import

from rigd.model import ConfigError

#: What stands in headings -> the size of 1 of it in SI, by the definitions of the units.
STATED = {
    "Nm": 1.0, "N.m": 1.0, "N⋅m": 1.0, "N-m": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kN": 1e3,
    "kgf": 9.80665, "gf": 9.80665e-3, "kgfm": 9.80665, "U/min": 2 * math.pi / 60,
    "U/  min": 2 * math.pi / 60, "rpm": 2 * math.pi / 60, "1/min": 1 / 60, "mm/sec": 1e-3,
    "°/s": math.pi / 180, "deg/s": math.pi / 180, "m/s²": 1.0, "㎜": 1e-3, "kΩ": 1e3, "μm": 1e-6,
    "d": 86_400.0,
}  # fmt: skip
ROWS = "".join(f"{i / 1000},{i},{i}\n" for i in range(20))
BARE = MAP.replace(", unit: N", "")


@pytest.mark.parametrize("unit", STATED)
@pytest.mark.parametrize("signs", ["[]", "()"])
def test_stated_unit_is_read(bring_in: Import, unit: str, signs: str) -> None:
    recording = bring_in(f"t,F {signs[0]}{unit}{signs[1]},v\n{ROWS}", map=BARE)
    np.testing.assert_allclose(recording.read("samples")["force"][1], STATED[unit], rtol=1e-15)


@pytest.mark.parametrize("heading", ["F [daN]", "F (left)", "F [sccm]"])
def test_unknown_unit_is_named_not_absent(bring_in: Import, heading: str) -> None:
    stated = heading[3:-1]
    with pytest.raises(ConfigError, match=f"states the unit '{stated}' of the column") as raised:
        bring_in(f"t,{heading},v\n{ROWS}", map=BARE)
    assert "add `unit:`" in str(raised.value.hint)
    given = bring_in(f"t,{heading},v\n{ROWS}", name="given.csv")
    assert given.read("samples")["force"].tolist() == [float(i) for i in range(20)]


def test_number_of_a_name_is_no_unit(bring_in: Import) -> None:
    with pytest.raises(ConfigError, match="states no unit"):
        bring_in(f"t,F (1),v\n{ROWS}", map=BARE.replace("column: F", "column: F (1)"))


def test_scale_takes_unit_of_the_file(bring_in: Import) -> None:
    scaled = MAP.replace("unit: N", "zero: 1 V, scale: 250 N/V")
    rows = bring_in(f"t,F [mV],v\n{ROWS}", map=scaled).read("samples")
    np.testing.assert_allclose(rows["force"], (np.arange(20) * 1e-3 - 1.0) * 250.0, rtol=1e-15)
    with pytest.raises(ConfigError, match="'1 V' is no quantity in mm"):
        bring_in(f"t,F [mm],v\n{ROWS}", map=scaled, name="a.csv")
    with pytest.raises(ConfigError, match="states no unit"):
        bring_in(f"t,F,v\n{ROWS}", map=scaled, name="b.csv")


def test_signal_is_compared_in_its_unit(bring_in: Import) -> None:
    """The unit stands in the file alone."""
    more = "trials: {signal: {channel: samples.force, above: 5 N}}\n"
    (trial,) = bring_in("t,F [mN],v\n0,5,0\n1,9000,0\n2,9000,0\n", map=BARE, more=more).trials
    assert trial.end_ns - trial.start_ns == 1_000_000_001
    with pytest.raises(ConfigError, match="'5 N' is no quantity in m"):
        bring_in(f"t,F [mm],v\n{ROWS}", map=BARE, more=more, name="a.csv")


def test_gram_of_force_machine_becomes_force(bring_in: Import) -> None:
    """As docs/import.md says: `scale: 9.80665 mN/g`."""
    scaled = MAP.replace("unit: N", "scale: 9.80665 mN/g")
    rows = bring_in(f"t,F [g],v\n{ROWS}", map=scaled).read("samples")
    np.testing.assert_allclose(rows["force"], np.arange(20) * 9.80665e-3, rtol=1e-14)
