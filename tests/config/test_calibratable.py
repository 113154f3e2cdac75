"""The values that calibrations may hold come from the analyses that are installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigd.config import registry
from rigd.config.calibration import calibratable
from rigd.config.calibration.calibration import parse_calibration
from rigd.model.errors import ConfigError

Install = Callable[[str, str], None]
ANALYSIS = """\
from rigd.analysis import Analysis, Calibratable, Needs

class Lab(Analysis):
    needs = Needs({{"x": "m"}})
    calibratable = {{"{name}": Calibratable("{unit}", "of a lab", sign="any")}}
    def evaluate(self, sweeps, options, notify): ...
"""
CALIBRATION = """\
calibration: bench
rigs: [bench-1]
values:
  {name}: {{value: 2 m/V, u: 0.1 m/V, source: assumed, from: a test, made: 2026-11-21,
    operator: me}}
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Install a package with one analysis, by its name and the text of its module."""
    caches = (registry.given_names, calibratable._declared)

    def forget() -> None:
        for cached in caches:
            cached.cache_clear()

    def install_module(name: str, text: str) -> None:
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[rigd.analyses]\n{name} = {name}:Lab\n")
        (tmp_path / f"{name}.py").write_text(text)
        forget()

    monkeypatch.syspath_prepend(tmp_path)
    yield install_module
    forget()


def test_a_calibration_may_hold_what_an_analysis_declares(install: Install) -> None:
    install("lab_of_values", ANALYSIS.format(name="stage_scale", unit="m/V"))
    held = parse_calibration(CALIBRATION.format(name="stage_scale"), "bench.yaml")
    assert held.values["stage_scale"].value == 2.0
    assert "torque_scale" in calibratable.calibratable()


def test_a_name_with_two_meanings_is_refused(install: Install) -> None:
    install("lab_of_doubles", ANALYSIS.format(name="torque_scale", unit="m/V"))
    with pytest.raises(ConfigError, match="calibrated value 'torque_scale'"):
        calibratable.calibratable()


def test_a_broken_analysis_is_named_beside_unknown_values(install: Install) -> None:
    install("lab_in_ruins", "import nothing_of_this_name\n")
    with pytest.raises(ConfigError, match="unknown calibrated value 'stage_scale'") as caught:
        parse_calibration(CALIBRATION.format(name="stage_scale"), "bench.yaml")
    assert "'lab_in_ruins' cannot be loaded" in (caught.value.hint or "")
    assert "torque_scale" in calibratable.calibratable()
