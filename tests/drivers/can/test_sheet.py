"""EDS and DCF files: their content, and wrong ones refused with the line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.can.eds import SHIPPED, line_of, write_eds

from rigd.model.errors import ConfigError
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.eds_text import LARGEST
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.pdo import SYNCHRONOUS, Pdo
from rigd_drivers.can.canopen.sheet import Sheet, _read, read_sheet

SMALL = """\
[DeviceInfo]
VendorName=Käfer & Söhne
BaudRate_500=1
[1000]
ParameterName=Device type
DataType=0x0007
AccessType=ro
DefaultValue=0x00020192
[6071]
ParameterName=Target torque
DataType=0x0003
AccessType=rw
PDOMapping=1
LowLimit=0xFC18
HighLimit=1000
"""


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


@pytest.fixture
def small(tmp_path: Path) -> Sheet:
    return read_sheet(written(tmp_path / "small.eds", SMALL))


def test_objects_are_named_as_the_file_names_them(small: Sheet) -> None:
    assert small.called(0x6071) == "0x6071 Target torque"
    servo = read_sheet(SHIPPED / "rigd_servo.eds")
    assert servo.called(0x1018, 2) == "0x1018:02 Identity object, Product code"
    assert servo.called(0x1018, 9) == "0x1018:09 Identity object"
    assert servo.called(0x2345) == "0x2345"


def test_limits_of_signed_types_may_be_bit_patterns(small: Sheet) -> None:
    assert small.unwritable(objects.TARGET_TORQUE, -1000) is None
    assert small.unwritable(objects.TARGET_TORQUE, 1000) is None
    problem = small.unwritable(objects.TARGET_TORQUE, -1001)
    assert problem == "small.eds:14: 0x6071 Target torque is at least -1000, not -1001"
    problem = small.unwritable(objects.TARGET_TORQUE, 1001)
    assert problem == "small.eds:15: 0x6071 Target torque is at most 1000, not 1001"


def test_missing_object_is_named_by_its_purpose(small: Sheet) -> None:
    problem = small.unreadable(objects.SUPPORTED_MODES)
    assert problem == "small.eds: there is no object 0x6502 (supported drive modes)"


def test_another_size_of_a_value_is_named(small: Sheet) -> None:
    problem = small.unwritable(Entry(0x6071, 0, "i", "target torque"), 0)
    assert problem == "small.eds:11: 0x6071 Target torque has 2 bytes, this driver expects 4"


def test_object_without_parts_has_no_sub_index(small: Sheet) -> None:
    problem = small.unreadable(Entry(0x6071, 1, "h", "part"))
    assert problem == "small.eds:9: there is no object 0x6071:01 (part) in 0x6071 Target torque"


def test_limits_of_composed_fields_are_ignored(tmp_path: Path) -> None:
    limits = ("1016sub1/HighLimit", "1800sub1/HighLimit", "1A00sub1/HighLimit")
    path = write_eds(tmp_path / "x.eds", dict.fromkeys(limits, "65535"))  # as Elmo's 1016h
    sheet = read_sheet(path)
    assert sheet.unwritable(objects.HEARTBEAT_CONSUMER, 127 << 16 | 100) is None
    assert not list(sheet.unmappable(Pdo(1, True, 0x181, SYNCHRONOUS, (objects.STATUSWORD,))))


def test_write_only_object_cannot_be_read(tmp_path: Path) -> None:
    path = write_eds(tmp_path / "x.eds", {"6041/AccessType": "wo"})
    line = line_of(path, "6041", "AccessType")
    problem = read_sheet(path).unreadable(objects.STATUSWORD)
    assert problem == f"x.eds:{line}: 0x6041 Statusword is write only (wo)"


def test_eds_array_has_its_described_parts(tmp_path: Path) -> None:
    text = SMALL + (
        "[1003]\nParameterName=Errors\nObjectType=8\n"
        "[1003sub0]\nParameterName=Number\nDataType=5\nAccessType=rw\n"
        "[1003sub1]\nParameterName=Field\nDataType=7\nAccessType=ro\n"
        "[2000]\nParameterName=Compact\nObjectType=8\nDataType=7\nAccessType=ro\nCompactSubObj=3\n"
    )
    sheet = read_sheet(written(tmp_path / "array.eds", text))
    assert sheet.unreadable(Entry(0x1003, 1, "I", "e")) is None
    assert "no object 0x1003:02 (e)" in (sheet.unreadable(Entry(0x1003, 2, "I", "e")) or "")
    assert sheet.unreadable(Entry(0x2000, 3, "I", "e")) is None
    assert "no object 0x2000:04 (e)" in (sheet.unreadable(Entry(0x2000, 4, "I", "e")) or "")


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"6041/PDOMapping": "0"}, "6041/PDOMapping: 0x6041 Statusword cannot be mapped to TPDO1"),
        ({"6041/AccessType": "wo"}, "6041/AccessType: 0x6041 Statusword cannot be mapped to TPDO1"),
        ({"6041/DataType": "7"}, "6041/DataType: 0x6041 Statusword has 4 bytes"),
        ({"6041": None}, "there is no object 0x6041 (statusword)"),
        ({"1A00sub2": None}, "1A00/: there is no object 0x1A00:02 (object 2 mapped to TPDO1"),
        (
            {"1A00sub0/AccessType": "ro"},
            "1A00sub0/AccessType: 0x1A00:00 TPDO mapping parameter 1, Number of mapped objects is "
            "read only (ro)",
        ),
        ({"1800sub2/HighLimit": "0"}, "1800sub2/HighLimit: 0x1800:02 TPDO communication"),
    ],
)
def test_object_that_cannot_be_mapped_is_reported(
    tmp_path: Path, changes: dict[str, str | None], problem: str
) -> None:
    path = write_eds(tmp_path / "x.eds", changes)
    entries = (objects.STATUSWORD, objects.TORQUE)
    tpdo = Pdo(1, True, 0x181, SYNCHRONOUS, entries)
    told = list(read_sheet(path).unmappable(tpdo))
    where, colon, text = problem.partition(": ")
    if "/" in where:
        section, _, key = where.partition("/")
        text = f"x.eds:{line_of(path, section, key)}{colon}{text}"
    else:
        text = problem
    assert len(told) == 1
    assert text in told[0]
    assert not list(read_sheet(SHIPPED / "rigd_servo.eds").unmappable(tpdo))


@pytest.mark.parametrize(("access", "receives"), [("rwr", False), ("rww", True), ("wo", True)])
def test_object_access_limits_direction_of_mapping(
    tmp_path: Path, access: str, receives: bool
) -> None:
    sheet = read_sheet(write_eds(tmp_path / "x.eds", {"6071/AccessType": access}))
    rpdo = Pdo(1, False, 0x201, SYNCHRONOUS, (objects.TARGET_TORQUE,))
    tpdo = Pdo(1, True, 0x181, SYNCHRONOUS, (objects.TARGET_TORQUE,))
    assert bool(list(sheet.unmappable(rpdo))) is not receives
    assert bool(list(sheet.unmappable(tpdo))) is receives


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_of_any_origin_is_read(tmp_path: Path, encoding: str, end: str) -> None:
    text = SMALL.replace("\n", end)
    sheet = read_sheet(written(tmp_path / "x.eds", text, encoding))
    assert sheet.vendor_name == "Käfer & Söhne"
    assert sheet.bit_rates == {500_000}


def test_indented_lines_and_spellings_of_keys_are_read(tmp_path: Path) -> None:
    text = SMALL.replace("[6071]", "   [6071]   ").replace("PDOMapping", "pdomapping")
    sheet = read_sheet(written(tmp_path / "x.eds", text.replace("=1\n", "= 1 ; yes\n")))
    found = sheet.find(0x6071)
    assert found is not None
    assert found.pdo_mappable


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("[DeviceInfo]", "DeviceInfo", 1, "expected [section] or key=value"),
        ("[DeviceInfo]", "<?xml version='1.0'?>", 1, "XDD files (XML) are not read"),
        ("[DeviceInfo]", "[Device]", 1, "it has no section [DeviceInfo]"),
        ("[1000]", "[1005]", 1, "0x1000 (device type) is missing"),
        ("[6071]", "[6071", 9, "expected ']'"),
        ("[6071]", "[1000]", 9, "section [1000] stands here again, first in line 4"),
        ("[6071]", "[6071sub1]", 9, "[6071sub1] stands here without [6071]"),
        ("DataType=0x0003", "AccessType=rw", 12, "AccessType stands here again"),
        ("DataType=0x0003", "DataType=INTEGER16", 11, "DataType of [6071] is 'INTEGER16'"),
        ("DataType=0x0003", "", 9, "DataType is missing in [6071]"),
        ("AccessType=rw", "AccessType=r/w", 12, "AccessType of [6071] is 'r/w', expected ro, wo"),
        ("PDOMapping=1", "PDOMapping=yes", 13, "PDOMapping of [6071] is 'yes'"),
        ("HighLimit=1000", "HighLimit=1e3", 15, "HighLimit of [6071] is '1e3'"),
        ("HighLimit=1000", "HighLimit=0189", 15, "HighLimit of [6071] is '0189', expected a num"),
        ("HighLimit=1000", "HighLimit=-2000", 14, "LowLimit of [6071] is -1000, above its High"),
        ("HighLimit=1000", "ParameterValue=-1001", 15, "is -1001, expected -1000 to 32767"),
        ("HighLimit=1000", "ParameterValue=70000", 15, "is 70000, expected -1000 to 32767"),
        ("HighLimit=1000", "ParameterValue=much", 15, "ParameterValue of [6071] is 'much'"),
        ("BaudRate_500=1", "BaudRate_500=on", 3, "BaudRate_500 of [DeviceInfo] is 'on'"),
        ("[6071]", "[6071Name]\nNrOfEntries=999999999\n[6071]", 9, "more than 255 entries"),
        ("HighLimit=1000", "[1000sub100]", 15, "a sub-index is at most FF"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(
    tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    path = written(tmp_path / "x.eds", SMALL.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        read_sheet(path)
    assert caught.value.place is not None
    assert caught.value.place.line == line
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}:{line}:")


def test_file_that_breaks_the_library_is_refused(tmp_path: Path) -> None:
    """Names of the parts of an object that has none."""
    path = written(tmp_path / "x.eds", SMALL + "[6071Name]\nNrOfEntries=2\n1=One\n2=Two\n")
    with pytest.raises(ConfigError, match=r"x\.eds: cannot be understood: "):
        read_sheet(path)


def test_all_problems_are_named_at_once(tmp_path: Path) -> None:
    text = SMALL.replace("0x0003", "three").replace("=ro", "=read")
    with pytest.raises(ConfigError) as caught:
        read_sheet(written(tmp_path / "x.eds", text))
    assert [each.place.line for each in (caught.value, *caught.value.others) if each.place] == [
        7,
        11,
    ]


def test_binary_or_too_large_file_is_refused(tmp_path: Path) -> None:
    binary = tmp_path / "x.eds"
    for wrong in (b"\0\0", b"ProductName=\x1b]0;title\x07"):
        binary.write_bytes(b"[DeviceInfo]\n" + wrong)
        with pytest.raises(ConfigError, match="it is not text"):
            read_sheet(binary)
    huge = tmp_path / "huge.eds"
    with huge.open("wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(ConfigError, match=r"4\.2 MB are too much"):
        read_sheet(huge)
    with pytest.raises(ConfigError, match="no such file"):
        read_sheet(tmp_path)


def test_changed_file_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path / "x.eds", SMALL)
    assert read_sheet(path).find(0x6072) is None
    path.write_text(SMALL.replace("6071", "6072"), "utf-8")
    assert read_sheet(path).find(0x6072) is not None


def test_dcf_has_node_bit_rate_and_values(tmp_path: Path) -> None:
    text = SMALL + "ParameterValue=0xFFFF\n[DeviceComissioning]\nNodeID=0x05\nBaudrate=500\n"
    path = written(tmp_path / "x.dcf", text)
    sheet = read_sheet(path)
    assert (sheet.node, sheet.bit_rate) == (5, 500_000)
    facts = CanBus.read_sheet(path).facts
    assert facts["values"].startswith("1 as configured")


def test_numbers_with_leading_zero_are_octal(tmp_path: Path) -> None:
    """CiA 306-1: an integer is decimal, hexadecimal after 0x, or octal after 0."""
    text = SMALL.replace("DataType=0x0003", "DataType=003").replace("=1000", "=01750")
    text = text.replace("BaudRate_500=1", "BaudRate_500=01\nVendorNumber=0373")
    node = "ParameterValue=-0750\n[DeviceComissioning]\nNodeID=012\nBaudrate=0764\n"
    name = "[1008]\nParameterName=0123\nDataType=0x0009\nAccessType=const\nDefaultValue=0123\n"
    sheet = read_sheet(written(tmp_path / "x.dcf", text + node + name))
    assert (sheet.identity[0], sheet.node, sheet.bit_rate) == (0xFB, 10, 500_000)
    torque, called = sheet.find(0x6071), sheet.find(0x1008)
    assert torque is not None and called is not None
    assert (torque.data_type, torque.min, torque.max, torque.value) == (3, -1000, 1000, -488)
    assert called.name == str(called.default) == "0123"  # texts are no numbers


def test_eds_object_without_section_gives_a_remark(tmp_path: Path) -> None:
    path = written(tmp_path / "x.eds", SMALL + "[OptionalObjects]\nSupportedObjects=1\n1=0x6502\n")
    remark = "line 18: [OptionalObjects] lists 0x6502, and there is no section [6502]"
    assert CanBus.read_sheet(path).remarks == (remark,)


#: What a line of a spoilt file may be; `=` follows the key that stood there.
SPOILT = st.text(max_size=12) | st.sampled_from(
    [
        *("", "[", "[6071]", "[6071sub1]", "=", "=0", "=-1", "=7", "=9", "=0x1C", "=0xZ"),
        *("=9999999999", "=$NODEID", "=%(a)s", "=ro", "=\x85"),
    ]
)


@given(st.lists(st.tuples(st.integers(0, 22), SPOILT), min_size=1, max_size=4))
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_spoilt_file_is_read_or_refused(tmp_path: Path, spoilt: list[tuple[int, str]]) -> None:
    text = SMALL + "[1A00]\nParameterName=M\nObjectType=9\n[1A00sub1]\nParameterName=O\n"
    lines = (text + "DataType=7\nAccessType=rw\nDefaultValue=$NODEID+0x180\n").split("\n")
    for at, value in spoilt:
        key = lines[at].partition("=")[0] if value.startswith("=") else ""
        lines[at] = key + value
    path = tmp_path / "x.eds"
    path.write_bytes("\n".join(lines).encode("utf-8", "surrogatepass"))
    _read.cache_clear()  # faster than the clock of the file system
    try:
        sheet = read_sheet(path)
    except ConfigError as error:
        assert "x.eds" in str(error)
    else:
        for found in sheet.variables():
            sheet.called(found.index, found.subindex)
        CanBus.read_sheet(path)
