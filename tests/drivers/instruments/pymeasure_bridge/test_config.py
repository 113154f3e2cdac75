"""What a rig file may ask of classes of PyMeasure, and how wrong entries are named."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import pytest

from rigd.config.loader import parse_rig
from rigd.model import ConfigError
from rigd_drivers.instruments.pymeasure_bridge import config as module
from rigd_drivers.instruments.pymeasure_bridge.checking import Use, found
from rigd_drivers.instruments.pymeasure_bridge.config import PymeasureConfig, value_of

SOURCE: dict[str, Any] = {
    "instrument": "pymeasure.instruments.keithley.Keithley2400",
    "address": "GPIB0::24::INSTR",
    "channels": {"voltage": {"read": "voltage", "unit": "V"}},
    "setpoints": {
        "current": {"write": "source_current", "unit": "A", "low": "-1 A", "high": "1 A"}
    },
    "arm": "enable_source",
    "safe": ["shutdown"],
    "state": {"read": "source_enabled", "safe": "false", "ready": "true"},
}
PACKAGE = "pymeasure.instruments"


def changed(**options: Any) -> dict[str, Any]:
    return {**SOURCE, **options}


def in_this_process(instrument: str, uses: tuple[Use, ...]) -> tuple[str, ...]:
    """Check as the process of a rig file does, which would import PyMeasure for each test."""
    with catch_warnings(action="ignore"):
        return tuple(found(instrument, uses))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (changed(safe=()), "'safe' is needed"),
        (changed(state=None), "'state' is needed"),
        (changed(setpoints={}), "'arm' is for an instrument with setpoints"),
        (changed(state={"read": "id", "safe": "1", "ready": "1"}), "the same value 1"),
        (changed(timeout="2 s"), "must be safe within 3 s"),
        (changed(model="2400"), "'model' is compared with 'identify'"),
        (changed(channels={"v": {"read": "_special", "unit": "V"}}), "pattern"),
        (changed(channels={"v": {"read": "adapter.__class__", "unit": "V"}}), "pattern"),
        (changed(instrument="os"), "pattern"),
        (changed(visa_library="no.yaml@sim"), "there is no file"),
        (changed(instrument=f"{PACKAGE}.keithley.Keithly2400"),
         "keithley has no class 'Keithly2400'; it has Keithley2400"),
        (changed(instrument=f"{PACKAGE}.kethley.K"), f"there is no module {PACKAGE}.kethley"),
        (changed(instrument="collections.OrderedDict"), "is no subclass of pymeasure"),
        (changed(instrument=f"{PACKAGE}.Channel"), "is no subclass of pymeasure"),
        (changed(channels={"v": {"read": "voltge", "unit": "V"}}),
         "Keithley2400 has no attribute 'voltge'; it has voltage"),
        (changed(channels={"v": {"read": "reset", "unit": "V"}}), "reset is a method"),
        (changed(setpoints={"v": {"write": "voltage", "unit": "V", "low": "0 V", "high": "1 V"}}),
         "voltage cannot be written"),
        (changed(arm="enable_sorce"), "no attribute 'enable_sorce'; it has enable_source"),
        (changed(arm="source_current"), "source_current is no method"),
        (changed(arm="ramp_to_current"), "needs arguments"),
        (changed(start={"source_mode": "volts"}), "PyMeasure refuses 'volts' for source_mode"),
        (changed(setpoints={"i": {"write": "source_current", "unit": "A", "low": "0 A",
                                  "high": "5 A"}}),
         r"PyMeasure (refuses|makes 1\.05 of) 5\.0 for source_current"),
    ],
)  # fmt: skip
def test_wrong_description_is_refused(
    options: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "problems", in_this_process)
    with pytest.raises(ValueError, match=words):
        PymeasureConfig.model_validate(options)


def test_described_source_is_accepted() -> None:
    config = PymeasureConfig.model_validate(SOURCE)
    assert config.state is not None
    assert (value_of(config.state.safe), value_of(config.state.ready)) == (False, True)


@pytest.mark.parametrize(
    ("instrument", "use", "words"),
    [
        ("siglenttechnologies.SPD1168X", Use("ch_1.voltage", "read"), ""),
        ("siglenttechnologies.SPD1168X", Use("ch_1.voltge", "read"),
         "SPDChannel has no attribute 'voltge' (in ch_1.voltge); it has voltage"),
        ("siglenttechnologies.SPD1168X", Use("ch_2.voltage", "read"),
         "SPD1168X has no attribute 'ch_2' (in ch_2.voltage); it has ch_1"),
        ("anritsu.AnritsuMS464xB", Use("ch_1.power_level", "read"), ""),  # made when opened
        ("keithley.Keithley2000", Use("shutdown", "call"),
         "shutdown of this class does nothing at the instrument: write an attribute"),
        ("keithley.Keithley2400", Use("shutdown", "call"), ""),
        ("keithley.Keithley2000", Use("current_range", "write", (5.0,)),
         "PyMeasure makes 3.1 of 5.0 for current_range"),
    ],
)  # fmt: skip
def test_attributes_are_found_without_an_instrument(instrument: str, use: Use, words: str) -> None:
    kind, wrong = in_this_process(f"{PACKAGE}.{instrument}", (use,))
    assert kind == ""
    assert wrong[: len(words)] == words
    assert bool(wrong) == bool(words)


RIG = f"""\
rig: supply-1
title: A meter
cycle: 100 Hz
supervision: {{cycle_silence: 250 ms, daemon_silence: 1 s}}
interlocks: []
devices:
  meter:
    driver: pymeasure
    options:
      instrument: {PACKAGE}.keithley.Keithley2000
      address: GPIB0::16::INSTR
      channels:
        voltage: {{read: voltage, unit: V}}
        current: {{read: curent, unit: A}}
"""


def test_wrong_attribute_is_named_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_rig(RIG, tmp_path / "rig.yaml")
    (line,) = str(caught.value).splitlines()[:1]
    assert "rig.yaml:14:" in str(caught.value)
    assert "has no attribute 'curent'; it has current" in str(caught.value), line


def test_without_pymeasure_the_rig_file_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "is_installed", lambda extra: False)
    PymeasureConfig.model_validate(changed(channels={"v": {"read": "voltge", "unit": "V"}}))


def test_check_of_rig_file_does_not_import_pymeasure(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG.replace("curent", "current"))
    code = (
        "import json, sys\nfrom rigd.config.loader import load_rig\n"
        f"load_rig({str(rig)!r})\nprint(json.dumps([*sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    loaded = set(json.loads(done.stdout))
    assert "rigd_drivers.instruments.pymeasure_bridge.driver" in loaded
    assert not loaded & {"pymeasure", "pandas", "pyvisa"}
