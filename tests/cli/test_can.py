"""``rigd can eds``, and rig files whose devices have an EDS: the errors that a person sees."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.can.eds import line_of, write_eds
from support.commands.command import rigd

from rigd.config.loader import parse_rig
from rigd.model.errors import ConfigError
from rigd.sdk.shipped_files import shipped_folder

RIG = (shipped_folder("configs") / "wire_lugre.yaml").read_text()


def test_a_shipped_eds_is_shown_from_any_folder(tmp_path: Path) -> None:
    shown = rigd("can", "eds", "eds/rigd_servo.eds", cwd=tmp_path)
    assert shown.code == 0
    assert "product         rigd simulated servo\n" in shown.out
    assert "0x6071" not in shown.out


def test_objects_are_listed_on_demand(tmp_path: Path) -> None:
    write_eds(tmp_path / "x.eds", {"6071/HighLimit": "1000"})
    shown = rigd("can", "eds", "x.eds", "--json", cwd=tmp_path).json
    (torque,) = [row for row in shown["objects"] if row[0] == "0x6071"]
    assert dict(zip(shown["columns"], torque, strict=True)) == {
        "object": "0x6071", "name": "Target torque", "type": "INTEGER16", "access": "rw",
        "PDO": "yes", "limits": "at most 1000", "default": "0", "value": "",
    }  # fmt: skip
    shown = rigd("can", "eds", "x.eds", "--objects", cwd=tmp_path)
    assert "Target torque" in shown.out


def test_a_wrong_eds_is_refused_with_every_line(tmp_path: Path) -> None:
    path = write_eds(tmp_path / "x.eds", {"6071/DataType": "three", "6041/AccessType": "r"})
    refused = rigd("can", "eds", "x.eds", cwd=tmp_path)
    assert refused.code == 2
    assert refused.err.splitlines() == [
        f"rigd: x.eds:{line_of(path, '6041', 'AccessType')}:1: AccessType of [6041] is 'r', "
        "expected ro, wo, rw, rwr, rww, const",
        f"x.eds:{line_of(path, '6071', 'DataType')}:1: DataType of [6071] is 'three', "
        "expected a number",
    ]


def test_unfitting_eds_is_problem_of_the_rig_file(tmp_path: Path) -> None:
    changes = {"6041/PDOMapping": "0", "DeviceInfo/BaudRate_1000": "0"}
    eds = write_eds(tmp_path / "servo.eds", changes)
    text = RIG.replace("eds: eds/rigd_servo.eds # REAL: the", "eds: servo.eds # REAL: the")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, tmp_path / "rig.yaml")
    line = text[: text.index("node: 1 #")].count("\n") + 1
    first, *rest = str(caught.value).splitlines()
    assert first.startswith(f"{tmp_path / 'rig.yaml'}:{line}:")
    assert first.endswith("800 kbit/s, the link has 1000 kbit/s")
    where = f"servo.eds:{line_of(eds, '6041', 'PDOMapping')}"
    assert rest[-1].endswith(f"{where}: 0x6041 Statusword cannot be mapped to TPDO1")


def test_missing_eds_is_reported_at_its_place(tmp_path: Path) -> None:
    text = RIG.replace("eds: eds/rigd_servo.eds # REAL: the", "eds: nowhere.eds # REAL: the")
    with pytest.raises(ConfigError, match=r"there is no EDS 'nowhere\.eds'") as caught:
        parse_rig(text, tmp_path / "rig.yaml")
    assert caught.value.place is not None
    assert caught.value.place.line == text[: text.index("eds: nowhere")].count("\n") + 1


def test_node_ids_on_a_bus_must_differ(tmp_path: Path) -> None:
    text = RIG.replace("node: 2 # REAL", "node: 1 # REAL").replace("node: 12 #", "node: 127 #")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, tmp_path / "rig.yaml")
    told = str(caught.value)
    line = text[: text.index("node: 1 # REAL", text.index("longitudinal_belt:"))].count("\n") + 1
    assert f"rig.yaml:{line}:" in told
    assert "cia402-speed: two devices of the rig file have node id 1 on CAN bus" in told
    assert "cia406-encoder: node id 127 on CAN bus" in told
