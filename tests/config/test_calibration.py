"""Calibration files: what they become, every way to get one wrong, and how one is renewed."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from rigd.config.calibration.calibration import (
    CalibratedValue,
    load_calibration,
    parse_calibration,
)
from rigd.config.calibration.calibration_file import renewed, write_calibration
from rigd.config.loader import load_rig, parse_rig
from rigd.config.schema import calibration_schema
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder

SHIPPED = shipped_folder("configs") / "calibrations" / "approach_angle.yaml"
TODAY = date(2026, 11, 21)
TEXT = """\
# This comment stays.

calibration: bench
rigs: [bench-1]
values:
  torque_scale:
    value: 2.040 N m/V # 3 kg on the long arm
    u: 5 mN m/V
    source: measured
    from: torque.mcap
    made: 2026-01-02
    operator: A. Miller
    valid_until: 2027-01-02
    instruments: {daq: serial number 01AB, made: by hand}
  roller_drag: {value: 0.0450, u: 1.2 %, source: assumed, from: old, made: 2025-05-06, operator: B}
"""


def measured(value: float = 2.05, u: float = 0.004) -> CalibratedValue:
    return CalibratedValue(
        value, u, "N m/V", "measured", "new.mcap", TODAY, "C. Doe", date(2027, 11, 21),
        {"daq": "serial number 01AC"},
    )  # fmt: skip


def renew(text: str, path: Path = Path("bench.yaml")) -> str:
    old = parse_calibration(text, str(path))
    new = renewed(old, {"torque_scale": measured()}, name="x", rigs=["y"], path=path, on=TODAY)
    return new.text


def test_values_are_in_si_with_the_person_responsible() -> None:
    calibration = parse_calibration(TEXT, "bench.yaml")
    torque = calibration.values["torque_scale"]
    assert torque.value == 2.04
    assert torque.u == pytest.approx(0.005)
    assert (torque.source, torque.origin, torque.operator) == (
        "measured",
        "torque.mcap",
        "A. Miller",
    )
    assert torque.instruments == {"daq": "serial number 01AB", "made": "by hand"}
    assert calibration.values["roller_drag"].u == pytest.approx(0.012)
    assert (calibration.made, calibration.valid_until) == (date(2026, 1, 2), date(2027, 1, 2))


def test_value_expires_after_last_day_assumed_one_never() -> None:
    values = parse_calibration(TEXT, "bench.yaml").values
    assert not values["torque_scale"].expired(date(2027, 1, 2))
    assert values["torque_scale"].expired(date(2027, 1, 3))
    assert not values["roller_drag"].expired(date(2999, 1, 1))


@pytest.mark.parametrize(
    ("old", "new", "token", "part"),
    [
        ("torque_scale:", "torq_scale:", "torq_scale", "did you mean 'torque_scale'"),
        ("2.040 N m/V", "2.040 V", "2.040 V", "'2.040 V' is in V, expected N m/V"),
        ("2.040 N m/V", "-2.040 N m/V", "-2.040", "must be above 0"),
        ("2.040 N m/V", "2.040", "2.040 #", "has no unit"),
        ("2.040 N m/V", "2.040e300 N m/V", "2.040e300", "is impossible for a rig"),
        ("2.040 N m/V", "2.040e-30 N m/V", "2.040e-30", "is impossible for a rig"),
        ("5 mN m/V", "5 N m/V", "5 N m/V", "the value 2.040 N m/V has no meaning"),
        ("5 mN m/V", "-5 mN m/V", "-5 mN", "the uncertainty -5 mN m/V is below 0"),
        ("5 mN m/V", "5 mN m", "5 mN m", "expected N m/V"),
        ("0.0450", "-0.0450", "-0.0450", "must not be below 0"),
        ("made: 2026-01-02", "made: 2.1.2026", "2.1.2026", "is not a day such as 2026-11-21"),
        ("made: 2026-01-02", "made: 1767312000", "1767312000", "is not a day such as"),
        ("valid_until: 2027-01-02", "valid_until: 2025-01-02", "2025-01-02", "before 2026-01-02"),
        ("    valid_until: 2027-01-02\n", "", "value: 2.040", "the last day on which it is valid"),
        ("source: measured", "source: guessed", "guessed", "is not one of measured, assumed"),
        ("operator: B}", "operater: B}", "operater", "unknown key 'operater'"),
        ("calibration: bench", "calibratio: bench", "calibratio", "unknown key"),
        ("rigs: [bench-1]", "rigs: []", "[]", "at least 1 needed"),
    ],
)  # fmt: skip
def test_calibration_problem_is_reported_at_its_place(
    old: str, new: str, token: str, part: str
) -> None:
    assert TEXT.count(old) == 1
    text = TEXT.replace(old, new)
    head = text[: text.index(token)]
    place = f"bench.yaml:{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}: "
    with pytest.raises(ConfigError) as caught:
        parse_calibration(text, "bench.yaml")
    assert place in str(caught.value)
    assert part in str(caught.value)


def test_wrong_calibration_gives_its_own_places(tmp_path: Path) -> None:
    """The place is that in the calibration, and every problem is reported once."""
    (tmp_path / "bench.yaml").write_text(TEXT.replace("5 mN m/V", "5 V").replace("0.0450", "4 m"))
    rig = load_rig("lugre-1").source
    text = rig.text.replace("cycle: 1 kHz", "cycle: 1 kHz\ncalibration: bench.yaml")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, tmp_path / "rig.yaml")
    lines = [line for line in str(caught.value).splitlines() if str(tmp_path) in line]
    assert [line.partition(": ")[0] for line in lines] == [
        f"{tmp_path}/bench.yaml:8:8", f"{tmp_path}/bench.yaml:15:24",
    ]  # fmt: skip


def test_a_missing_file_keeps_no_rig_from_loading(tmp_path: Path) -> None:
    rig = load_rig("lugre-1").source
    text = rig.text.replace("cycle: 1 kHz", "cycle: 1 kHz\ncalibration: none.yaml")
    setup = parse_rig(text, tmp_path / "rig.yaml").calibration
    assert setup is not None
    assert (setup.path, setup.held) == (tmp_path / "none.yaml", None)


def test_shipped_file_never_stands_in_for_missing_one(tmp_path: Path) -> None:
    rig = load_rig("angle-1")
    assert rig.calibration is not None and rig.calibration.path.samefile(SHIPPED)
    copied = parse_rig(rig.source.text, tmp_path / "rig.yaml").calibration
    assert copied is not None
    name = "calibrations/approach_angle.yaml"
    assert (copied.path, copied.held) == (tmp_path / name, None)


def test_shipped_schema_is_current_and_fits_shipped_file() -> None:
    schema = calibration_schema()
    file = shipped_folder("schemas") / "calibration.schema.json"
    assert YAML(typ="safe", pure=True).load(file.read_text()) == schema, (
        "run: rigd schema calibration > schemas/calibration.schema.json"
    )
    data = YAML(typ="safe", pure=True).load(SHIPPED.read_text())
    for value in data["values"].values():  # an editor sees days as text
        value.update({key: str(value[key]) for key in ("made", "valid_until") if key in value})
    jsonschema.Draft202012Validator(schema).validate(data)


def test_renewed_value_enters_history_and_other_lines_stay() -> None:
    text = renew(TEXT)
    assert text.startswith("# This comment stays.\n\ncalibration: bench\n")
    new = parse_calibration(text, "bench.yaml")
    old = parse_calibration(TEXT, "bench.yaml")
    assert new.values["torque_scale"] == measured()
    assert new.values["roller_drag"] == old.values["roller_drag"]
    assert "value: 0.0450\n    u: 1.2 %\n" in text
    (replaced,) = new.history
    assert (replaced.name, replaced.replaced) == ("torque_scale", TODAY)
    assert replaced.value == old.values["torque_scale"]
    again = parse_calibration(renew(text), "bench.yaml")
    assert [item.value.operator for item in again.history] == ["C. Doe", "A. Miller"]


def test_new_file_can_be_read_back() -> None:
    new = renewed(
        None, {"torque_scale": measured()}, name="bench-2", rigs=["bench-2"],
        path=Path("new.yaml"), on=TODAY,
    )  # fmt: skip
    assert (new.name, new.rigs, new.history) == ("bench-2", ("bench-2",), ())
    assert parse_calibration(new.text, "new.yaml").values == {"torque_scale": measured()}


def test_impossible_calibration_value_is_not_written() -> None:
    old = parse_calibration(TEXT, "bench.yaml")
    wrong = {"torque_scale": measured(-2.0)}
    with pytest.raises(ConfigError, match="must be above 0"):
        renewed(old, wrong, name="x", rigs=["y"], path=old.path, on=TODAY)


def test_writing_replaces_file_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "calibrations" / "bench.yaml"
    new = parse_calibration(TEXT, str(file))
    write_calibration(new, None)
    assert load_calibration(file).values == new.values
    file.chmod(0o640)
    write_calibration(replace(new, text=renew(TEXT)), TEXT)
    assert file.read_text() == renew(TEXT)
    assert file.stat().st_mode & 0o777 == 0o640
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize(
    "raw",
    [TEXT.encode(), TEXT.replace("\n", "\r\n").encode(), TEXT.encode("utf-8-sig")],
    ids=["LF", "CRLF", "mark of byte order"],
)
def test_calibration_file_of_any_editor_is_renewed(tmp_path: Path, raw: bytes) -> None:
    file = tmp_path / "bench.yaml"
    file.write_bytes(raw)
    old = load_calibration(file)
    new = renewed(
        old, {"torque_scale": measured()}, name="bench", rigs=["bench-1"], path=file, on=TODAY
    )
    write_calibration(new, old.text)
    assert load_calibration(file).values["torque_scale"] == measured()


def test_file_changed_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(TEXT + "# by hand\n")
    with pytest.raises(ConfigError, match="has changed since it was read"):
        write_calibration(parse_calibration(TEXT, str(file)), TEXT)
    assert file.read_text() == TEXT + "# by hand\n"


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(TEXT)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigError, match="No space left on device"):
        write_calibration(parse_calibration(renew(TEXT), str(file)), TEXT)
    assert file.read_text() == TEXT
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("place", ["os.fdopen", "os.fsync", "pathlib.Path.replace"])
def test_kill_while_it_is_written_leaves_old_file(place: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(TEXT)
    (tmp_path / "new.yaml").write_text(renew(TEXT))
    code = f"""
import os, pathlib, signal
from rigd.config.calibration.calibration import parse_calibration
from rigd.config.calibration.calibration_file import write_calibration
text, before = (pathlib.Path({str(tmp_path)!r}, name).read_text() for name in
                ("new.yaml", "bench.yaml"))
new = parse_calibration(text, {str(file)!r})
{place} = lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL)
write_calibration(new, before)
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, timeout=60)
    assert done.returncode == -signal.SIGKILL
    assert file.read_text() == TEXT
