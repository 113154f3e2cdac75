"""Numbers of ROS 2 messages are those that another implementation of CDR wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rigd.record import Recording, verify
from rigd.record.read.condition import FileCondition
from rigd.record.read.messages.ros2msg import numbers_of

LINE = "=" * 80
DEFINITION = f"""\
uint8 FIRST=1
std_msgs/Header header  # texts of any length stand before the numbers
bool on
string<=20 words
int16[3] counts
float32[] samples
float64 force
a/Part[2] parts
a/Part[] more
int64 number
string[] names
uint8 last
{LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{LINE}
MSG: a/Part
float32 x
int8 y
float64 z
"""


def messages(count: int) -> tuple[list[bytes], list[Any]]:
    """Return messages as rosbags writes them, with what they hold."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    own = "uint8 FIRST=1\n" + DEFINITION.split(LINE)[0].split("\n", 1)[1].replace("<=20", "")
    store.register(get_types_from_msg("float32 x\nint8 y\nfloat64 z\n", "a/msg/Part"))
    store.register(get_types_from_msg(own, "a/msg/All"))
    kinds = store.types
    rng = np.random.default_rng(5)
    found, values = [], []
    for number in range(count):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=number, nanosec=7 * number)
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="f" * (number % 9))
        parts = [
            kinds["a/msg/Part"](x=np.float32(rng.normal()), y=-n, z=rng.normal()) for n in range(4)
        ]
        value = kinds["a/msg/All"](
            header=header,
            on=number % 2 > 0,
            words="w" * (number % 5),
            counts=np.array([number, -number, 3], np.int16),
            samples=rng.normal(size=number % 7).astype(np.float32),
            force=float(rng.normal()),
            parts=parts[:2],
            more=parts[: number % 4],
            number=-(10**12) - number,
            names=["n" * n for n in range(number % 3)],
            last=number % 251,
        )
        values.append(value)
        found.append(bytes(store.serialize_cdr(value, "a/msg/All")))
    return found, values


def test_numbers_of_any_type_are_columns(tmp_path: Path) -> None:
    payloads, values = messages(60)
    path = tmp_path / "all.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "another")
        schema = writer.register_schema("a/msg/All", "ros2msg", DEFINITION.encode())
        channel = writer.register_channel("/all", "cdr", schema)
        for number, data in enumerate(payloads):
            writer.add_message(channel, number + 1, data, number + 1)
        writer.add_message(channel, 100, payloads[0][:20], 100)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    recording = Recording.open(path)
    rows = recording.read("all")
    assert (len(rows), np.isnan(rows["force"][-1])) == (61, True)
    assert verify(path).condition is FileCondition.VALID
    for row, value in zip(rows, values, strict=False):
        assert row["force"] == value.force
        assert (row["header.stamp.sec"], row["header.stamp.nanosec"]) == (
            value.header.stamp.sec, value.header.stamp.nanosec,
        )  # fmt: skip
        assert [row[f"counts.{n}"] for n in range(3)] == value.counts.tolist()
        for n in range(2):
            part = value.parts[n]
            assert row[f"parts.{n}.x"] == part.x
            assert (row[f"parts.{n}.y"], row[f"parts.{n}.z"]) == (part.y, part.z)
        assert (row["on"], row["number"], row["last"]) == (value.on, value.number, value.last)
    assert "samples" not in "".join(rows.dtype.names or ())


@pytest.mark.parametrize(
    "text",
    [
        "string words",
        "a/Absent part\nfloat64 x",
        "wstring w\nfloat64 x",
        "float64[x] y",
        "",
        "\x00",
    ],
)
def test_type_without_known_numbers_has_none(text: str) -> None:
    assert numbers_of(text) is None


def test_type_within_itself_has_no_columns() -> None:
    assert numbers_of(f"a/T t\n{LINE}\nMSG: a/T\na/T t\nfloat64 x\n") is None
